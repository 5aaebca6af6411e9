"""`stability`: measured limits against known ones, ranges and ties, mistakes, the command."""

import math
from functools import cache

import numpy as np
import pytest
from support.strips import scene_file

import fecloth as fc
from fecloth.study.problem import StudyProblem
from fecloth.study.stability_map import describe_best, describe_range
from fecloth.study.stability_runs import counts_of, energy_made, list_next_runs, range_of

pytestmark = pytest.mark.stories

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 1.0, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "boundary" }]
start = { position = ["1.05 * X", "1.05 * Y", "0"] }
[time]
method = "bdf2"
dt = 0.01
t_end = 0.2
"""
EXPLICIT = ["central_difference", "symplectic_euler"]


scene = scene_file(SCENE, "sheet")


def sheet(h, density=0.2):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
    fabric = fc.Fabric(density, 1000.0)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    return cloth, system, fc.BDF2(), system.state(1.05 * system.rest().x)


def limit_from_eigenvalues(density):
    """Return 2/ω of the stiffest mode, from dense eigenvalues."""
    _, system, _, start = sheet(0.25, density)
    Z = system.admissible
    K, M = ((Z.T @ A @ Z).toarray() for A in (system.stiffness(start), system.mass))
    return 2 / math.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.max())


def test_the_measured_range_contains_the_limit(scene, tmp_path):
    over = "fabric.areal_density=0.2,0.8"
    result = fc.study.stability(scene, over, EXPLICIT, cache=tmp_path)
    width = {0.2: 1.2, 0.8: 1.45}  # 78 and 39 steps: fewer show less growth
    for method in EXPLICIT:
        for density in (0.2, 0.8):
            own = [
                cell
                for cell in result.cells
                if (cell["method"], cell["fabric.areal_density"]) == (method, density)
            ]
            limit = limit_from_eigenvalues(density)
            low, high = range_of(own)
            assert low < limit < high <= width[density] * low
            assert own[0]["predicted"] == pytest.approx(limit, rel=1e-3)
    assert {cell["status"] for cell in result.cells} == {"ok", "failed"}
    assert "central_difference and symplectic_euler hold the longest step, " in result.verdict
    assert not result.has_stopped


def test_a_function_and_an_implicit_method():
    result = fc.study.stability(sheet, None, ["bdf2", "CentralDifference"], h=0.25, t_end=0.2)
    bdf2, explicit = result.table
    assert bdf2["predicted limit"] == "none"
    assert bdf2["does not fail up to"] == "≥ 200 ms"  # a single step
    assert bdf2["measured over predicted"] == ""
    assert explicit["next step"] == "failed: the method makes energy"
    first, second = result.figure().axes
    (line,) = [line for line in second.lines if line.get_color() == "black"]
    assert line.get_ydata()[0] == pytest.approx(limit_from_eigenvalues(0.2), rel=1e-3)
    assert not [line for line in first.lines if line.get_color() == "black"]


def test_a_refused_value_has_a_row_with_its_reason_and_the_others_run(scene, tmp_path):
    over = {"pins.0.where": ["nowhere", "boundary"]}  # which only the mesh knows
    result = fc.study.stability(scene, over, ["central_difference"])
    assert ["not known" in range_ for range_ in result.table["longest step"]] == [True, False]
    assert ["nowhere" in words for words in result.table["next step"]] == [True, False]
    assert "central_difference holds" in result.verdict
    assert result.exit_status == 3
    assert result.report(tmp_path).exists()


def test_the_steps_next_to_the_limit_are_as_close_as_growth_is_seen():
    """A mode at round-off grows by exp(2 N arcosh r): N = 101, 60 and 20 steps."""
    for count, r in ((101, 1.06), (60, math.cosh(24 / 60)), (20, 2**0.25)):
        listed = counts_of(1.0, 1 / count)
        parts = (2**1.5, 2**0.5, r, 1 / r, 2**-0.5, 2**-1.5)
        assert listed == [math.ceil(count / part) for part in parts]


@cache
def problem():
    return StudyProblem.of(sheet, h=0.5, t_end=0.2)


def row(status, steps, seconds=1.0):
    """A run of so many steps."""
    of_run = {"problem": problem(), "method": "bdf2", "values": {}, "predicted": None}
    return of_run | {"status": status, "steps": steps, "dt": 1 / steps, "cpu_seconds": seconds}


def next_counts(rows, most_seconds=None):
    return [run.work.steps for run in list_next_runs(rows, most_seconds)]


@pytest.mark.parametrize(
    ("statuses", "seconds", "counts"),
    [
        (("ok", "ok", "ok"), 1.0, [4]),  # the longest step holds
        (("wrong", "ok", "ok"), 1.0, [4]),  # it is wrong, but does not fail
        (("failed", "ok", "ok"), 1.0, []),
        (("failed", "failed", "failed"), 1.0, [64]),  # the shortest step does not hold
        (("failed", "failed", "wrong"), 4.9, [64]),
        (("failed", "failed", "wrong"), 5.1, []),  # twice of it is above the time limit
        (("failed", "failed", "time limit"), 1.0, []),
    ],
)
def test_shorter_and_longer_steps_run_until_both_ends_are_known(statuses, seconds, counts):
    rows = zip(statuses, (8, 16, 32), strict=True)
    assert next_counts([row(*each, seconds) for each in rows], 10.0) == counts


def test_a_single_step_is_the_longest():
    assert [next_counts([row("ok", steps)]) for steps in (1, 2, 3)] == [[], [1], [2]]


def test_runs_that_were_stopped_say_nothing(scene):
    result = fc.study.stability(scene, None, ["bdf2"], time_limit=1e-9)
    assert result.has_stopped
    assert result.table["longest step"] == ["not known"]
    assert result.table["next step"][0].startswith("time limit: ")


def test_ranges_on_made_up_rows():
    cells = [{"dt": dt, "status": "ok"} for dt in (1e-3, 2e-3, 8e-3)]
    late, wrong = {"dt": 3e-3, "status": "time limit"}, {"dt": 4e-3, "status": "wrong"}
    assert range_of([*cells, late, wrong]) == (2e-3, 4e-3)  # 8 ms holds by chance
    assert range_of([*cells, late, wrong], ("ok", "wrong")) == (8e-3, math.inf)
    assert describe_range(range_of([wrong])) == "< 4 ms"
    assert describe_range(range_of([late])) == "not known"


def test_ties_on_made_up_ranges():
    open_end = dict.fromkeys(("a", "b", "c"), (0.025, math.inf))
    assert describe_best(open_end) == "a, b and c hold the longest step, ≥ 25 ms"
    overlap = {"a": (2e-3, 4e-3), "b": (1.5e-3, 3e-3), "c": (1e-3, 2e-3), "d": (0.0, math.inf)}
    assert describe_best(overlap) == "a and b hold the longest step, 2–4 ms"
    apart = {"a": (2e-3, math.inf), "b": (1e-3, 2e-3)}
    assert describe_best(apart).startswith("a holds the longest step, ≥ 2 ms")


def test_energy_made():
    kinetic, gravity = np.array([0.0, 1.0, 3.0]), np.array([0.0, -1.0, -2.0])
    energies = {"kinetic": kinetic, "Gravity": gravity, "pins": np.zeros(3)}
    energies["total"] = kinetic + gravity
    assert energy_made(energies) == pytest.approx(1 / 5)  # 1 J of the 3 J + 2 J that moved
