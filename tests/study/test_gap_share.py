"""The gap of contact is a part of the error that `converge` states, beside mesh and time step."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import fecloth as fc
from fecloth import study
from fecloth.study import tuning
from fecloth.study.fronts.bench import Bench
from fecloth.study.fronts.settings import Settings
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Runs
from fecloth.study.tuning import Reduced, narrow_gaps

KAPPA, GAP, DENSITY = 200.0, 4e-3, 0.2
SCENE = f"""
[cloth]
shape = "rectangle"
width = 0.2
height = 0.1
h = 0.1

[fabric]
areal_density = {DENSITY}
tensile_stiffness = 100.0

[[terms]]
type = "StVK"

[[terms]]
type = "Gravity"

[[terms]]
type = "Obstacle"
shape = {{ type = "Plane", point = [0, 0, 0], normal = [0, 0, 1] }}
gap = {GAP}
stiffness = {KAPPA}

[[pins]]
where = "boundary"
direction = [0, 0, 1]

[[probes]]
name = "corner"
point = [0.0, 0.0]

[start]
shift = [0, 0, "3.6 mm"]

[equilibrium]
tolerance = 1e-10
"""


def height(gap):
    """Where the pressure −κ b′(d/gap), b = −(s − 1)² ln s, carries the weight per area."""

    def surplus(s):
        return -KAPPA * (-2 * (s - 1) * math.log(s) - (s - 1) ** 2 / s) - DENSITY * 9.81

    return gap * brentq(surplus, 1e-6, 1 - 1e-9, xtol=1e-15)


def lay(h, gap=GAP):
    """The same as a function."""
    cloth = fc.Cloth.rectangle(0.2, 0.1, h)
    obstacle = fc.Obstacle(fc.shapes.Plane((0, 0, 0), (0, 0, 1)), gap, stiffness=KAPPA)
    fabric = fc.Fabric(DENSITY, 100.0)
    pins = [fc.Slide("boundary", direction=(0, 0, 1))]
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity(), obstacle], pins)
    x = np.column_stack([cloth.X, np.full(len(cloth.X), 0.9 * gap)])
    return cloth, system, fc.BackwardEuler(), system.state(x)


def test_a_sheet_on_a_table_lies_too_high_by_the_share_of_the_gap(tmp_path):
    """The height is s gap with one s for all gaps: as much is the error against a gap of 0."""
    path = tmp_path / "table.toml"
    path.write_text(SCENE)
    result = study.converge(path, "corner.z", levels=3, cache=None)
    assert result.value == pytest.approx(height(GAP), rel=1e-6)
    assert result.shares["gap"] == pytest.approx(height(GAP), rel=1e-4)
    assert result.uncertainty >= height(GAP)
    assert any("take a smaller gap" in line for line in result.remarks)


@pytest.mark.parametrize("by", [2.0, 5.0])
def test_a_level_divides_all_gaps_of_scenes_and_functions(by, tmp_path):
    path = tmp_path / "table.toml"
    path.write_text(SCENE)
    opened = [StudyProblem.of(path), StudyProblem.of(lay, h=0.1)]
    for problem in opened:
        term = problem.finer(gap=by).first.system.terms[-1]
        assert term.gap == pytest.approx(GAP / by, rel=1e-12)
        assert problem.first.system.terms[-1].gap == GAP


# --- tune divides the gaps ------------------------------------------------------------------------


def reduce(tolerance, quantity="corner.z"):
    """The sheet on a table, with its gaps divided for a tolerance."""
    problem = StudyProblem.of(lay, h=0.1, probes=[fc.Probe("corner", point=(0.0, 0.0))])
    quantities = problem.choose_quantities(quantity)
    bench = Bench(Settings.of(problem), quantities, Runs(quiet=True), 60.0)
    return narrow_gaps(Reduced(problem, {"model": 0.001}, ("without Drag",)), bench, tolerance)


@pytest.mark.parametrize("by", [1.0, 8.0, 20.0, 32.0])
def test_tune_divides_the_gaps_until_a_quarter_of_the_tolerance_is_left(by):
    """The height is all error, relative to the displacement from 0.9 gaps in the finer run."""
    part = height(GAP) / GAP
    whole = part / abs(part / 2 - 0.9)
    tolerance = whole / (0.25 * by) * {1.0: 1.25, 32.0: 0.8}.get(by, 1.0)
    reduced = reduce(tolerance)
    assert reduced.errors == {"model": 0.001, "gap": pytest.approx(whole / by, rel=1e-3)}
    gap = reduced.problem.first.system.terms[-1].gap
    assert gap == pytest.approx(GAP / by, rel=1e-3)
    assert reduced.changes == ("without Drag", *([f"gaps / {by:g}"] if by > 1 else []))


def test_an_error_of_gaps_that_is_not_known_proves_nothing(monkeypatch):
    """One of the two runs has failed."""
    rows = iter([{"status": "ok"}, {"status": "failed"}])
    monkeypatch.setattr(tuning, "run_problem", lambda bench, problem: next(rows))
    reduced = reduce(0.01)
    assert reduced.errors["gap"] == math.inf
    assert reduced.problem.first.system.terms[-1].gap == GAP
    assert reduced.changes == ("without Drag",)
