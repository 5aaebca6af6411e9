"""Which factor serves the derivatives of a step: the factor of the run, or an exact one."""

from types import SimpleNamespace

from fecloth.integrators.derivatives import StepTangents


def tangents() -> StepTangents:
    return StepTangents(None, True, SimpleNamespace(), 1e-4)


def test_the_factor_of_the_run_is_tried_before_an_exact_one():
    assert list(tangents().solvers(object(), True)) == ["held", "exact"]


def test_a_step_without_an_iteration_has_no_matrix_to_keep():
    assert list(tangents().solvers(object(), False)) == ["exact"]


def test_an_exact_factor_serves_all_parameters_of_its_step_alone():
    made = tangents()
    first, second = object(), object()
    made.solvers(first, True)
    made.exact_solution = first
    assert list(made.solvers(first, True)) == ["exact"]
    assert list(made.solvers(second, True)) == ["held", "exact"]


def test_contractions_are_those_of_the_step():
    made = tangents()
    solution = object()
    made.solvers(solution, True)
    made.contractions["held"] = 0.2
    made.solvers(solution, True)
    assert made.contractions == {"held": 0.2}
    made.solvers(object(), True)
    assert made.contractions == {}
