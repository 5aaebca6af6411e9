"""Shadows, drape coefficients and folds of known shapes."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import fecloth as fc
from studies.drape import between_meshes
from studies.drape.measures import count_folds, drape_coefficient
from studies.drape.meshes import MESHES, SPECIMEN, SUPPORT, cut_ring, make_quadratic, mesh_specimen

SHEET = fc.Cloth.read(Path(__file__).parents[2] / "meshes" / "drape.geo", h=0.005)


FLAT = np.c_[SHEET.X, np.zeros(len(SHEET.X))]


def coefficient(x):
    return drape_coefficient(SHEET.X, x, SHEET.triangles)


def shaped(radius, height):
    """Radius and height of the hanging ring as functions of (r, φ)."""
    r, angle = np.hypot(*SHEET.X.T), np.arctan2(SHEET.X[:, 1], SHEET.X[:, 0])
    out = np.where(r > SUPPORT, radius(r, angle), r)
    z = np.where(r > SUPPORT, height(r, angle), 0)
    return np.c_[out * np.cos(angle), out * np.sin(angle), z]


def test_a_board_covers_all_and_a_cone_its_part():
    assert coefficient(FLAT) == 1.0
    slope = math.radians(50)
    cone = shaped(lambda r, a: SUPPORT + (r - SUPPORT) * math.cos(slope), lambda r, a: SUPPORT - r)
    rim = SUPPORT + (SPECIMEN - SUPPORT) * math.cos(slope)
    exact = (rim**2 - SUPPORT**2) / (SPECIMEN**2 - SUPPORT**2)
    assert coefficient(cone) == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("count", [4, 7])
def test_folds_are_counted_along_the_rim(count):
    wavy = shaped(lambda r, a: r, lambda r, a: 0.01 * np.cos(count * a + 0.3))
    assert count_folds(SHEET.X, wavy) == count


# --- several meshes -------------------------------------------------------------------------------


def area(cloth):
    (ax, ay), (bx, by) = np.moveaxis(np.diff(cloth.X[cloth.triangles], axis=1), 0, -1)
    return (ax * by - ay * bx).sum() / 2


@pytest.mark.parametrize("pattern", sorted({pattern for pattern, _ in MESHES.values()}))
def test_a_mesh_covers_the_specimen_and_its_support(pattern):
    """Polygons inside circles: their edges e leave out (e/r)²/6 of the area."""
    h = 0.015
    disk = mesh_specimen(pattern, h)
    ring = cut_ring(disk)
    assert area(disk) == pytest.approx(math.pi * SPECIMEN**2, rel=(1.5 * h / SPECIMEN) ** 2 / 6)
    hangs = math.pi * (SPECIMEN**2 - SUPPORT**2)
    assert area(ring) == pytest.approx(hangs, rel=(1.5 * h / SPECIMEN) ** 2 / 6)
    radius = np.hypot(*ring.X[ring.nodes("support")].T)
    np.testing.assert_allclose(radius, SUPPORT, rtol=1e-9)
    rim = np.hypot(*ring.X.T) > SPECIMEN - 1e-9
    assert sorted(ring.nodes("boundary")) == sorted([*ring.nodes("support"), *np.flatnonzero(rim)])


def test_a_shape_is_carried_between_meshes():
    """A linear function is carried exactly but for the step in from the rim; the disk is flat."""
    old, new = cut_ring(mesh_specimen("Gmsh", 0.02)), mesh_specimen("cross", 0.015)
    x = np.c_[old.X, 0.3 * old.X[:, 0]]
    carried = between_meshes.carry(old, x, new)
    hangs = np.hypot(*new.X.T) > SUPPORT + 1e-9
    np.testing.assert_allclose(carried[hangs, :2], new.X[hangs], atol=0.01 * SPECIMEN)
    np.testing.assert_allclose(carried[hangs, 2], 0.3 * carried[hangs, 0], atol=1e-15)
    np.testing.assert_array_equal(carried[~hangs], np.c_[new.X[~hangs], 0 * new.X[~hangs, 0]])


@pytest.mark.stories
@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_ring_of_paper_sags_as_plate_theory_says(element):
    """Clamped inside, free outside, a small weight; the radial equation is solved in the test."""
    B, q = 1e-3, 0.1
    fabric = fc.Fabric(q / 9.81, 1e4, bending_rigidity=B)
    errors = []
    for h in (0.016, 0.008) if element == "P1" else (0.032, 0.016):
        ring = cut_ring(mesh_specimen("Gmsh", h))
        cloth = ring if element == "P1" else make_quadratic(ring)
        terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -9.81))]
        system = fc.System(cloth, fabric, terms, pins=[fc.Pin("support", clamp=True)])
        z = fc.equilibrium(system, system.rest(), tolerance=1e-6).x[:, 2]
        rim = np.hypot(*cloth.X.T) > SPECIMEN - 1e-9
        errors.append(abs(-z[rim].mean() / sag_of_a_plate(B, q) - 1))
    assert errors[1] < 0.02
    assert errors[0] > 3 * errors[1]


def sag_of_a_plate(B, q):
    """The rim's deflection for ν = 0: φ'' + φ'/r − φ/r² = −Q/B, φ = w', φ(b) = 0, φ'(a) = 0.

    The shear Q = q (a² − r²)/(2 r) carries what hangs outside r. φ'(b) follows by linearity.
    """
    r = np.linspace(SUPPORT, SPECIMEN, 2001)

    def march(slope):
        def rate(r, y):
            shear = q * (SPECIMEN**2 - r**2) / (2 * r)
            return np.array([y[1], y[2], -shear / B - y[2] / r + y[1] / r**2])

        y = np.array([0.0, 0.0, slope])
        for start, end in pairwise(r):  # the midpoint rule
            step = end - start
            y = y + step * rate(start + step / 2, y + step / 2 * rate(start, y))
        return y

    zero, unit = march(0.0), march(1.0)
    curvature = -zero[2] / (unit[2] - zero[2])
    return (zero + curvature * (unit - zero))[0]
