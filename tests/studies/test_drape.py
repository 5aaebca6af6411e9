"""Shadows, drape coefficients and folds of known shapes."""

import math
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError
from fecloth.output.frame_reader import Frame
from studies.drape import __main__ as drape
from studies.drape import between_meshes
from studies.drape.measures import count_folds, drape_coefficient, shadow_area
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


def test_overlapping_layers_are_counted_once():
    x = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0], [0, 0, 0.02]], float)
    square = np.array([[0, 1, 2], [1, 3, 2]])
    assert shadow_area(x, square) == pytest.approx(0.01, rel=0.02)
    assert shadow_area(x, np.vstack([square, [[4, 1, 2]]])) == shadow_area(x, square)
    assert shadow_area(x, square, 0.05) == pytest.approx(0.01 - math.pi * 0.05**2 / 4, rel=0.02)


def test_a_board_covers_all_and_a_cone_its_part():
    assert coefficient(FLAT) == 1.0
    slope = math.radians(50)
    cone = shaped(lambda r, a: SUPPORT + (r - SUPPORT) * math.cos(slope), lambda r, a: SUPPORT - r)
    rim = SUPPORT + (SPECIMEN - SUPPORT) * math.cos(slope)
    exact = (rim**2 - SUPPORT**2) / (SPECIMEN**2 - SUPPORT**2)
    assert coefficient(cone) == pytest.approx(exact, abs=0.01)


def test_shadow_ignores_a_fold_under_the_rim():
    """The ring goes out to its middle and back in below: the shadow is that of the middle."""
    middle = (SUPPORT + SPECIMEN) / 2
    tucked = shaped(lambda r, a: middle - abs(r - middle), lambda r, a: SUPPORT - r)
    exact = (middle**2 - SUPPORT**2) / (SPECIMEN**2 - SUPPORT**2)
    assert coefficient(tucked) == pytest.approx(exact, abs=0.03)


@pytest.mark.parametrize("count", [4, 7])
def test_folds_are_counted_along_the_rim(count):
    wavy = shaped(lambda r, a: r, lambda r, a: 0.01 * np.cos(count * a + 0.3))
    assert count_folds(SHEET.X, wavy) == count


@pytest.mark.stories
def test_a_missing_package_costs_only_the_picture(monkeypatch, capsys):
    """Unless --picture asks for it; then it is a mistake, found before the first run."""
    monkeypatch.setitem(sys.modules, "imageio", None)
    board = Frame(0.0, FLAT, SHEET.triangles, {"displacement": 0 * FLAT}, {})
    monkeypatch.setattr(drape, "drape_fabric", lambda *_: board)
    monkeypatch.setattr(sys, "argv", ["drape.py"])
    assert drape.main() == 0
    printed = capsys.readouterr().out
    assert printed.count("drape coefficient 100 %") == 3
    assert printed.startswith("no picture: the package imageio: is not installed")
    monkeypatch.setattr(sys, "argv", ["drape.py", "--picture", "x.png"])
    with pytest.raises(InputError, match=r"imageio: is not installed.*\.\[view\]"):
        drape.main()


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

    zero, one = march(0.0), march(1.0)
    curvature = -zero[2] / (one[2] - zero[2])
    return (zero + curvature * (one - zero))[0]


@pytest.mark.stories
def test_a_table_of_meshes(monkeypatch):
    """A row for each mesh and model; the summary has the coefficients of the rows."""
    fabrics = ("trousers",)
    monkeypatch.setattr(between_meshes, "SEEDS", (1,))
    rows = list(between_meshes.compare_meshes(fabrics, fabrics, 0.03))
    assert [row["model"] for row in rows].count("PlateBending") == len(MESHES) + 2
    assert [row["model"] for row in rows].count("HingeBending") == len(MESHES)
    assert all(0 < row["coefficient"] < 1 for row in rows)
    cells = [" ".join(line.values()) for line in between_meshes.summarise(rows)]
    assert all(f" {100 * row['coefficient']:.1f}" in " ".join(cells) for row in rows)


def test_a_spread_is_the_range_over_the_mean():
    assert between_meshes.spread([0.7, 0.8, 0.9]) == pytest.approx(0.25)
