"""The largest stable step: against dense eigenvalues and real runs, and estimates of it."""

import numpy as np
import pytest
from conftest import affine
from scipy.linalg import eigh
from support.one_step import newmark

import fecloth as fc
from fecloth.stability import (
    critical_dt,
    critical_step,
    element_bound,
    estimate,
)

TAUT = [[1.2, 0.1], [0.0, 1.05], [0.3, 0.0]]  # shears and turns the sheet, and stretches it


def dense(system, state):
    """K, D, M on the free directions, as full matrices."""
    Z = system.admissible
    parts = system.stiffness(state), system.damping(state), system.mass
    return [(Z.T @ A @ Z).toarray() for A in parts]


def symplectic_euler(K, D, M, dt):
    """v + dt a(x, v), x + dt v."""
    k, d, one = np.linalg.solve(M, K), np.linalg.solve(M, D), np.eye(len(M))
    v = [-dt * k, one - dt * d]
    return np.block([[one + dt * v[0], dt * v[1]], v])


def central_difference(K, D, M, dt):
    """(x, v, a): x + dt v + dt²/2 a, a = −k x⁺ − d (v + dt a), v + dt/2 (a + a⁺)."""
    k, d, one = np.linalg.solve(M, K), np.linalg.solve(M, D), np.eye(len(M))
    x = [one, dt * one, dt**2 / 2 * one]
    a = [-k @ x[0], -k @ x[1] - d, -k @ x[2] - dt * d]
    v = [dt / 2 * a[0], one + dt / 2 * a[1], dt / 2 * (one + a[2])]
    return np.block([x, v, a])


def forward_euler(K, D, M, dt):
    k, d, one = np.linalg.solve(M, K), np.linalg.solve(M, D), np.eye(len(M))
    return np.block([[one, dt * one], [-dt * k, one - dt * d]])


STEPS = {  # the matrix of a step, as the method's definition reads, and dampings of rate and mass
    fc.SymplecticEuler(): (symplectic_euler, [(1e-3, 3.0), (5e-3, 3.0), (0.05, 3.0)]),
    fc.CentralDifference(): (central_difference, [(1e-3, 3.0), (5e-3, 3.0), (0.05, 3.0)]),
    fc.ForwardEuler(): (forward_euler, [(5e-3, 3.0), (5e-3, 300.0)]),
    fc.Newmark(0.1, 0.5): (newmark(0.1, 0.5), [(0.0, 0.0), (1e-3, 3.0), (5e-3, 3.0)]),
    fc.Newmark(0.2, 0.6): (newmark(0.2, 0.6), [(0.0, 0.0), (1e-3, 3.0), (5e-3, 3.0)]),
    fc.Newmark(0.25, 0.7): (newmark(0.25, 0.7), [(0.0, 0.0), (1e-3, 3.0), (5e-3, 3.0)]),
}


@pytest.fixture(scope="module")
def small():
    return fc.Cloth.rectangle(1.0, 0.6, h=0.25)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_lanczos_meets_the_dense_eigenvalues(sheet, orthotropic, mass):
    slide = fc.Slide("right", direction=(1, 1, 0))
    terms = [fc.StVK(), fc.Gravity()]
    system = fc.System(sheet, orthotropic, terms, pins=["left", slide], mass=mass)
    state = system.state(affine(sheet, TAUT))
    K, _, M = dense(system, state)
    expected = 2 / np.sqrt(eigh(K, M, eigvals_only=True)[-1])
    assert critical_dt(system, state) == pytest.approx(expected, rel=1e-8)
    assert critical_dt(system, state, "central_difference") == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize(
    ("method", "eta", "rate"),
    [(method, *damping) for method, (_, dampings) in STEPS.items() for damping in dampings],
    ids=repr,
)
def test_the_limit_is_where_the_step_matrix_begins_to_grow(small, isotropic, method, eta, rate):
    """The prestress makes the modes of M⁻¹K others than those of M⁻¹D."""
    damping = [fc.StrainRateDamping(eta), fc.MassDamping(rate)] if eta else []
    system = fc.System(small, isotropic, [fc.StVK(), *damping], pins=["left"])
    state = system.state(affine(small, TAUT))
    limit, (K, D, M) = critical_dt(system, state, method), dense(system, state)
    assert not eta or abs(K @ np.linalg.solve(M, D) - D @ np.linalg.solve(M, K)).max() > 0
    below, above = (
        abs(np.linalg.eigvals(STEPS[method][0](K, D, M, factor * limit))).max()
        for factor in (1 - 1e-5, 1 + 1e-5)
    )
    assert below < 1 + 1e-8
    assert above > 1 + 1e-10
    if isinstance(method, fc.Newmark):
        assert element_bound(system, method) > 0


def test_a_gas_counts(isotropic):
    """Its part of rank one is stiff: without it the limit and an estimate would be unsafe."""
    cloth = fc.Cloth.disk(0.5, 0.2)
    gas = fc.Gas(pressure=1e5, volume=1e-4)
    systems = [fc.System(cloth, isotropic, t, pins=["boundary"]) for t in ([fc.StVK()], [gas])]
    x = systems[0].rest().x
    x[:, 2] = 0.01 * (1 - np.sum(cloth.X**2, axis=1) / 0.25)
    state = systems[0].state(x)
    ((c, u),) = systems[1].dense(state)
    K, _, M = dense(systems[1], state)
    u = systems[1].admissible.T @ u.ravel()
    expected = 2 / np.sqrt(eigh(K + c * np.outer(u, u), M, eigvals_only=True)[-1])
    dt = critical_dt(systems[1], state)
    assert dt == pytest.approx(expected, rel=1e-8)
    assert dt < 0.7 * critical_dt(systems[0], state)
    assert 0.96 < estimate(systems[1], state, fc.SymplecticEuler()) / dt < 1.01


