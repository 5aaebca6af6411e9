"""Pairs of triangles of a deformed cloth that pass through each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fecloth.compiled.jit import inner, kernel

ROUND_OFF = 1e-14  # of the coordinates, in differences of which the signs are products
MOST_NEIGHBOURS, SAMPLE = 500, 500


def count_intersections(triangles: np.ndarray, x: np.ndarray) -> int | None:
    """Count the pairs that `find_intersections` finds; None where it returns None.

    Examples
    --------
    >>> x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [2, 2, 0]])
    >>> count_intersections(np.array([[0, 1, 2], [3, 4, 5]]), x)
    1
    """
    pairs = find_intersections(triangles, x)
    return None if pairs is None else len(pairs)


def find_intersections(triangles: np.ndarray, x: np.ndarray) -> np.ndarray | None:
    """Find the pairs (p, 2) of triangles that pass through each other.

    A pair intersects if an edge of one crosses the inside of the other. The five volumes of
    tetrahedra whose signs decide it must exceed the round-off of the coordinates. Hence triangles
    that touch, or overlap in a plane, do not count. Pairs with a common node do not count either.

    The candidates are the pairs whose centroids are near, from a k-d tree of SciPy for each class
    of sizes. The time is proportional to the number of triangles.

    Parameters
    ----------
    triangles
        (s, 3) nodes of each triangle, as of `Surface`.
    x
        (n, 3) positions [m].

    Returns
    -------
    array or None
        None if positions are not finite, or a triangle has more than 500 others near it on the
        average, as in a cloth that has collapsed.
    """
    x = np.ascontiguousarray(x, dtype=float)
    corners = x[triangles]
    if not np.isfinite(corners).all():
        return None
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    classes = _size_classes(radii)
    trees = [cKDTree(centres[members]) for members in classes]
    found = [np.zeros((0, 2), int)]
    for i, (mine, tree) in enumerate(zip(classes, trees, strict=True)):
        for other, another in zip(classes[: i + 1], trees, strict=False):
            reach = radii[mine].max() + radii[other].max()
            if _neighbours(tree, another, reach) > MOST_NEIGHBOURS:
                return None
            first, second = _pairs(tree, another, reach)
            one, two = mine[first], other[second]
            crosses = _crossing(one, two, triangles, x)
            found.append(np.column_stack([one[crosses], two[crosses]]))
    return np.concatenate(found)


def _size_classes(radii: np.ndarray) -> list[np.ndarray]:
    """Return the members of classes of radii that differ by a factor below 1.5, large ones last."""
    size = np.floor(np.log(np.maximum(radii, 1e-300)) / np.log(1.5))
    return [np.flatnonzero(size == one) for one in np.unique(size)]


def _neighbours(tree: cKDTree, another: cKDTree, reach: float) -> float:
    """Estimate how many points of another tree are within reach of a point of the first."""
    sample = cKDTree(tree.data[:: 1 + tree.n // SAMPLE])
    return float(sample.count_neighbors(another, reach)) / sample.n


def _pairs(tree: cKDTree, another: cKDTree, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of two trees that are within reach of each other, or pairs of one tree."""
    if tree is another:
        near = tree.query_pairs(reach, output_type="ndarray")
        return near[:, 0], near[:, 1]
    near = tree.sparse_distance_matrix(another, reach, output_type="ndarray")
    return near["i"], near["j"]


@kernel
def _crossing(first, second, triangles, x):
    """Return which of the pairs of triangles intersect."""
    found = np.zeros(len(first), np.bool_)
    for i in range(len(first)):
        a, b = triangles[first[i]], triangles[second[i]]
        if not (_share_a_node(a, b) or _are_apart(a, b, x)):
            found[i] = _crosses(a, b, x) or _crosses(b, a, x)
    return found


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
def _crosses(a, b, x):
    """Whether an edge of the triangle a crosses the inside of the triangle b."""
    span = 0.0
    for i in range(3):
        for k in range(3):
            span = max(span, abs(x[a[i], k]), abs(x[b[i], k]))
    for i in range(3):
        p, q = a[i], a[(i + 1) % 3]
        if _pierces(p, q, b, x, ROUND_OFF * span):
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
    return _side(p, q, b[1], b[2], x, error) == turn and _side(p, q, b[2], b[0], x, error) == turn


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
    limit = 4.0 * error * (u * v + v * w + w * u)
    if abs(volume) <= limit:
        return 0
    return 1 if volume > 0.0 else -1
