"""Slow iterations of an equilibrium: conjugate gradients with the exact matrix follow."""

from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear import iteration
from fecloth.nonlinear.equation import Remedy
from fecloth.nonlinear.increments import static_context
from fecloth.nonlinear.static_equation import StaticEquation
from studies.newton_catalogue.statics import sheared


def test_a_wrinkled_sheet_takes_few_iterations():
    """Its symmetric wrinkles are a saddle of the energy: 326 iterations without the directions."""
    assert fc.equilibrium(*sheared(0.05, 0.02, "P1", 1 / 16, "StVK")).iterations < 40


def make_work(compression, shift=1.0):
    """An iteration at a strip that is stretched or compressed, and what `refine` needs of it."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h=0.125, pattern="right")
    fabric = fc.Fabric(0.2, 100.0, 0.3, bending_rigidity=1e-3)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, ["left", "right"])
    start = system.state(system.rest().x * [1 - compression, 1, 1])
    context = static_context(system, "auto", 9, "direct")
    work = iteration._Work(StaticEquation(system, start), context)
    point = work.at(start.x, 0.0)
    return work, point, work.direction(point, Remedy(shift, True))


def exact_matrix(work, point):
    return work.equation.assemble(point.y, Remedy(0.0, False), work.J) or work.J.to_scipy()


def test_the_refined_step_solves_the_exact_equation():
    work, point, step = make_work(-0.05, shift=1e4)
    refined = work.refine(point, step)
    K = exact_matrix(work, point)
    left, rough = (K @ s.ravel() + point.R.ravel() for s in (refined, step))
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(point.R) < np.linalg.norm(rough)


def test_a_direction_without_positive_curvature_is_taken():
    work, point, step = make_work(0.05)
    direction = work.refine(point, step).ravel()
    assert direction @ (exact_matrix(work, point) @ direction) <= 0
    assert direction @ point.R.ravel() < 0  # downhill


SLOW = {"length": 1.0, "norm": 0.6, "shift": 1.0, "explores": True, "potential": len}


@pytest.mark.parametrize(
    ("change", "slow_steps"),
    [
        ({}, 1),
        ({"norm": 0.4}, 0),  # of the residual before: half of it is allowed
        ({"length": 0.5}, 0),
        ({"shift": 0.0}, 0),
        ({"explores": False}, 0),
        ({"potential": None}, 0),
    ],
)
def test_which_iterations_are_slow(change, slow_steps):
    case = SimpleNamespace(**SLOW | change)
    equation = SimpleNamespace(
        explores=case.explores, potential=case.potential, wx=1.0, takes_short_solves=False
    )
    work = SimpleNamespace(
        remedies=SimpleNamespace(last=0, order=[Remedy(case.shift, True)]),
        **{"cut_short": False, "equation": equation, "slow_steps": 0, "system": None},
        left=SimpleNamespace(correct=lambda *a: None, move=lambda *a: None),
    )
    ends = (SimpleNamespace(y=np.ones((1, 3)), norm=norm, scale=1.0) for norm in (1.0, case.norm))
    before, after = ends
    iteration._Work.correct(work, before, after, case.length)
    assert work.slow_steps == slow_steps


@pytest.mark.parametrize(("slow_steps", "refines"), [(2, False), (3, True), (4, True)])
def test_three_slow_iterations_in_a_row_are_enough(slow_steps, refines, monkeypatch):
    work, point, _ = make_work(-0.05)
    monkeypatch.setattr(iteration._Work, "refine", lambda *arguments: None)
    work.slow_steps = slow_steps
    assert (work.direction(point, Remedy(1.0, True)) is None) == refines
    assert work.direction(point, Remedy(0.0, False)) is not None  # the exact matrix itself
