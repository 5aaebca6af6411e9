"""Slow iterations of an equilibrium: conjugate gradients with the exact matrix follow."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear.increments import static_context
from fecloth.nonlinear.remedies import Remedy
from fecloth.nonlinear.static_equation import StaticEquation
from fecloth.nonlinear.steps import Steps


def test_a_wrinkled_sheet_takes_few_iterations():
    """Its symmetric wrinkles are a saddle of the energy: 326 iterations without the directions."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, 1 / 16, "cross")
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -0.5))]
    system = fc.System(cloth, fabric, terms, ["top", "bottom"])
    x = system.rest().x * [1, 1.02, 1]
    x[:, 0] += 0.05 * x[:, 1]
    assert fc.equilibrium(system, system.state(x)).iterations < 40


def make_steps(compression, shift=1.0):
    """Steps at a strip that is stretched or compressed, and what `refine` needs of them."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h=0.125, pattern="right")
    fabric = fc.Fabric(0.2, 100.0, 0.3, bending_rigidity=1e-3)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, ["left", "right"])
    start = system.state(system.rest().x * [1 - compression, 1, 1])
    context = static_context(system, "auto", 9, "direct")
    steps = Steps(StaticEquation(system, start), context)
    progress = steps.begin(start.x)
    return steps, progress, steps.directions.find(progress.point, Remedy(shift, True))


def exact_matrix(steps, point):
    matrix = steps.directions.matrix
    steps.equation.assemble(point.y, Remedy(0.0, False), matrix)
    return matrix.to_scipy()


def test_the_refined_step_solves_the_exact_equation():
    steps, progress, step = make_steps(-0.05, shift=1e4)
    point = progress.point
    refined = steps.directions.refine(point, step)
    K = exact_matrix(steps, point)
    left, rough = (K @ s.ravel() + point.R.ravel() for s in (refined, step))
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(point.R) < np.linalg.norm(rough)


def test_a_direction_without_positive_curvature_is_taken():
    steps, progress, step = make_steps(0.05)
    point = progress.point
    direction = steps.directions.refine(point, step).ravel()
    assert direction @ (exact_matrix(steps, point) @ direction) <= 0
    assert direction @ point.R.ravel() < 0  # downhill


SLOW_CASE = {"length": 1.0, "norm": 0.6, "shift": 1.0, "explores": True, "potential": len}


@pytest.mark.parametrize(
    ("change", "is_slow"),
    [
        ({}, True),
        ({"norm": 0.4}, False),  # of the residual before: half of it is allowed
        ({"length": 0.5}, False),
        ({"shift": 0.0}, False),
        ({"explores": False}, False),
        ({"potential": None}, False),
    ],
)
def test_which_iterations_are_slow(change, is_slow):
    case = SimpleNamespace(**SLOW_CASE | change)
    equation = SimpleNamespace(explores=case.explores, potential=case.potential)
    before, after = (
        SimpleNamespace(
            point=SimpleNamespace(norm=norm), remedy=Remedy(case.shift, True), length=case.length
        )
        for norm in (1.0, case.norm)
    )
    assert Steps.is_slow(SimpleNamespace(equation=equation), before, after) == is_slow


def test_slow_iterations_are_counted_in_a_row(monkeypatch):
    steps, progress, _ = make_steps(0.05)
    counted = []
    for is_slow in (True, True, False, True):
        monkeypatch.setattr(steps, "is_slow", lambda *arguments, is_slow=is_slow: is_slow)
        progress = steps.advance(progress)
        counted.append(progress.slow_steps)
    assert counted == [1, 2, 0, 1]


@pytest.mark.parametrize(("slow_steps", "refines"), [(2, False), (3, True), (4, True)])
def test_three_slow_iterations_in_a_row_are_enough(slow_steps, refines, monkeypatch):
    steps, progress, _ = make_steps(-0.05)
    monkeypatch.setattr(steps.directions, "refine", lambda *arguments: None)
    progress = replace(progress, slow_steps=slow_steps)
    step, _ = steps.find_direction(progress, Remedy(1.0, True))
    assert (step is None) == refines
    step, _ = steps.find_direction(progress, Remedy(0.0, False))  # the exact matrix itself
    assert step is not None
