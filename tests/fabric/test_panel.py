"""Grain angles and regions: bias-cut strips, two fabrics in one cloth."""

import numpy as np
import pytest
import scipy.linalg
from conftest import affine, flat
from support.oracle import fourth_order

import fecloth as fc

WOVEN = fc.Fabric(0.15, (2000.0, 900.0), 0.2, shear_stiffness=60.0)
LINING = fc.Fabric(0.4, 500.0, 0.3)
ANGLES = np.radians([0.0, 17.0, 45.0, 90.0, -30.0, 200.0])


def turn(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def rotated_moduli(fabric, angle):
    """(2, 2, 2, 2) moduli in X and Y of a fabric whose warp is at an angle to X."""
    R = turn(angle)
    return np.einsum("ai,bj,ck,dl,ijkl->abcd", R, R, R, R, fourth_order(fabric.moduli()))


@pytest.fixture(scope="module")
def strip():
    return fc.Cloth.rectangle(1.0, 0.25, h=0.08)


# --- grain ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", ANGLES)
def test_bias_cut_strip_pulls_as_the_rotated_orthotropic_law(angle, strip):
    """A strip in uniaxial tension S = T e₁⊗e₁ at E = ℂ⁻¹S stretches, contracts and shears.

    1/E₁₁ is the compliance cos⁴/Y₁ + sin⁴/Y₂ + cos² sin² (1/G − 2ν/Y₁) of Jones (1999); its ends
    pull with F S e₁ per width, its sides and its inside are free of force.
    """
    T = 100.0
    moduli = rotated_moduli(WOVEN, angle)
    pairs = ((0, 0), (1, 1), (0, 1))
    M = np.array([[moduli[a, b, c, d] * (1 + (c != d)) for c, d in pairs] for a, b in pairs])
    E11, E22, E12 = np.linalg.solve(M, [T, 0.0, 0.0])
    c, s = np.cos(angle), np.sin(angle)
    warp, weft, G, nu = 2000.0, 900.0, 60.0, 0.2
    compliance = c**4 / warp + s**4 / weft + c**2 * s**2 * (1 / G - 2 * nu / warp)
    assert pytest.approx(T * compliance, rel=1e-12) == E11

    F = np.vstack([scipy.linalg.sqrtm(np.eye(2) + 2 * np.array([[E11, E12], [E12, E22]])), [0, 0]])
    x = affine(strip, np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0] @ F)
    F = np.linalg.lstsq(strip.X - strip.X.mean(0), x - x.mean(0), rcond=None)[0].T
    system = fc.System(strip, WOVEN, [fc.StVK()], grain=angle)
    force = system.force(system.state(x))
    pull = T * 0.25 * F[:, 0]
    right, left = strip.nodes("right"), strip.nodes("left")
    np.testing.assert_allclose(-force[right].sum(axis=0), pull, atol=1e-10 * T)
    np.testing.assert_allclose(force[left].sum(axis=0), pull, atol=1e-10 * T)
    rest = np.setdiff1d(np.arange(len(x)), np.union1d(left, right))
    assert abs(force[rest]).max() < 1e-10 * T


@pytest.mark.parametrize("angle", ANGLES)
def test_frames_show_strain_and_stress_along_warp_and_weft(angle, strip):
    """A thread along the warp: E11 is its strain; S = ℂ:E holds between the two arrays."""
    F = np.array([[1.3, 0.2], [0.1, 0.9], [0.0, 0.2]])
    system = fc.System(strip, WOVEN, [fc.StVK()], grain=angle)
    _, cells = fc.fields(system, system.state(affine(strip, F)))
    R = turn(angle)
    E = 0.5 * (R.T @ F.T @ F @ R - np.eye(2))
    expected = np.tile([E[0, 0], E[1, 1], E[0, 1]], (len(strip.triangles), 1))
    strain = np.column_stack([cells[name] for name in ("E11", "E22", "E12")])
    np.testing.assert_allclose(strain, expected, atol=1e-13)
    warp = F @ R[:, 0]
    np.testing.assert_allclose(cells["warp"][0], warp, atol=1e-6)
    assert strain[0, 0] == pytest.approx((warp @ warp - 1) / 2, rel=1e-12)
    C11, C22, C66, C12, _, _ = WOVEN.moduli()
    S = [C11 * E[0, 0] + C12 * E[1, 1], C12 * E[0, 0] + C22 * E[1, 1], 2 * C66 * E[0, 1]]
    np.testing.assert_allclose([cells[name][0] for name in ("S11", "S22", "S12")], S, rtol=1e-11)
    stretches = np.linalg.svd(F, compute_uv=False)[::-1]
    np.testing.assert_allclose(cells["principal_stretches"][0], stretches, rtol=1e-12)


