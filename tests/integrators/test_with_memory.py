"""Newmark, generalised-α and BDF2: start, changing steps, reactions."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg
from conftest import affine, taut_start
from support.linear_term import LinearDamping, LinearMembrane
from support.tiers import MASSES, in_turn

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


def path_of_mode(drum, method, mode, dt, steps):
    """(steps + 1, 2) x and v of an eigenmode that starts at x = 0.01."""
    system, rest, M, _, modes = drum
    shape = np.zeros(rest.size)
    shape[system.free] = modes[:, mode]
    start = system.state(rest + 0.01 * shape.reshape(-1, 3))
    weight, path = M @ modes[:, mode], [(0.01, 0.0)]
    for state, _ in fc.march(system, method, start, dt, steps * dt, solver="direct", newton=TIGHT):
        both = (state.x - rest).ravel(), state.v.ravel()
        path.append([weight @ y[system.free] for y in both])
    return np.array(path)


def newmark(A, y, a, dt, alpha_m, alpha_f, beta, gamma):
    """One step of the method on x'' = −k x − d v, A = (k, d), by solving for all of x, v, a."""
    (x, v), (k, d) = y, A
    f = 1 - alpha_f
    matrix = [
        [1, 0, -beta * dt**2],
        [0, 1, -gamma * dt],
        [f * k, f * d, 1 - alpha_m],
    ]
    right = [
        x + dt * v + (0.5 - beta) * dt**2 * a,
        v + (1 - gamma) * dt * a,
        -alpha_m * a - alpha_f * (k * x + d * v),
    ]
    x, v, a = np.linalg.solve(matrix, right)
    return np.array([x, v]), a


ONE_STEP = {
    fc.Newmark(): (0.0, 0.0, 0.25, 0.5),
    fc.Newmark(0.36, 0.7): (0.0, 0.0, 0.36, 0.7),
    fc.GeneralizedAlpha(0.0): (-1.0, 0.0, 1.0, 1.5),
    fc.GeneralizedAlpha(0.5): (0.0, 1 / 3, 4 / 9, 5 / 6),
    fc.GeneralizedAlpha(1.0): (0.5, 0.5, 0.25, 0.5),
}


METHODS = [*ONE_STEP, fc.BDF2()]


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


@pytest.mark.parametrize("mode", [0, -1])
@pytest.mark.parametrize(("method", "parameters"), ONE_STEP.items(), ids=repr)
def test_a_mode_follows_the_scalar_method(method, parameters, mode, drum):
    k, dt = drum[3][mode], 2e-3
    A = k, 1e-4 * k
    y, a, path = np.array([0.01, 0.0]), -0.01 * k, [(0.01, 0.0)]
    for _ in range(6):
        y, a = newmark(A, y, a, dt, *parameters)
        path.append(y)
    found = path_of_mode(drum, method, mode, dt, 6)
    np.testing.assert_allclose(
        found / [1, np.sqrt(k)], path / np.array([1, np.sqrt(k)]), atol=1e-11
    )


@pytest.mark.parametrize("mode", [0, -1])
def test_a_mode_follows_the_scalar_bdf2(mode, drum):
    """Steps of equal size, 3/2 y₁ − 2 y₀ + ½ y₋ = dt A y₁, after one of the trapezoidal rule."""
    k, dt = drum[3][mode], 2e-3
    A, eye = dt * np.array([[0.0, 1.0], [-k, -1e-4 * k]]), np.eye(2)
    path = [np.array([0.01, 0.0])]
    path.append(np.linalg.solve(eye - A / 2, (eye + A / 2) @ path[0]))
    for _ in range(5):
        path.append(np.linalg.solve(1.5 * eye - A, 2 * path[-1] - path[-2] / 2))
    scale, found = np.array([1, np.sqrt(k)]), path_of_mode(drum, fc.BDF2(), mode, dt, 6)
    np.testing.assert_allclose(found / scale, np.array(path) / scale, atol=1e-11)


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.8, 1.0])
def test_the_fastest_modes_lose_the_factor_rho(rho, drum):
    """The spectral radius of (x, dt v, dt² a) → the same after one step, at ω dt = 1000."""
    damped, rest, M, values, modes = drum
    system = fc.System(damped.cloth, damped.fabric, [LinearMembrane()], ["boundary"])
    method, dt, free = fc.GeneralizedAlpha(rho), 1000 / np.sqrt(values[-1]), system.free
    solver, _ = fc.solver_for(system, method, dt, "direct", fc.Newton(tolerance=1e-9))
    shape = np.zeros(rest.size)
    shape[free] = modes[:, -1]
    shape, weight, columns = 0.01 * shape.reshape(-1, 3), 100 * M @ modes[:, -1], []
    for x, v, a in np.eye(3):
        start = system.state(rest + x * shape, v / dt * shape)
        step = method.step(system, start, dt, solver, Acceleration(a / dt**2 * shape))
        after = step.state.x - rest, dt * step.state.v, dt**2 * step.memory.a
        columns.append([weight @ y.ravel()[free] for y in after])
    assert abs(np.linalg.eigvals(np.array(columns))).max() == pytest.approx(rho, abs=0.02)


@pytest.mark.stories
@pytest.mark.parametrize(("method", "mass"), in_turn(METHODS, MASSES), ids=str)
def test_ledger_of_a_linear_problem(method, mass, small, isotropic):
    """Closes; with fixed pins only Newmark's rule and ρ∞ = 1 at γ = ½ take nothing themselves."""
    terms = [LinearMembrane(), LinearDamping(0.01), fc.Gravity()]
    system = fc.System(small, isotropic, terms, ["left", "right"], mass=mass)
    moving = system.constraints.project(taut_start(system).v)
    start = system.state(taut_start(system).x, moving)
    energies = fc.run(system, method, start, 2e-3, 0.1, solver="direct", newton=TIGHT).energies
    total = abs(energies["total"]).max()
    assert abs(energies["remainder"]).max() < 1e-10 * total
    takes = abs(energies["numerical"]).max()
    if method in (fc.Newmark(), fc.GeneralizedAlpha(1.0)):
        assert takes < 1e-14 * total
    else:
        assert takes > 1e-3 * total
