"""Triangles that intersect, against rational numbers and another formula; those turned over."""

from fractions import Fraction

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.mesh.surface import Surface, count_intersections

FLAT = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
PAIRS = {  # the corners of the second triangle, and whether it passes through FLAT
    "through": ([(0.2, 0.2, -1), (0.2, 0.2, 1), (2, 2, 0)], True),
    "an edge of FLAT through it": ([(0.5, -1, -1), (0.5, -1, 1), (0.5, 3, 0)], True),
    "beside": ([(0.8, 0.8, -1), (0.8, 0.8, 1), (2, 2, 0)], False),
    "above": ([(0.2, 0.2, 1e-9), (0.2, 0.3, 1), (2, 2, 1)], False),
    "touches by a corner": ([(0.2, 0.2, 0), (0.2, 0.3, 1), (2, 2, 1)], False),
    "touches by an edge": ([(0.2, 0.2, 0), (0.2, 0.3, 0), (2, 2, 1)], False),
    "in the plane, upon it": ([(0.1, 0.1, 0), (0.5, 0.1, 0), (0.1, 0.5, 0)], False),
    "in the plane, across its edge": ([(0.5, -1, 0), (0.6, -1, 0), (0.5, 2, 0)], False),
    "the same": (FLAT, False),
    "of no area": ([(0.2, 0.2, 0.5)] * 3, False),
    "a needle through it": ([(0.2, 0.2, -1), (0.2, 0.2, 1), (0.2, 0.2, 1)], True),
}


def turned(x, seed=5, shift=3.0):
    """The points in another frame, so that no coordinate is zero."""
    turn, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return np.asarray(x, dtype=float) @ turn + shift


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("frame", [lambda x: x, turned])
def test_two_triangles(name, frame):
    corners, crosses = PAIRS[name]
    x = frame(np.array([*FLAT, *corners], dtype=float))
    for nodes in ([0, 1, 2, 3, 4, 5], [4, 5, 3, 2, 0, 1]):
        assert count_intersections(np.reshape(nodes, (2, 3)), x) == crosses


def test_a_common_node_excludes_a_pair():
    x = np.array([*FLAT, (0.2, 0.2, -1), (0.2, 0.2, 1)])
    assert count_intersections(np.array([[0, 1, 2], [3, 4, 0]]), x) == 0


# --- many triangles, by brute force -------------------------------------------------------------


def crosses_exactly(a, b):
    """Whether an edge of a crosses the inside of b: the point in the plane, and its shares."""
    p0, p1, p2 = b
    u, v = p1 - p0, p2 - p0
    n = np.cross(u, v)
    for p, q in ((a[0], a[1]), (a[1], a[2]), (a[2], a[0])):
        below, above = n @ (p - p0), n @ (q - p0)
        if below * above >= 0:
            continue
        w = p + (q - p) * (below / (below - above)) - p0
        s, t = np.cross(w, v) @ n / (n @ n), np.cross(u, w) @ n / (n @ n)
        if s > 0 and t > 0 and s + t < 1:
            return True
    return False


def count_exactly(triangles, x, part=None):
    """All pairs without a common node, in rational numbers; with `part` those of two parts only."""
    exact = np.array([[Fraction(float(c)) for c in row] for row in x], dtype=object)
    corners, least, most = exact[triangles], x[triangles].min(axis=1), x[triangles].max(axis=1)
    meet = ((least[:, None] <= most) & (least <= most[:, None])).all(axis=2)  # boxes
    common = (triangles[:, None, :, None] == triangles[None, :, None, :]).any(axis=(2, 3))
    other = True if part is None else part[:, None] != part
    return sum(
        crosses_exactly(corners[i], corners[j]) or crosses_exactly(corners[j], corners[i])
        for i, j in np.argwhere(np.triu(meet & ~common & other))
    )


def soup(count, sizes, seed):
    """Triangles of several sizes in a box, without common nodes."""
    rng = np.random.default_rng(seed)
    centres = rng.uniform(-1, 1, (count, 1, 3))
    corners = centres + rng.choice(sizes, (count, 1, 1)) * rng.standard_normal((count, 3, 3))
    return np.arange(3 * count).reshape(-1, 3), corners.reshape(-1, 3)


@pytest.mark.parametrize("sizes", [(0.3,), (0.05, 0.2, 0.8)])
def test_triangles_at_random(sizes):
    triangles, x = soup(40, sizes, seed=2)
    expected = count_exactly(triangles, x)
    assert expected > 5
    assert count_intersections(triangles, x) == expected


def folded(cloth, angle):
    """A sheet folded along X = 0.5, and a wave in one half that reaches through the other."""
    X, Y = cloth.X.T
    beyond = np.maximum(X - 0.5, 0.0)
    z = np.sin(angle) * beyond + 0.04 * np.sin(9 * X) * np.sin(7 * Y) * (X < 0.5)
    return np.column_stack([np.minimum(X, 0.5) + np.cos(angle) * beyond, Y, z])


@pytest.mark.parametrize("shift", [0.0, 1e4])
def test_flat_sheets_anywhere_do_not_intersect(shift):
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.03)
    x = flat(cloth)
    for seed in range(5):
        assert Surface.from_cloth(cloth).count_intersections(turned(x, seed, shift)) == 0


def test_value_of_positions_that_are_not_finite_is_none():
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    x = flat(cloth)
    assert Surface.from_cloth(cloth).count_intersections(np.where(x == 1.0, np.nan, x)) is None


# --- triangles turned over ------------------------------------------------------------------------


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_triangles_turned_over_in_a_plane_are_those_of_negative_area(element):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="cross", element=element)
    surface = Surface.from_cloth(cloth)
    x = flat(cloth)
    assert surface.count_inverted(turned(x)) == 0
    side = 0.25 if element == "P1" else 0.125
    for centre in ((0.375, 0.375), (0.625, 0.875)):
        node = int(np.argmin(np.linalg.norm(cloth.X - centre, axis=1)))
        x[node, 0] += 0.6 * side
    a, b, c = x[surface.triangles][:, :, :2].transpose(1, 0, 2)
    areas = np.linalg.det(np.stack([b - a, c - a], axis=1))
    assert (areas < 0).sum() == 2
    assert surface.count_inverted(turned(x)) == 2


def test_a_fold_turns_no_triangle_over():
    cloth = fc.Cloth.rectangle(1.0, 0.4, h=0.1, pattern="right")
    assert Surface.from_cloth(cloth).count_inverted(folded(cloth, 3.0)) == 0
