"""Steps that open and close: the residual, its derivative and the end of a step at a given q."""

import numpy as np
import pytest
from conftest import taut_start
from support.sliders import Sliders

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.linalg.block_matrix import BlockMatrix

TIGHT = fc.Newton(tolerance=1e-12, reuse=False)
DT = 2e-3
PULL = fc.Pin("left", motion=lambda t: [0.1 * t, 0.0, 0.2 * np.sin(9 * t)])


def made(small, isotropic, *more, damped=True):
    """Without damping of the strain rate the tangents of all methods are exact."""
    terms = [fc.StVK(), fc.MassDamping(2.0), fc.Gravity(), *more]
    terms += [fc.StrainRateDamping(1e-3)] if damped else []
    line = fc.Slide("right", direction=(0, 1, 0))
    return fc.System(small, isotropic, terms, pins=[PULL, line])


def second_step(system, method, dt=DT):
    """The state, memory and history at the begin of a second step, and its solver."""
    solver, _ = fc.solver_for(system, method, dt, "direct", TIGHT)
    start = taut_start(system)
    first = method.step(system, start, dt, solver, None, system.start_history(start))
    return first.state, first.memory, first.history, solver


def solved(step):
    """The q of a step, which is an entry of its memory."""
    return getattr(step.memory, "a", getattr(step.memory, "dv", step.memory))


@pytest.mark.parametrize("slides", [False, True], ids=["", "with history"])
@pytest.mark.parametrize("name", METHODS)
def test_open_and_close_at_the_solved_q_are_the_step(name, slides, small, isotropic):
    system = made(small, isotropic, *([Sliders(20.0, 0.003)] if slides else []))
    method = METHODS[name]()
    state, memory, history, solver = second_step(system, method)
    step = method.step(system, state, DT, solver, memory, history)
    opening = method.open(system, state, DT, memory, history)
    q = system.constraints.project(solved(step).copy())  # without what the pins prescribe
    closed = method.close(opening, q)
    np.testing.assert_allclose(closed.state.x, step.state.x, rtol=0, atol=1e-15)
    np.testing.assert_allclose(closed.state.v, step.state.v, rtol=0, atol=1e-13)
    assert closed.state.t == step.state.t
    size = np.linalg.norm(opening.residual(0 * q))
    assert np.linalg.norm(opening.residual(q)) < 1e-10 * size
    if slides:
        by_parts, second = closed.history[3], step.history[3]
        np.testing.assert_allclose(by_parts.place, second.place, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", METHODS)
def test_the_tangent_is_the_derivative_of_the_residual(name, small, isotropic, rng):
    """Central differences along a free direction, where the tangents are exact."""
    kind = METHODS[name]
    method = kind(tangent="exact") if name == "energy_momentum" else kind()
    over_step = name in ("backward_euler", "bdf2")
    system = made(small, isotropic, damped=over_step)
    state, memory, _, _ = second_step(system, kind())
    opening = method.open(system, state, DT, memory)
    project = system.constraints.project
    wx = opening.stage.wx if hasattr(opening, "stage") else DT
    q = project(1e-3 / wx * rng.standard_normal(state.x.shape))
    d = project(1e-6 / wx * rng.standard_normal(state.x.shape))
    J = opening.tangent(q, BlockMatrix.zeros(system.pattern))
    change = 0.5 * (opening.residual(q + d) - opening.residual(q - d))
    np.testing.assert_allclose(project(J @ d), change, atol=1e-6 * abs(change).max())


@pytest.mark.parametrize("name", EXPLICIT)
def test_explicit_steps_open_and_close(name, small, isotropic):
    """The acceleration at the state that they ask for makes the step, to the last bit."""
    system, method = made(small, isotropic, Sliders(20.0, 0.003)), EXPLICIT[name]()
    state, memory, history, _ = second_step(system, method, 1e-4)
    step = method.step(system, state, 1e-4, None, memory, history)
    opening = method.open(system, state, 1e-4, memory, history)
    a = opening.over.force(opening.at) / system.nodal_mass[:, None]
    np.testing.assert_allclose(opening.acceleration(), a, rtol=1e-14)
    closed = method.close(opening, opening.acceleration())
    np.testing.assert_array_equal(closed.state.x, step.state.x)
    np.testing.assert_array_equal(closed.state.v, step.state.v)
    np.testing.assert_array_equal(closed.history[3].place, step.history[3].place)
