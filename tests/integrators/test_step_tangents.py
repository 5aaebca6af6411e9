"""Which factor serves the derivatives of a step: that of the run, or an exact one for all."""

import math
from types import SimpleNamespace

import pytest

from fecloth.integrators.derivatives import STEPS_BETWEEN_TRIALS, StepTangents
from fecloth.nonlinear.context import PRICES


def tangents(count: int, linear: str = "pardiso") -> StepTangents:
    context = SimpleNamespace(matrix_solver=lambda: (SimpleNamespace(name=linear), None))
    return StepTangents(
        None, True, context, count, 1e-4, earlier_contractions={"held": 0.1, "exact": 1e-4}
    )


def solvers_of_second_step(made: StepTangents) -> list[str]:
    made.solvers(object(), True)
    return list(made.solvers(object(), True))


@pytest.mark.parametrize("part", [0.8, 1.25])
def test_an_exact_factor_is_made_where_it_saves_more_solves_than_it_costs(part):
    """To 1e-4 corrections that shrink by 0.1 take four solves, with the exact factor one."""
    count = part * PRICES["pardiso"] / 3
    assert (solvers_of_second_step(tangents(count)) == ["exact"]) == (part > 1)


def test_a_step_without_an_iteration_has_no_matrix_to_keep():
    assert list(tangents(1).solvers(object(), False)) == ["exact"]


def test_conjugate_gradients_keep_their_matrix():
    assert solvers_of_second_step(tangents(100, "pcg")) == ["held", "exact"]


def test_the_factor_of_the_run_is_tried_again_after_some_steps():
    made = tangents(100)
    count = 2 * STEPS_BETWEEN_TRIALS
    first = [next(iter(made.solvers(object(), True))) for _ in range(count)]
    held = [number for number, name in enumerate(first, 1) if name == "held"]
    assert held == [STEPS_BETWEEN_TRIALS, 2 * STEPS_BETWEEN_TRIALS]


def test_contractions_of_a_step_are_kept_for_the_next_one():
    made = tangents(1)
    made.solvers(object(), True)
    made.contractions["held"] = 0.2
    made.solvers(object(), True)
    assert made.contractions == {}
    assert math.isclose(made.earlier_contractions["held"], 0.2)