@pytest.mark.parametrize("kind", [fc.SymplecticEuler, fc.CentralDifference])
@pytest.mark.parametrize("damping", [[], [fc.StrainRateDamping(1e-3)]])
def test_the_coded_methods_keep_to_it(small, isotropic, kind, damping):
    """From noise of 1e-9 m the motion is linear; 2 % above the limit it explodes, 2 % below not."""
    system = fc.System(small, isotropic, [fc.StVK(), *damping], pins=["left"])
    noise = 1e-9 * np.random.default_rng(5).standard_normal((len(small.X), 3))
    start = system.state(system.rest().x + system.constraints.project(noise))
    method, limit = kind(beyond_limit=True), critical_dt(system, system.rest(), kind)
    largest = []
    for dt in (0.98 * limit, 1.02 * limit):
        for new, info in fc.march(system, method, start, dt, 1000 * dt):
            moved = abs(new.x - system.rest().x).max()
            if moved > 1e-5 or info.step == 1000:
                break
        largest.append(moved)
    assert largest[0] < 1e-7
    assert largest[1] > 1e-5


# --- no limit -------------------------------------------------------------------------------------


def test_system_without_stiffness_has_no_step_limit(sheet, isotropic):
    system = fc.System(sheet, isotropic, [fc.Gravity()])
    assert critical_dt(system, system.rest()) == np.inf == element_bound(system)


# --- forward Euler -------------------------------------------------------------------------------


def test_forward_euler_on_a_large_cloth_is_safe_and_exact_where_modes_are_shared(
    small, isotropic, monkeypatch
):
    """The same small cloth by the way of large ones, so that both can be compared."""
    for terms, shared in (
        ([fc.MassDamping(30.0)], True),
        ([fc.StrainRateDamping(5e-3), fc.MassDamping(3.0)], False),
        ([fc.StrainRateDamping(5e-3)], None),
    ):
        system = fc.System(small, isotropic, [fc.StVK(), *terms], pins=["left"])
        state = system.state(affine(small, TAUT))
        exact = critical_dt(system, state, "forward_euler")
        with monkeypatch.context() as patch:
            patch.setattr(critical_step, "MOST_DENSE_DIRECTIONS", 0)
            bound = critical_dt(system, state, "forward_euler")
        if shared is None:  # a taut sheet in any plane: its transverse modes are not damped
            assert exact == bound == 0.0
        elif shared:
            assert bound == pytest.approx(exact, rel=1e-6)
        else:
            assert 0.1 * exact < bound <= exact * (1 + 1e-6)


def test_forward_euler_without_damping_has_no_stable_step(small, isotropic):
    system = fc.System(small, isotropic, [fc.StVK()], pins=["left"])
    assert critical_dt(system, system.rest(), fc.ForwardEuler) == 0.0
    assert element_bound(system, fc.ForwardEuler) == 0.0
    damped = fc.System(small, isotropic, [fc.MassDamping(50.0)])
    assert critical_dt(damped, damped.rest(), fc.ForwardEuler) == pytest.approx(2 / 50)
    assert element_bound(damped, fc.ForwardEuler) == pytest.approx(2 / 50)


# --- estimates within a run -----------------------------------------------------------------------


@pytest.mark.parametrize("method", [fc.SymplecticEuler(), fc.CentralDifference()], ids=repr)
@pytest.mark.parametrize("eta", [0.0, 2e-4, 5e-3])
def test_an_estimate_is_within_its_tolerance(method, eta, isotropic):
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.05)
    terms = [fc.StVK(), fc.HingeBending(), *([fc.StrainRateDamping(eta)] if eta else [])]
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)
    system = fc.System(cloth, fabric, terms, pins=["left"])
    state = system.state(affine(cloth, TAUT))
    exact = critical_dt(system, state, method)
    assert 0.97 < estimate(system, state, method, tol=0.01) / exact < 1.002
    assert 0.94 < estimate(system, state, method) / exact < 1.005


def test_an_estimate_costs_few_forces_and_sees_a_stiff_corner(isotropic, monkeypatch):
    """4,100 triangles of which a few in one corner are stretched, a few less in another."""
    cloth = fc.Cloth.rectangle(2.0, 0.5, h=0.024)
    system, method = fc.System(cloth, isotropic, [fc.StVK()]), fc.CentralDifference()
    x = system.rest().x
    x[:, 1] *= 1 + 0.3 * np.exp(-(cloth.X[:, 0] ** 2) / 0.003)
    x[:, 1] *= 1 + 0.4 * np.exp(-((cloth.X[:, 0] - 2) ** 2) / 0.003)
    state = system.state(x)
    exact, plain, calls = critical_dt(system, state, method), fc.System.force, []
    monkeypatch.setattr(fc.System, "force", lambda *given: calls.append(1) or plain(*given))
    assert 0.95 < estimate(system, state, method) / exact < 1.005
    assert len(calls) < 20
