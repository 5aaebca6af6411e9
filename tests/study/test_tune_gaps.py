"""`tune` divides the gaps of contact."""

import math

import pytest
from test_gap_share import GAP, height, lay

import fecloth as fc
from fecloth.study import tuning
from fecloth.study.fronts.bench import Bench
from fecloth.study.fronts.settings import Settings
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Runs
from fecloth.study.tuning import Reduced, narrow_gaps


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
