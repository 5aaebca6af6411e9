"""Moduli against closed forms, the conversion from a homogeneous sheet, and rejected constants."""

import dataclasses

import numpy as np
import pytest
from support.drawn import drawn

import fecloth as fc


def stiffnesses(st):
    return st.floats(1.0, 1e5)


def plane(C):
    """(3, 3) Voigt matrix of (C11, C22, C66, C12, C16, C26)."""
    C11, C22, C66, C12, C16, C26 = C
    return np.array([[C11, C12, C16], [C12, C22, C26], [C16, C26, C66]])


@drawn(lambda st: [stiffnesses(st), stiffnesses(st), stiffnesses(st), st.floats(-0.99, 0.99)])
def test_moduli_invert_the_compliance(warp, weft, shear, part):
    """ε₁ = (σ₁ − ν₁₂ σ₂ Y₁/Y₁)/Y₁ …: the compliance is [[1/Y₁, −ν/Y₁], [−ν/Y₁, 1/Y₂]] and 1/G.

    `part` is ν₁₂ as a fraction of its limit √(Y₁/Y₂).
    """
    nu = part * np.sqrt(warp / weft)
    moduli = fc.Fabric(0.2, (warp, weft), nu, shear_stiffness=shear).moduli()
    compliance = np.array([[1 / warp, -nu / warp, 0], [-nu / warp, 1 / weft, 0], [0, 0, 1 / shear]])
    scale = np.sqrt(np.diag(compliance))
    np.testing.assert_allclose(
        (plane(moduli) @ compliance) / np.outer(1 / scale, scale), np.eye(3), atol=1e-11
    )
    assert np.linalg.eigvalsh(plane(moduli) * np.outer(scale, scale))[0] > 0


def test_pair_from_one_number_is_equal_in_both_directions():
    isotropic, both = fc.Fabric(0.2, 700.0, 0.3), fc.Fabric(0.2, (700.0, 700.0), 0.3)
    assert isotropic.tensile == both.tensile == (700.0, 700.0)
    assert isotropic.shear == both.shear == pytest.approx(700 / 2.6, rel=1e-15)
    assert fc.Fabric(0.2, 700.0, 0.3, shear_stiffness=10.0).shear == 10.0
    assert fc.Fabric(0.2, 700.0, bending_rigidity=2e-5).bending == (2e-5, 2e-5)
    assert fc.Fabric(0.2, 700.0, bending_rigidity=(2e-5, 1e-5)).bending == (2e-5, 1e-5)
    assert isotropic.bending is None


def test_fabric_is_immutable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        fc.Fabric(0.2, 700.0).areal_density = 1.0


def test_sheet_closed_forms():
    """h = 2 mm rubber: Y = E h, B = E h³/(12 (1 − ν²)), ρ h; G = E h/(2 (1 + ν))."""
    fabric = fc.Fabric.sheet(E=1.2e6, nu=0.5, thickness=2e-3, rho=1100.0)
    assert fabric.areal_density == pytest.approx(2.2, rel=1e-14)
    assert fabric.tensile == pytest.approx((2400.0, 2400.0), rel=1e-14)
    assert fabric.bending == pytest.approx((1.2e6 * 8e-9 / 9, 1.2e6 * 8e-9 / 9), rel=1e-14)
    assert fabric.shear == pytest.approx(800.0, rel=1e-14)
    expected = [3200.0, 3200.0, 800.0, 1600.0, 0.0, 0.0]  # Y/(1 − ν²) = 2400/0.75
    np.testing.assert_allclose(fabric.moduli(), expected, rtol=1e-14)


def test_poisson_limit_follows_the_ratio_of_stiffness():
    """ν₁₂² < Y₁/Y₂: beyond 1 where the warp is the stiffer, below 1 where the weft is."""
    stiff_warp = fc.Fabric(0.2, (2000.0, 500.0), 1.99, shear_stiffness=60.0)
    assert np.linalg.eigvalsh(plane(stiff_warp.moduli()))[0] > 0
    fc.Fabric(0.2, (500.0, 2000.0), 0.499, shear_stiffness=60.0)


def test_constants_just_inside_their_limits_are_taken():
    for value in (2e-12, 5e11):
        assert fc.Fabric(value, value).shear == value / 2
