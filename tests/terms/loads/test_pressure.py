"""Follower pressure: its force and tangents, and the inflated circular membrane."""

import functools

import numpy as np
import pytest
import skfem
from conftest import flat, rough
from support import oracle
from support.inflated import NU, RADIUS, STIFFNESS, enclosed, shooting

import fecloth as fc
from fecloth.verify import observed_order, trial_states

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

# --- the force and its tangents -------------------------------------------------------------------


def test_force_is_the_derivative_of_the_volume(sheet, isotropic, rng):
    """At nodes away from the edge: f = p ∂V/∂x, V is cubic, so a central difference at h is exact
    but for h² ∂³V/∂h³/6 along one node, which is zero."""
    x = rough(sheet, rng)
    inner = np.setdiff1d(np.arange(len(sheet.X)), sheet.nodes("boundary"))
    force = fc.System(sheet, isotropic, [fc.Pressure(30.0)]).force(fc.State(0.0, x, 0 * x))
    for node in inner[::5]:
        for c in range(3):
            up, down = x.copy(), x.copy()
            up[node, c] += 0.1
            down[node, c] -= 0.1
            slope = 30.0 * (enclosed(sheet, up) - enclosed(sheet, down)) / 0.2
            assert force[node, c] == pytest.approx(slope, abs=1e-11)


def test_definite_tangent_is_zero(sheet, isotropic, rng):
    from fecloth.linalg.block_matrix import BlockMatrix

    system = fc.System(sheet, isotropic, [fc.Pressure(30.0)])
    J = BlockMatrix.zeros(system.pattern)
    system.assemble(J, system.state(rough(sheet, rng)), wx=1.0, definite=True)
    assert not J.values.any()


# --- given as a number, a formula, a function -----------------------------------------------------


def test_a_pressure_that_changes_in_time(sheet, isotropic):
    constant = fc.System(sheet, isotropic, [fc.Pressure(6.0)])
    expected = constant.force(constant.rest())
    for p in ("3 * t", lambda t: 3 * t):
        system = fc.System(sheet, isotropic, [fc.Pressure(p)])
        force = system.force(system.state(system.rest().x, t=2.0))
        np.testing.assert_allclose(force, expected, rtol=1e-15)


# --- the circular membrane clamped at its rim -----------------------------------------------------


@functools.cache
def inflated(p, elements, kind="symmetric"):
    """Height of the centre and enclosed volume; static, from a dome, at h = a/elements."""
    cloth = fc.Cloth.disk(RADIUS, RADIUS / elements)
    fabric = fc.Fabric(0.2, STIFFNESS, NU)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Pressure(p, kind)], pins=["boundary"])
    height, _ = shooting(p)
    x = flat(cloth)
    x[:, 2] = height * (1 - np.sum(cloth.X**2, axis=1) / RADIUS**2)
    x[cloth.nodes("boundary"), 2] = 0.0
    newton = fc.Newton(tolerance=1e-9)
    result = fc.run(
        system, fc.BackwardEuler(), system.state(x), 1e5, 1e5, solver="direct", newton=newton
    )  # one step of a day: the inertia left is ρ Δx/dt² < 1e-10 of the pressure
    x = result.state.x
    centre = (cloth.interpolator(np.zeros((1, 2))) @ x)[0, 2]
    return centre, enclosed(cloth, x), result.newton


@pytest.mark.stories
def test_membrane_at_large_deflection_agrees_with_the_exact_equations():
    height, volume = shooting(500.0)
    assert height / RADIUS > 0.4
    errors = []
    for elements in (10, 20, 40):
        centre, enclosed_, newton = inflated(500.0, elements)
        errors.append(abs(enclosed_ - volume) / volume)
        assert newton < 25
        if elements == 20:
            assert errors[-1] < 3e-3
            assert centre == pytest.approx(height, rel=5e-3)
    orders = observed_order([4, 2, 1], errors)
    np.testing.assert_allclose(orders, 2.0, atol=0.15)


def test_on_quadratic_triangles_it_is_the_form(quadratic, isotropic):
    """∫ p N_a (F₁ × F₂) dA by scikit-fem, and K's symmetric part."""
    cloth, p = quadratic, 300.0
    _, x, _ = trial_states(cloth)[0]
    basis = skfem.Basis(cloth.mesh, skfem.ElementVector(skfem.ElementTriP2(), dim=3), intorder=6)
    F = basis.interpolate(oracle.dofs(x)).grad
    n = np.cross(F[:, 0], F[:, 1], axis=0)
    form = skfem.LinearForm(lambda v, w: p * np.einsum("i...,i...", w["n"], v))
    term = fc.Pressure(p, tangent="exact")
    exact = fc.System(cloth, isotropic, [term])
    expected = form.assemble(basis, n=n)
    force = exact.force(exact.state(x)).ravel()
    np.testing.assert_allclose(force, expected, atol=1e-12 * abs(expected).max())
    K = exact.stiffness(exact.state(x)).toarray()
    half = fc.System(cloth, isotropic, [fc.Pressure(p)])
    symmetric = half.stiffness(half.state(x)).toarray()
    np.testing.assert_allclose(symmetric, (K + K.T) / 2, atol=1e-12 * abs(K).max())
    pinned = fc.System(cloth, isotropic, [term], pins=["boundary"])
    K = pinned.stiffness(pinned.state(x)).toarray()[np.ix_(pinned.free, pinned.free)]
    assert np.abs(K - K.T).max() < 1e-12 * np.abs(K).max()  # conservative where the edge is held
