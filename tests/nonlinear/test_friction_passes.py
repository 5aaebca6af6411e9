"""The passes of an increment with friction: how many, and how long they are."""

from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear import increments
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.statistics import Counts

X = np.zeros((1, 3))


class NotBalanced(Exception):
    """The failure of the scripted equation."""


def limits_of_passes(monkeypatch, iterations):
    """The most iterations of each pass, of an increment whose forces never balance."""
    limits = []

    def solve_pass(equation, x, context, report, number):
        limits.append(context.options.max_iterations)
        return None, X, Counts(newton=iterations(limits[-1]))

    def failure(reason, point, residual):
        return NotBalanced(reason)

    sums = SimpleNamespace(norm=lambda R: 1.0)
    equation = SimpleNamespace(
        residual=lambda x, scale: (X, 1.0), system=SimpleNamespace(sums=sums), failure=failure
    )
    increment = SimpleNamespace(equation=lambda place=None: equation)
    context = SolverContext(None, None, fc.Newton(max_iterations=50))
    monkeypatch.setattr(increments, "_solve_pass", solve_pass)
    with pytest.raises(NotBalanced, match="friction and its normal forces did not agree"):
        increments._solve_in_passes(increment, X, context, lambda iteration: None)
    return limits


def test_passes_grow_from_four_iterations_and_take_four_times_the_limit_in_all(monkeypatch):
    assert limits_of_passes(monkeypatch, lambda most: most) == [4, 8, 16, 32, 50, 50, 50]


def test_there_are_forty_passes_at_most(monkeypatch):
    assert len(limits_of_passes(monkeypatch, lambda most: 1)) == 40
