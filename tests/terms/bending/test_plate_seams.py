"""Seams between two fabrics: what goes through them, and exact solutions."""

import numpy as np
import pytest
from support.plates import BENDING, deflection, plate

import fecloth as fc
from fecloth.mesh.edge_slopes import continue_curvature

SOFT = fc.Fabric(**BENDING, bending_poisson_ratio=0.4)
STIFF = fc.Fabric(1.0, 1e3, bending_rigidity=(12.0, 5.0), bending_poisson_ratio=-0.2)


def tensor(curvature):
    """(2, 2) of (κ₁₁, κ₂₂, 2κ₁₂)."""
    k11, k22, twice = curvature
    return np.array([[k11, twice / 2], [twice / 2, k22]])


def moment(rigidity, curvature):
    """(2, 2) M = D κ."""
    m11, m22, m12 = rigidity @ curvature
    return np.array([[m11, m12], [m12, m22]])


@pytest.mark.parametrize("degrees", [0, 20, 90, 135, 250])
def test_the_moment_across_a_seam_is_equal_on_both_sides(degrees, rng):
    """So are the curvature along the seam and the twist."""
    angle = np.radians(degrees)
    t, n = np.array([np.cos(angle), np.sin(angle)]), np.array([np.sin(angle), -np.cos(angle)])
    a, b = SOFT.plate(), STIFF.plate()
    T = continue_curvature(0.3 * t[None], a[None], b[None])[0]
    for here in rng.normal(size=(5, 3)):
        there = T @ here
        for p in (t, n):
            assert p @ tensor(there) @ t == pytest.approx(p @ tensor(here) @ t, abs=1e-13)
        assert n @ moment(b, there) @ n == pytest.approx(n @ moment(a, here) @ n, rel=1e-12)
        assert n @ tensor(there) @ n != pytest.approx(n @ tensor(here) @ n, rel=1e-3)


def halves(pattern, n):
    """The unit square of two fabrics that meet at X = ½, along edges."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / n, pattern)
    X, T = cloth.X, cloth.triangles
    if pattern == "unstructured":  # a half and its mirror image
        half = fc.Cloth.rectangle(0.5, 1.0, 1 / n, pattern)
        seam = np.abs(half.X[:, 0] - 0.5) < 1e-9
        image = np.where(seam, np.arange(len(seam)), len(seam) - 1 + np.cumsum(~seam))
        X = np.vstack([half.X, ([1.0, 0.0] + [-1.0, 1.0] * half.X)[~seam]])
        T = np.vstack([half.triangles, image[half.triangles][:, ::-1]])
    left = X[T].mean(axis=1)[:, 0] < 0.5
    parts = {"soft": np.flatnonzero(left), "stiff": np.flatnonzero(~left)}
    return fc.Cloth.from_arrays(X, T, regions=parts)


@pytest.mark.parametrize("pattern", ["right", "unstructured"])
@pytest.mark.parametrize("curvature", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.3, -0.5, 0.8)])
def test_constant_moments_on_two_fabrics_are_a_solution(pattern, curvature):
    """The patch test over a seam: held in a band, the free nodes inside lie on it too."""
    n = 14
    cloth = halves(pattern, n)
    X, past = cloth.X, cloth.X[:, 0] - 0.5
    T = continue_curvature(np.array([[0.0, 1.0]]), SOFT.plate()[None], STIFF.plate()[None])[0]
    left, right = np.array(curvature, float), T @ curvature
    k11 = np.where(past < 0, left[0], right[0])
    exact = 0.5 * k11 * past**2 + 0.5 * left[1] * X[:, 1] ** 2 + 0.5 * left[2] * past * X[:, 1]
    held = ((4.2 / n > X) | (1 - 4.2 / n < X)).any(axis=1)
    free = np.abs(past[~held])
    assert free.min() < 1e-9 < 1 / n < free.max()
    system = plate(cloth, {"soft": SOFT, "stiff": STIFF})
    w = deflection(system, np.zeros(len(X)), held, exact)
    assert abs(w - exact).max() < 1e-10 / n**2
