"""Newmark, generalised-α and BDF2: start, changing steps, reactions."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg
from conftest import affine, taut_start
from support.linear_term import LinearDamping, LinearMembrane
from support.one_step import generalized_alpha, newmark
from support.tiers import MASSES

import fecloth as fc
from fecloth.integrators.newmark import Acceleration
from fecloth.verify import observed_order


@pytest.fixture(scope="module")
def drum(small):
    """A linear, damped sheet with fixed sides, its rest, and its modes (ω², shapes)."""
    terms, fabric = [LinearMembrane(), LinearDamping(1e-4)], fc.Fabric(0.2, 1000.0, 0.3)
    system = fc.System(small, fabric, terms, pins=["boundary"])
    rest = affine(small, [[1.2, 0.0], [0.0, 1.2], [0.0, 0.0]])
    free = system.free
    K = system.stiffness(system.state(rest)).toarray()[np.ix_(free, free)]
    M = system.mass.toarray()[np.ix_(free, free)]
    return system, rest, M, *scipy.linalg.eigh(K, M)


def bdf2(k, d, dt):
    """3/2 y₁ − 2 y₀ + ½ y₋ = dt A y₁, after one step of the trapezoidal rule."""
    A, eye = dt * np.array([[0.0, 1.0], [-k, -d]]), np.eye(2)
    path = [np.array([0.01, 0.0])]
    yield path[0]
    path.append(np.linalg.solve(eye - A / 2, (eye + A / 2) @ path[0]))
    while True:
        yield path[-1]
        path.append(np.linalg.solve(1.5 * eye - A, 2 * path[-1] - path[-2] / 2))


def path_of(step):
    """x and v of a one-step method from x = 0.01 at rest, with the acceleration of that."""

    def path(k, d, dt):
        y = np.array([0.01, 0.0, -0.01 * k])
        while True:
            yield y[:2]
            y = step(k, d, 1.0, dt) @ y

    return path


SCALAR = {
    fc.BDF2(): bdf2,
    fc.Newmark(): path_of(newmark(0.25, 0.5)),
    fc.Newmark(0.36, 0.7): path_of(newmark(0.36, 0.7)),
    fc.GeneralizedAlpha(0.0): path_of(generalized_alpha(0.0)),
    fc.GeneralizedAlpha(0.5): path_of(newmark(4 / 9, 5 / 6, 0.0, 1 / 3)),
    fc.GeneralizedAlpha(1.0): path_of(generalized_alpha(1.0)),
}


TIGHT = fc.Newton(tolerance=1e-12)


@pytest.mark.parametrize("mass", MASSES)
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


@pytest.mark.parametrize("mode", [0, -1])
@pytest.mark.parametrize("method", SCALAR, ids=repr)
def test_a_mode_follows_the_scalar_method(method, mode, drum):
    """x and v of an eigenmode that starts at x = 0.01, from step to step."""
    system, rest, M, values, modes = drum
    k, dt = values[mode], 2e-3
    shape = np.zeros(rest.size)
    shape[system.free] = modes[:, mode]
    start = system.state(rest + 0.01 * shape.reshape(-1, 3))
    path, weight, scale = SCALAR[method](k, 1e-4 * k, dt), M @ modes[:, mode], [1.0, np.sqrt(k)]
    next(path)
    for state, _ in fc.march(system, method, start, dt, 6 * dt, solver="direct", newton=TIGHT):
        ours = [weight @ each.ravel()[system.free] for each in (state.x - rest, state.v)]
        np.testing.assert_allclose(np.divide(ours, scale), next(path) / scale, atol=1e-11)