# --- regions --------------------------------------------------------------------------------------


def halves(h=0.1):
    """[0, 1] × [0, 0.5]: region "body" for X < 0.6, "hem" beyond."""
    grid = fc.Cloth.rectangle(1.0, 0.5, h=h, pattern="right")
    right = grid.X[grid.triangles].mean(axis=1)[:, 0] > 0.6
    regions = {"body": np.flatnonzero(~right), "hem": np.flatnonzero(right)}
    return fc.Cloth.from_arrays(grid.X, grid.triangles, regions=regions)


def test_two_fabrics_pull_each_with_its_own_law_and_jump_at_the_seam():
    cloth = halves()
    F = np.array([[1.2, 0.1], [0.0, 1.1], [0.3, 0.0]])
    E = 0.5 * (F.T @ F - np.eye(2))
    grain = {"body": 0.4, "hem": 0.0}
    fabric = {"hem": LINING, "body": WOVEN}
    system = fc.System(cloth, fabric, [fc.StVK()], grain=grain)
    P_body, P_hem = (
        F @ np.einsum("abcd,cd->ab", rotated_moduli(f, g), E)
        for f, g in ((WOVEN, 0.4), (LINING, 0))
    )
    force = system.force(system.state(affine(cloth, F)))
    X, Y = cloth.X.T
    scale = abs(P_body).max()
    inside = (Y > 1e-9) & (Y < 0.5 - 1e-9)
    for where, resultant in (
        (X < 1e-9, 0.5 * P_body[:, 0]),
        (abs(X - 0.6) < 1e-9, None),
        (X > 1 - 1e-9, -0.5 * P_hem[:, 0]),
    ):
        # the corners carry also half an edge of the sides below and above, which cancel
        total = force[where].sum(axis=0)
        if resultant is None:
            resultant = 0.5 * (P_hem[:, 0] - P_body[:, 0])
        np.testing.assert_allclose(total, resultant, atol=1e-11 * scale)
    elsewhere = inside & (X > 1e-9) & (X < 1 - 1e-9) & (abs(X - 0.6) > 1e-9)
    assert abs(force[elsewhere]).max() < 1e-11 * scale


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_mass_and_weight_of_two_densities(mass):
    cloth = halves()
    fabrics = {"body": WOVEN, "hem": LINING}
    system = fc.System(cloth, fabrics, [fc.Gravity((0, 0, -10.0))], mass=mass)
    total = 0.15 * 0.3 + 0.4 * 0.2
    assert system.scalar_mass.sum() == pytest.approx(total, rel=1e-13)
    assert system.nodal_mass.sum() == pytest.approx(total, rel=1e-13)
    weight = system.force(system.rest())
    np.testing.assert_allclose(weight.sum(axis=0), [0, 0, -10 * total], atol=1e-13)
    middle = (0.15 * 0.3 * 0.3 + 0.4 * 0.2 * 0.8) / total  # centre of mass
    assert weight[:, 2] @ cloth.X[:, 0] / weight[:, 2].sum() == pytest.approx(middle, rel=1e-12)
    ones = system.state(flat(cloth), np.ones((len(cloth.X), 3)))
    assert system.energies(ones)["kinetic"] == pytest.approx(1.5 * total, rel=1e-13)
