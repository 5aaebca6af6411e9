"""Unknowns: their place in u, their bounds, and what ends at the same place."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from fecloth.study.fitting import search as fit_module
from fecloth.study.fitting.statistics import LARGEST_UNCERTAINTY
from fecloth.study.fitting.unknowns import make_unknowns


@pytest.mark.parametrize(
    ("name", "start", "at_1", "slope"),
    [
        ("fabric.tensile_stiffness", 20.0, 20.0 * math.e, 20.0),
        ("fabric.poisson_ratio", 0.2, 0.7, 0.5),
        ("force", -3.0, 0.0, 3.0),
        ("force", 0.0, 1.0, 1.0),
    ],
)
def test_a_constant_is_a_power_where_it_is_positive_and_else_a_sum(name, start, at_1, slope):
    (unknown,) = make_unknowns({name: start}, ())
    assert unknown.at(0.0) == start
    assert unknown.at(1.0) == pytest.approx(at_1)
    assert unknown.slope(0.0) == pytest.approx(slope)


def test_a_ratio_is_told_up_to_an_uncertainty_of_a_quarter_and_others_up_to_a_factor_of_1_65():
    ratio, constant = make_unknowns({"fabric.poisson_ratio": 0.2, "B": 1.0}, ())
    assert ratio.slope(0.0) * LARGEST_UNCERTAINTY == 0.25
    assert constant.at(LARGEST_UNCERTAINTY) == pytest.approx(1.65, abs=0.01)


def test_the_poisson_ratio_of_bending_stays_between_minus_1_and_1():
    ratio, free = make_unknowns(
        {"fabric.bending_poisson_ratio": 0.3, "fabric.poisson_ratio": 0.3}, ()
    )
    ends = [ratio.at(u) for u in ratio.bounds]
    assert ends == [pytest.approx(-1, abs=2e-3), pytest.approx(1, abs=2e-3)]
    assert max(map(abs, ends)) < 1 - 5e-4
    assert free.bounds == (-math.inf, math.inf)


@pytest.mark.parametrize(("distance", "same"), [(0.8 * 0.02, 2), (1.25 * 0.02, 1)])
def test_ends_are_the_same_place_that_differ_by_less_than_2_per_cent(distance, same, monkeypatch):
    places = iter([0.0, distance])

    def end_somewhere(self, begin):
        u = next(places)
        return SimpleNamespace(u=np.array([u]), cause="", residual=np.array([1.0 + u]))

    monkeypatch.setattr(fit_module.Search, "run", end_somewhere)
    fitting = SimpleNamespace(unknowns=make_unknowns({"B": 1.0}, ()))
    best, count = fit_module.search(fitting, starts=2)
    assert best.u[0] == 0.0
    assert count == same
