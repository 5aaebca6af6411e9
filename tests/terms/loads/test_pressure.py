"""Follower pressure: its force and tangents, and the inflated circular membrane."""

import functools

import numpy as np
import pytest
import skfem
from conftest import rough
from scipy.integrate import quad
from scipy.optimize import brentq
from support import oracle
from support.inflated import NU, RADIUS, STIFFNESS, enclosed, shooting

import fecloth as fc
from fecloth.verify import observed_order, trial_states


def hencky(p):
    """Centre deflection and enclosed volume by Hencky's series (small slopes).

    Hencky (1915), Z. Math. Phys. 63, 311–317. With N = ∛(Y p² a²)/4 · n(ρ) the balance and the
    compatibility give n² (3 n′ + ρ n″) = −8 ρ, solved by n = Σ c_k ρ^2k; the rim's u = 0 is
    (1 − ν) n + n′ = 0 at ρ = 1, which fixes c₀; and w′ = −p r/(2 N).
    """

    def series(c0, terms=40):
        c = [c0]  # Σ over k of (n²)_{m−k} · 2(k+1)(2k+4) c_{k+1} is −8 for m = 0, else 0
        for m in range(terms):
            known = 0.0
            for k in range(m):
                square = sum(c[i] * c[m - k - i] for i in range(m - k + 1))
                known += square * 4 * (k + 1) * (k + 2) * c[k + 1]
            c.append(((-8.0 if m == 0 else 0.0) - known) / (c0**2 * 4 * (m + 1) * (m + 2)))
        return np.polynomial.Polynomial(np.array(c))  # in ρ²

    def rim(c0):
        n = series(c0)
        return (1 - NU) * n(1.0) + 2 * n.deriv()(1.0)

    n = series(c0 := brentq(rim, 1.5, 2.5, xtol=1e-14))
    assert c0 == pytest.approx(1.7244, abs=1e-4)  # the value known for ν = 0.3
    slope = 2 * p * RADIUS / np.cbrt(STIFFNESS * p**2 * RADIUS**2)
    height = RADIUS * slope * quad(lambda s: s / n(s * s), 0, 1)[0]
    volume = np.pi * RADIUS**3 * slope * quad(lambda s: s**3 / n(s * s), 0, 1)[0]
    return height, volume


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
    """Height of the centre, enclosed volume and iterations; from flat, at h = a/elements."""
    cloth = fc.Cloth.disk(RADIUS, RADIUS / elements)
    fabric = fc.Fabric(0.2, STIFFNESS, NU)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Pressure(p, kind)], pins=["boundary"])
    end = fc.equilibrium(system, system.rest())
    centre = (cloth.interpolator(np.zeros((1, 2))) @ end.x)[0, 2]
    return centre, enclosed(cloth, end.x), end.iterations


@pytest.mark.stories
def test_membrane_at_large_deflection_agrees_with_the_exact_equations():
    height, volume = shooting(500.0)
    assert height / RADIUS > 0.4
    errors = []
    for elements in (10, 20, 40):
        centre, enclosed_, newton = inflated(500.0, elements)
        errors.append(abs(enclosed_ - volume) / volume)
        assert newton < 30
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


def test_work_of_a_constant_pressure_is_p_times_the_volume(isotropic):
    """On a pinned rim the work is p ΔV; the midpoint sum has an error of third order."""
    cloth = fc.Cloth.disk(RADIUS, h=0.25)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Pressure(50.0)], pins=["boundary"])
    newton = fc.Newton(tolerance=1e-11)
    missing = []
    for dt in (1e-3, 5e-4):
        result = fc.run(
            system, fc.ImplicitMidpoint(), system.rest(), dt, 0.04, solver="direct", newton=newton
        )
        work = result.energies["work:Pressure"][-1]
        expected = 50.0 * enclosed(cloth, result.state.x)
        assert work == pytest.approx(expected, rel=1e-3)
        missing.append(abs(work - expected))
        assert abs(result.energies["remainder"]).max() < 0.02 * work
    assert missing[1] < missing[0] / 3


@pytest.mark.stories
def test_reference_agrees_with_hencky_at_small_slopes():
    """Two independent solutions differ by the square of the slope, that is by p^(2/3)."""
    gaps = []
    for p in (2.0, 0.25, 0.25 / 8):
        exact, series = shooting(p), hencky(p)
        gaps.append([abs(a - b) / b for a, b in zip(exact, series, strict=True)])
    assert np.max(gaps) < 4e-3
    np.testing.assert_allclose(np.divide(gaps[1:], gaps[:-1]), 0.25, rtol=0.02)


def test_membrane_at_small_slopes_agrees_with_hencky():
    height, volume = hencky(0.25)
    assert 0.02 < height / RADIUS < 0.05
    centre, enclosed_, _ = inflated(0.25, 20)
    assert centre == pytest.approx(height, rel=5e-3)
    assert enclosed_ == pytest.approx(volume, rel=3e-3)


def test_both_tangents_converge_to_the_same_membrane_equally_fast():
    one, other = inflated(500.0, 10), inflated(500.0, 10, "exact")
    assert one[:2] == pytest.approx(other[:2], rel=1e-6)
    assert abs(one[2] - other[2]) <= 2
