"""The stress at a point as a quantity: of runs, of all studies, and where there is none."""

import csv

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.orders import space_order
from fecloth.view.html_report import read_table

STORY = pytest.mark.stories
STRESS = "stress.xx at (0.4, 0.1)"
STRIP = """
cloth = { shape = "rectangle", width = 1.0, height = 0.25, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }]
pins = [{ where = "left" }, { where = "right", motion = ["0.1 * t", "0", "0"] }]
equilibrium = { load_steps = 2 }
"""
EVEN = 1000 * (1.1**2 - 1) / 2  # S of the strip, as ν = 0 [N/m]
INTEREST = f"""
[interest]
quantities = ["{STRESS}", "stress.yy at (40 cm, 0.1)"]
[measured]
"{STRESS}" = ["0.11 kN/m", "2 N/m"]
[uncertain]
fabric.tensile_stiffness = "5 %"
"""


@pytest.fixture
def scene(tmp_path):
    def write(text=STRIP, *changes):
        file = tmp_path / "strip.toml"
        file.write_text(text, encoding="utf-8")
        return fc.load_scene(file, changes)

    return write


def test_the_grammar():
    for text in (STRESS, "stress.yy of hem at (1e-2,-0.2)", "stress.xy at (10 mm, 2 cm)"):
        quantity = parse_quantity(text)
        assert (quantity.column, quantity.how, quantity.at) == (text, "value", None)
        assert quantity.unit() == "N/m"
    timed = parse_quantity(f"{STRESS} at 30 ms")
    assert (timed.column, timed.at) == (STRESS, 0.03)
    assert parse_quantity(f"max {STRESS}").how == "max"
    assert parse_quantity(f"path of {STRESS}").column == STRESS


def test_a_run_answers_it(scene, tmp_path):
    outcome = fc.run_scene(scene(STRIP + INTEREST), tmp_path / "out")
    answer = outcome.quantities[STRESS]
    assert answer.value == pytest.approx(EVEN)
    assert (answer.unit, answer.measured) == ("N/m", (110.0, 2.0))
    assert outcome.quantities["stress.yy at (40 cm, 0.1)"].value == pytest.approx(0.0, abs=1e-9)
    file = tmp_path / "out" / "observed.csv"
    with file.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row[STRESS]) for row in rows] == pytest.approx([0.0, 51.25, EVEN])
    assert read_table(file)[STRESS][-1] == pytest.approx(EVEN)


def test_a_motion_has_it_at_each_step(scene):
    text = STRIP.replace("equilibrium = { load_steps = 2 }", "")
    text += 'time = { method = "bdf2", dt = 0.05, t_end = 0.5 }\n'
    text = text.replace("0.1 * t", "0.1 * t**2")
    swept = fc.study.of(scene(text)).sweep(
        "fabric.areal_density=1e-6,1e-5", [STRESS, f"{STRESS} at 0.25 s", f"max {STRESS}"]
    )
    for row in swept.table:  # so light a strip is always in equilibrium
        ends = [1000 * ((1 + 0.1 * t**2) ** 2 - 1) / 2 for t in (0.5, 0.25, 0.5)]
        assert list(row.values())[2:5] == pytest.approx(ends, rel=1e-3)


@STORY
def test_studies_take_it(scene):
    problem = scene(STRIP + INTEREST)
    study = fc.study.of(problem)
    converged = study.converge(levels=3)
    assert converged.value == pytest.approx(EVEN)
    assert (converged.theory, converged.unit, converged.quantity) == (2.0, "N/m", STRESS)
    compared = study.compare("cloth.element=P1,P2")
    assert [row["value"] for row in compared.table] == pytest.approx([EVEN] * 2, rel=1e-6)
    budget = fc.budget(problem, quantity=STRESS)
    assert budget.value == pytest.approx(EVEN)
    assert budget.input == pytest.approx(0.05 * EVEN, rel=1e-3)
    assert budget.difference == pytest.approx(EVEN - 110)
    assert fc.tune(problem, "1%", STRESS, elements=["P1"], seconds=20).error < 1e-6


CONSTANTS = {"fabric.tensile_stiffness": 1000.0, "fabric.poisson_ratio": 0.3}
UNEVEN = STRIP.replace("1000.0", "1000.0, poisson_ratio = 0.3").replace("0.25, p", "0.125, p")


@pytest.mark.parametrize(
    ("element", "key"),
    [("P1", "fabric.poisson_ratio"), pytest.param("P2", "fabric.tensile_stiffness", marks=STORY)],
)
def test_its_derivative_is_the_slope_of_runs(scene, key, element):
    """With ν = 0.3 the clamped ends make the stress uneven."""
    quantities = [f"stress.{part} at (0.1, 0.02)" for part in ("xx", "yy", "xy")]
    size = 1e-3 * CONSTANTS[key]
    derived, *answers = (
        fc.sensitivity(
            scene(UNEVEN, f"cloth.element={element}", f"{key}={CONSTANTS[key] + step}"),
            key,
            quantities,
        )
        for step in (0.0, size, -size)
    )
    slopes = np.subtract(*(answer.value for answer in answers)) / (2 * size)
    scale = np.abs(slopes).max()
    np.testing.assert_allclose(derived.derivative[:, 0], slopes, rtol=1e-4, atol=1e-5 * scale)


@pytest.mark.parametrize(("element", "order"), [("P1", 2.0), ("P2", 3.0)])
def test_theoretical_orders(scene, element, order):
    setup = scene(STRIP, f"cloth.element={element}").build()
    assert space_order(parse_quantity(STRESS), setup) == order
