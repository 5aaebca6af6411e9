"""Newmark, generalised-α and BDF2: start, changing steps, reactions."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import taut_start

import fecloth as fc
from fecloth.integrators.newmark import Acceleration
from fecloth.verify import observed_order

TIGHT = fc.Newton(tolerance=1e-12)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_the_starting_acceleration_is_consistent(mass, small, isotropic):
    """M a = f along the free directions, by a dense solve, also where pins are moved."""
    shake = fc.Pin("left", motion=lambda t: [0.0, 0.0, t**2])
    terms = [fc.StVK(), fc.StrainRateDamping(0.002), fc.Gravity()]
    system = fc.System(small, isotropic, terms, pins=[shake], mass=mass)
    state, dt = taut_start(system), 1e-3
    solver, _ = fc.solver_for(system, fc.Newmark(), dt, "direct", TIGHT)
    left = small.nodes("left")
    expected, others = np.zeros_like(state.v), np.setdiff1d(np.arange(len(small.X)), left)
    expected[left] = ([0.0, 0.0, 2 * dt] - state.v[left]) / dt
    M = system.scalar_mass.toarray()
    known = system.force(state) - M @ expected
    expected[others] = np.linalg.solve(M[np.ix_(others, others)], known[others])
    for tiny in (fc.Newmark(), fc.GeneralizedAlpha()):
        free = tiny.step(system, state, dt, solver)
        told = tiny.step(system, state, dt, solver, Acceleration(expected))
        np.testing.assert_allclose(free.state.x, told.state.x, atol=1e-12)
        np.testing.assert_allclose(free.state.v, told.state.v, atol=1e-9)


@pytest.mark.stories
def test_bdf2_keeps_its_order_where_the_steps_change(small, isotropic):
    """Steps in the ratios 2 and ½ by turns, refined: the change of the end falls by 2² each."""
    terms = [fc.StVK(), fc.StrainRateDamping(0.002), fc.Gravity()]
    system, method = fc.System(small, isotropic, terms, pins=["boundary"]), fc.BDF2()
    ends, counts = [], (20, 40, 80, 160)
    for steps in counts:
        short = 0.005 / (1.5 * steps)
        solver, _ = fc.solver_for(system, method, short, "direct", fc.Newton(1e-11))
        state, q = taut_start(system), None
        for number in range(steps):
            step = method.step(system, state, short * (1 + number % 2), solver, q)
            state, q = step.state, step.memory
        ends.append(state.x)
    changes = [np.linalg.norm(a - b) for a, b in pairwise(ends)]
    assert observed_order(1 / np.array(counts[:-1]), changes)[-1] == pytest.approx(2, abs=0.15)


def test_reactions_of_bdf2_are_those_at_the_end_of_the_step(isotropic):
    """All nodes moved with z = t² + 5 t³: m (2 + 30 t), as BDF2 is exact for a quadratic v."""
    cloth = fc.Cloth.rectangle(0.3, 0.3, h=0.1)
    pin = fc.Pin(
        lambda X: X[:, 0] > -1,
        lambda t: [0.0, 0.0, t**2 + 5 * t**3],
        lambda t: [0.0, 0.0, 2 * t + 15 * t**2],
        name="all",
    )
    system = fc.System(cloth, isotropic, [fc.StVK()], pins=[pin])
    result = fc.run(system, fc.BDF2(), system.rest(), 0.01, 0.1, solver="direct")
    expected = system.nodal_mass.sum() * (2 + 30 * result.times[2:])
    np.testing.assert_allclose(result.observed["reaction:all.z"][2:], expected, rtol=1e-9)
