"""Levels of an equilibrium that start from the coarser solution: same rest, fewer iterations."""

from dataclasses import replace

import numpy as np
import pytest

from fecloth.simulation.quantity import parse_quantity
from fecloth.study.coarser_start import needs_the_way
from fecloth.study.levels import levels_to_run
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Runs, run_quantities

pytestmark = pytest.mark.filterwarnings("ignore")

DRAWN = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25, element = "P1" }
terms = [{ type = "StVK" }, { type = "PlateBending" }, { type = "Gravity" }]
equilibrium = { load_steps = 4 }
probes = [{ name = "grip", where = "right" }]
interest = { end = ["sag", "reaction.right.x", "energy.StVK"] }
pins = [{ where = "left", clamp = true },
        { where = "right", clamp = true, motion = ["0.02 * t", "0.01 * t", "0.1 * t"] }]
[fabric]
areal_density = 0.2
tensile_stiffness = 500.0
bending_rigidity = 1e-3
"""


@pytest.fixture
def drawn(tmp_path):
    path = tmp_path / "drawn.toml"
    path.write_text(DRAWN)
    return path


def rows_of(problem, follow, **more):
    problem = StudyProblem.of(problem, **more)
    quantities = problem.choose_quantities(problem.source.interest or ["sag"])
    runs = levels_to_run(problem, quantities[0], "h", 3)
    if not follow:
        runs = [replace(run, follows=False) for run in runs]
    return run_quantities(runs, quantities, Runs(quiet=True))


@pytest.mark.parametrize(("element", "pattern"), [("P2", "right"), ("P1", "unstructured")])
def test_pins_that_moved_stay_and_the_rest_is_the_same(drawn, element, pattern):
    drawn.write_text(drawn.read_text().replace('"P1"', f'"{element}", pattern = "{pattern}"'))
    near, cold = rows_of(drawn, follow=True), rows_of(drawn, follow=False)
    for a, b in zip(near, cold, strict=True):
        assert a["status"] == b["status"] == "ok"
        np.testing.assert_allclose(a["displacement"], b["displacement"], atol=1e-6)
        assert a["ends"]["grip.z"][1] == pytest.approx(0.1, abs=1e-12)
        for name in ("sag", "reaction:right.x", "StVK"):
            assert a["ends"][name][1] == pytest.approx(b["ends"][name][1], rel=1e-4)
    assert near[0]["newton"] == cold[0]["newton"]
    assert all(a["newton"] < 0.8 * b["newton"] for a, b in zip(near[1:], cold[1:], strict=True))


def test_a_quantity_of_the_way_takes_the_way(drawn):
    texts = {"sag": False, "max sag": True, "sag at 0.5 s": True, "work.Wind": True, "pins": True}
    texts |= {"energy.StVK": False, "reaction.right.x": False, "path of grip": True}
    for text, needs in texts.items():
        assert needs_the_way(parse_quantity(text)) == needs, text
    drawn.write_text(drawn.read_text().replace('"sag",', '"max sag",'))
    near, cold = rows_of(drawn, follow=True), rows_of(drawn, follow=False)
    assert [row["newton"] for row in near] == [row["newton"] for row in cold]
