"""Pairs of triangles of a deformed cloth that pass through each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fecloth.jit import inner, kernel
from fecloth.mesh.cloth import Cloth

_QUADRATIC = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]  # in VTK's order of `Cloth.cells`
ROUND_OFF = 1e-13  # of the coordinates, in the volumes whose signs decide


def surface(cloth: Cloth) -> np.ndarray:
    """(s, 3) nodes of flat triangles: those of P1, four of each quadratic one of P2."""
    if cloth.element == "P1":
        return cloth.triangles
    return cloth.cells[:, _QUADRATIC].reshape(-1, 3)


def count_intersections(triangles: np.ndarray, x: np.ndarray) -> int:
    """Count the pairs of triangles that pass through each other.

    A pair intersects if an edge of one crosses the inside of the other. The five volumes of
    tetrahedra whose signs decide it must exceed the round-off of the coordinates. Hence triangles
    that touch, or overlap in a plane, do not count. Pairs with a common node do not count either.

    Source: the signs of the volumes as in Segura and Feito (2001), Algorithms to test
    ray–triangle intersection: comparative study, WSCG 2001, 76–81.

    Parameters
    ----------
    triangles
        (s, 3) nodes of each triangle, as of `surface`.
    x
        (n, 3) positions [m].

    Examples
    --------
    >>> x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 2, 0]])
    >>> count_intersections(np.array([[0, 1, 2], [3, 4, 5]]), x)
    1
    """
    corners = x[triangles]
    if not np.isfinite(corners).all():
        return 0
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    size = np.floor(2 * np.log2(radii, where=radii > 0, out=np.full(len(radii), -1000.0)))
    groups = [(np.flatnonzero(size == one)) for one in np.unique(size)]
    trees = [cKDTree(centres[group]) for group in groups]
    total = 0
    for i, (group, tree) in enumerate(zip(groups, trees, strict=True)):
        near = tree.query_pairs(2 * radii[group].max(), output_type="ndarray")
        total += _count(group[near[:, 0]], group[near[:, 1]], triangles, x, ROUND_OFF)
        for other, another in zip(groups[:i], trees[:i], strict=True):
            reach = radii[group].max() + radii[other].max()
            pairs = tree.sparse_distance_matrix(another, reach, output_type="ndarray")
            total += _count(group[pairs["i"]], other[pairs["j"]], triangles, x, ROUND_OFF)
    return total


@kernel
def _count(first, second, triangles, x, round_off):
    """Count the candidates that intersect."""
    total = 0
    for n in range(len(first)):
        a, b = triangles[first[n]], triangles[second[n]]
        if not (_share_a_node(a, b) or _are_apart(a, b, x)):
            total += _crosses(a, b, x, round_off) or _crosses(b, a, x, round_off)
    return total


@inner
def _share_a_node(a, b):
    for i in range(3):
        for j in range(3):
            if a[i] == b[j]:
                return True
    return False


@inner
def _are_apart(a, b, x):
    """Whether the boxes around two triangles are apart."""
    for k in range(3):
        p, q, r = x[a[0], k], x[a[1], k], x[a[2], k]
        u, v, w = x[b[0], k], x[b[1], k], x[b[2], k]
        if max(p, q, r) < min(u, v, w) or max(u, v, w) < min(p, q, r):
            return True
    return False


@inner
def _crosses(a, b, x, round_off):
    """Whether an edge of the triangle a crosses the inside of the triangle b."""
    span = 0.0
    for i in range(3):
        for k in range(3):
            span = max(span, abs(x[a[i], k]), abs(x[b[i], k]))
    for i in range(3):
        p, q = a[i], a[(i + 1) % 3]
        if _pierces(p, q, b, x, round_off * span):
            return True
    return False


@inner
def _pierces(p, q, b, x, error):
    """Whether the edge from node p to node q crosses the inside of the triangle b."""
    below = _side(b[0], b[1], b[2], p, x, error)
    if below == 0 or _side(b[0], b[1], b[2], q, x, error) != -below:
        return False
    turn = _side(p, q, b[0], b[1], x, error)
    if turn == 0:
        return False
    return (
        _side(p, q, b[1], b[2], x, error) == turn and _side(p, q, b[2], b[0], x, error) == turn
    )


@inner
def _side(a, b, c, d, x, error):
    """Sign of the volume (b − a) × (c − a) · (d − a), 0 within the round-off of the positions."""
    u1, u2, u3 = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    v1, v2, v3 = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    w1, w2, w3 = x[d, 0] - x[a, 0], x[d, 1] - x[a, 1], x[d, 2] - x[a, 2]
    n1, n2, n3 = u2 * v3 - u3 * v2, u3 * v1 - u1 * v3, u1 * v2 - u2 * v1
    volume = n1 * w1 + n2 * w2 + n3 * w3
    u = max(abs(u1), abs(u2), abs(u3))
    v = max(abs(v1), abs(v2), abs(v3))
    w = max(abs(w1), abs(w2), abs(w3))
    limit = 30.0 * error * (u * v + v * w + w * u)
    if abs(volume) <= limit:
        return 0
    return 1 if volume > 0.0 else -1
