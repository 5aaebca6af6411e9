"""`tune` divides the gaps of contact."""

import math

import pytest
from fecloth.study.problems import open_problem
from fecloth.study.tuning.choices import Bench, Choice
from fecloth.study.tuning.tune import narrow_gaps
from test_gap_share import GAP, height, lay

import fecloth as fc
from fecloth.study.opened import open_study


@pytest.mark.parametrize("by", [1.0, 8.0, 20.0, 32.0])
def test_tune_divides_the_gaps_until_a_quarter_of_the_tolerance_is_left(by):
    """The height is all error, relative to the displacement from 0.9 gaps in the finer run."""
    part = height(GAP) / GAP
    whole = part / abs(part / 2 - 0.9)
    tolerance = whole / (0.25 * by) * {1.0: 1.25, 32.0: 0.8}.get(by, 1.0)
    probes = [fc.Probe("corner", point=(0.0, 0.0))]
    opened = open_study(lay, {"h": 0.1, "probes": probes, "cache": None})
    quantities = opened.problem.choose_quantities("corner.z")
    bench = Bench(opened.problem, quantities, opened.runs())
    narrow, error, words = narrow_gaps(bench, Choice(h=0.1), tolerance)
    assert error.max() == pytest.approx(whole / by, rel=1e-3)
    assert narrow.opened.first.system.terms[-1].gap == pytest.approx(GAP / by, rel=1e-3)
    assert words == ([f"gaps / {by:g}"] if by > 1 else [])
    assert len(bench.done) == 2


def test_an_error_of_gaps_that_is_not_known_proves_nothing(monkeypatch):
    """One of the two runs has failed."""
    opened = open_problem(lay, h=0.1)
    bench = Bench(opened, opened.choose_quantities("sag"), None)
    monkeypatch.setattr(Bench, "run", lambda self, choices: [Failed()])
    narrow, error, words = narrow_gaps(bench, Choice(h=0.1), 0.01)
    assert narrow.opened is opened
    assert error.tolist() == [math.inf]
    assert words == []


class Failed:
    """A run that failed."""

    is_ok = False
