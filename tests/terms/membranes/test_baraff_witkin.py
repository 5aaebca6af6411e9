"""Baraff and Witkin's conditions: their definition, the softening of p = 1, tangents, grain."""

import numpy as np
import pytest
from conftest import rough

import fecloth as fc

TERMS = {
    "published": fc.BaraffWitkin((3e5, 2e5), 4e4, area_exponent=1.0),
    "material": fc.BaraffWitkin(),
    "stretched": fc.BaraffWitkin(rest=(0.9, 1.2)),
}


@pytest.fixture
def moving(sheet, rng):
    return rough(sheet, rng), rng.standard_normal((len(sheet.X), 3))


def conditions(triangle, rest, p, x):
    """a, and (C_u, C_v, C_s) of one triangle: w_u, w_v by eq. 9, from edges and (u, v)."""
    d1, d2 = triangle[1] - triangle[0], triangle[2] - triangle[0]
    determinant = d1[0] * d2[1] - d2[0] * d1[1]
    e1, e2 = x[1] - x[0], x[2] - x[0]
    wu = (e1 * d2[1] - e2 * d1[1]) / determinant
    wv = (-e1 * d2[0] + e2 * d1[0]) / determinant
    a = abs(determinant) / 2
    C = [np.linalg.norm(wu) - rest[0], np.linalg.norm(wv) - rest[1], wu @ wv]
    return a, a**p * np.array(C)


@pytest.mark.parametrize("name", TERMS)
def test_energy_is_its_definition(name, sheet, orthotropic, moving):
    term = TERMS[name]
    k = [*(term.stretch or orthotropic.tensile), term.shear or orthotropic.shear]
    expected = 0.0
    for triangle in sheet.triangles:
        _, C = conditions(sheet.X[triangle], term.rest, term.area_exponent, moving[0][triangle])
        expected += 0.5 * np.sum(k * C**2)
    system = fc.System(sheet, orthotropic, [term])
    energy = system.energies(system.state(moving[0]))["BaraffWitkin"]
    assert energy == pytest.approx(expected, rel=1e-12)


def test_published_tangent_lacks_the_documented_terms(sheet, orthotropic, moving):
    """exact − published = Σ k_d ∂C (∂Ċ/∂x)ᵀ, the first part of eq. 12, and nothing else.

    Its product with u is Σ_r k_d ∂C_r d/ds Ċ_r(x + s u, v) at s = 0; Ċ_r is itself a derivative
    of C_r along v, and here both come from differences of the definition.
    """
    tau, x, v = 0.02, *moving
    system = fc.System(sheet, orthotropic, [fc.BaraffWitkin(damping=tau, tangent="exact")])
    published = fc.System(sheet, orthotropic, [fc.BaraffWitkin(damping=tau)])
    state = system.state(x, v)
    kept = published.stiffness(state).toarray()
    assert abs(kept - kept.T).max() < 1e-12 * abs(kept).max()
    dropped = system.stiffness(state).toarray() - kept
    assert abs(dropped - dropped.T).max() > 0.1 * abs(dropped).max()
    assert abs(system.damping(state) - published.damping(state)).max() == 0.0

    u = np.random.default_rng(3).standard_normal(x.shape)
    k = np.array([*orthotropic.tensile, orthotropic.shear])
    expected, s, e = np.zeros_like(x), 1e-4, np.eye(9).reshape(9, 3, 3)
    for nodes in sheet.triangles:

        def C(y, nodes=nodes):
            return conditions(sheet.X[nodes], (1.0, 1.0), 0.5, y)[1]

        y, p, q = x[nodes], s * u[nodes], s * v[nodes]
        change = (C(y + p + q) - C(y + p - q) - C(y - p + q) + C(y - p - q)) / (4 * s * s)
        gradient = np.array([(C(y + s * d) - C(y - s * d)) / (2 * s) for d in e])  # (9, 3)
        expected[nodes] += (gradient @ (tau * k * change)).reshape(3, 3)
    got = (dropped @ u.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(got, expected, atol=1e-4 * abs(expected).max())


def test_refinement_softens_the_published_one():
    """p = 1: tensile stiffness k a, so a quarter on half the edge; p = ½: none of it."""
    fabric = fc.Fabric(0.2, 1000.0)
    published = fc.BaraffWitkin((3e5, 2e5), 4e4, area_exponent=1.0)
    for h in (0.1, 0.05):
        a = 0.5 * h * h
        C = fc.plane_moduli(published, fabric, "right", h)
        np.testing.assert_allclose(C, a * np.diag([3e5, 2e5, 4e4]), atol=1e-9 * a * 3e5)
    material = fc.BaraffWitkin((300.0, 200.0), 40.0)
    for h in (0.1, 0.05):
        C = fc.plane_moduli(material, fabric, "right", h)
        np.testing.assert_allclose(C, np.diag([300.0, 200.0, 40.0]), atol=1e-9 * 300)


def test_moduli_serve_strain_rate_damping(sheet, orthotropic):
    plain = fc.Fabric(0.2, (2000.0, 900.0), 0.0, 60.0)
    np.testing.assert_allclose(fc.BaraffWitkin().moduli(plain), fc.StVK().moduli(plain))
    term = fc.StrainRateDamping(0.01, law=fc.BaraffWitkin())
    assert fc.System(sheet, orthotropic, [term]).bound[0].viscosity[0, 3] == 0.0


def test_published_tangent_keeps_the_part_with_the_second_derivative(sheet, orthotropic, moving):
    """Without velocity the damping has no ∂d/∂x; with it, the published one is not zero."""
    damped = fc.System(sheet, orthotropic, [fc.BaraffWitkin(damping=0.02)])
    plain = fc.System(sheet, orthotropic, [fc.BaraffWitkin()])
    x, v = moving
    still = damped.stiffness(damped.state(x)) - plain.stiffness(plain.state(x))
    assert abs(still).max() < 1e-12 * abs(plain.stiffness(plain.state(x))).max()
    run = damped.stiffness(damped.state(x, v)) - plain.stiffness(plain.state(x))
    assert abs(run).max() > 1.0
