"""A deformed cloth as flat triangles: what is turned over, what intersects, what is enclosed."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fecloth.mesh.cloth import Cloth
from fecloth.mesh.elements import ELEMENTS
from fecloth.mesh.sewn_cloth import NO_PAIRS, SewnCloth

# Rounding error of the difference of two coordinates, over the larger of them: some units in the
# last place, 2.2e-16.
COORDINATE_ERROR = 1e-14
MOST_NEIGHBOURS = 500  # on the average; a regular sheet has 17, and its pairs fit into memory
SAMPLE_SIZE = 500  # triangles for this average: all would take a third of the time of a search


def count_intersections(triangles: np.ndarray, x: np.ndarray) -> int | None:
    """Count the pairs that `find_intersections` finds; None where it returns None."""
    pairs = find_intersections(triangles, x)
    if pairs is None:
        return None
    return len(pairs)


def find_intersections(triangles: np.ndarray, x: np.ndarray) -> np.ndarray | None:
    """Return the pairs (p, 2) of triangles (s, 3) that pass through each other.

    A pair intersects if an edge of one triangle crosses the inside of the other. Five volumes of
    tetrahedra must then exceed the round-off of the coordinates. So triangles that touch, or
    overlap in a plane, do not count. Pairs with a common node do not count, either. The time is
    proportional to the number of triangles.

    Returns None if positions x (n, 3) are not finite, or a triangle has more than 500 others
    near it on the average, as in a cloth that has collapsed.
    """
    x = np.ascontiguousarray(x, dtype=float)
    corners = x[triangles]
    if not np.isfinite(corners).all():
        return None
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    # Classes of radii that differ by a factor below 1.5, large ones last. The search below uses
    # the largest radius of a class; so one large triangle does not widen it for the small ones.
    size = np.floor(np.log(np.maximum(radii, 1e-300)) / np.log(1.5))
    classes = [np.flatnonzero(size == exponent) for exponent in np.unique(size)]
    trees = [cKDTree(centres[members]) for members in classes]
    intersecting = [np.zeros((0, 2), int)]
    for i, (members, tree) in enumerate(zip(classes, trees, strict=True)):
        # Each pair of classes once, and each class with itself.
        for others, other_tree in zip(classes[: i + 1], trees, strict=False):
            reach = radii[members].max() + radii[others].max()
            if _mean_neighbours(tree, other_tree, reach) > MOST_NEIGHBOURS:
                return None
            left, right = _pairs(tree, other_tree, reach)
            first, second = _overlapping(triangles, corners, members[left], others[right])
            a = corners[first]
            b = corners[second]
            crosses = _crosses(a, b) | _crosses(b, a)
            intersecting.append(np.column_stack([first[crosses], second[crosses]]))
    return np.concatenate(intersecting)


def _mean_neighbours(tree: cKDTree, another: cKDTree, reach: float) -> float:
    """Estimate how many points of another tree are within reach of a point of the first tree."""
    sample = cKDTree(tree.data[:: 1 + tree.n // SAMPLE_SIZE])
    return float(sample.count_neighbors(another, reach)) / sample.n


def _pairs(tree: cKDTree, another: cKDTree, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of points within reach: one point of each tree, or two of the same tree."""
    if tree is another:
        pairs = tree.query_pairs(reach, output_type="ndarray")
        return pairs[:, 0], pairs[:, 1]
    pairs = tree.sparse_distance_matrix(another, reach, output_type="ndarray")
    return pairs["i"], pairs["j"]


def _overlapping(
    triangles: np.ndarray, corners: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return those of the pairs that have no common node and whose boxes overlap.

    `first` and `second` (p,) are the triangles of the pairs; boxes that only touch do not
    overlap. `triangles` (s, 3) are node indices, and `corners` (s, 3, 3) their positions.
    """
    low = corners.min(axis=1).T
    high = corners.max(axis=1).T
    for a, b in zip(low, high, strict=True):
        near = (a[first] < b[second]) & (a[second] < b[first])
        first = first[near]
        second = second[near]
    for i, j in np.ndindex(3, 3):
        differ = triangles[first, i] != triangles[second, j]
        first = first[differ]
        second = second[differ]
    return first, second


def _crosses(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return whether (p,) an edge of each triangle a (p, 3, 3) crosses the inside of triangle b.

    Both are positions of corners. What may be round-off counts as no crossing.
    """
    error = COORDINATE_ERROR * np.maximum(abs(a).max(axis=(1, 2)), abs(b).max(axis=(1, 2)))
    # The edges of a whose ends lie on different sides of the plane of b: from p to q.
    side = _side(b[:, :1], b[:, 1:2], b[:, 2:], a, error[:, None])
    pair, edge = np.nonzero(side * np.roll(side, -1, axis=1) < 0)
    p = a[pair, edge]
    q = a[pair, (edge + 1) % 3]
    b = b[pair]
    error = error[pair]
    # The line p q passes inside b if it passes all three edges of b on the same side.
    turns = [_side(p, q, b[:, i], b[:, (i + 1) % 3], error) for i in range(3)]
    result = np.zeros(len(a), bool)
    result[pair[np.abs(sum(turns)) == 3]] = True
    return result


def _side(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray, error: np.ndarray
) -> np.ndarray:
    """Signs of (b − a) × (c − a) · (d − a), 0 within the round-off of the positions (…, 3)."""
    u = b - a
    v = c - a
    w = d - a
    volume = (np.cross(u, v) * w).sum(axis=-1)
    u, v, w = (abs(side).max(axis=-1) for side in (u, v, w))
    return np.where(abs(volume) <= 4.0 * error * (u * v + v * w + w * u), 0.0, np.sign(volume))


@dataclass(frozen=True, eq=False)
class Surface:
    """Flat triangles between the nodes of a cloth: the triangles of P1, or four for each of P2.

    Attributes
    ----------
    triangles
        (s, 3) nodes.
    sides
        (h, 2) the two triangles at each interior edge.
    meeting
        (p, 2) nodes that meet at seams, see `SewnCloth`.
    """

    triangles: np.ndarray
    sides: np.ndarray
    meeting: np.ndarray = field(default_factory=lambda: NO_PAIRS)

    @classmethod
    def from_cloth(cls, cloth: Cloth) -> Self:
        """Return the surface of a cloth."""
        meeting = cloth.meeting if isinstance(cloth, SewnCloth) else NO_PAIRS
        if cloth.element == "P1":
            return cls(cloth.triangles, cloth.hinges.sides, meeting)
        edges = cloth.edge_slopes.edges
        return cls(edges.triangles, edges.hinges.sides, meeting)

    def node_areas(self, X: np.ndarray) -> np.ndarray:
        """(n,) a third of the areas of the triangles of each node, at X (n, 2) [m²]."""
        a, b, c = X[self.triangles].transpose(1, 0, 2)
        third = abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 6
        return np.bincount(self.triangles.ravel(), np.repeat(third, 3), len(X))

    def count_inverted(self, x: np.ndarray) -> int:
        """Count the triangles that are turned over against all their neighbours, at least two.

        x (n, 3) are positions [m]. At a fold one neighbour lies on the other side; a triangle
        with all of them there has been pushed through the cloth.
        """
        a, b, c = x[self.triangles].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        first, second = self.sides.T
        opposed = np.einsum("hi,hi->h", normals[first], normals[second]) < 0
        size = len(self.triangles)
        opposed_neighbours = np.bincount(self.sides[opposed].ravel(), minlength=size)
        neighbours = np.bincount(self.sides.ravel(), minlength=size)
        is_inverted = (opposed_neighbours == neighbours) & (neighbours > 1)
        return int(is_inverted.sum())

    def count_intersections(self, x: np.ndarray) -> int | None:
        """Count the pairs of triangles that intersect, see `find_intersections`.

        Pairs with nodes that meet at a seam do not count, as those with a common node: between
        the nodes of edges that do not match, they may overlap a little.
        """
        pairs = find_intersections(self.triangles, x)
        if pairs is None:
            return None
        n = len(x)
        meeting = np.concatenate([self.meeting @ (n, 1), self.meeting @ (1, n)])
        # (p, 3, 1) and (p, 1, 3): all pairs of a corner of one triangle and one of the other
        first, second = self.triangles.astype(np.int64)[pairs.T]
        at_seam = np.isin(first[:, :, None] * n + second[:, None], meeting).any(axis=(1, 2))
        return int(np.count_nonzero(~at_seam))


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A surface of triangles and a cap over each of its rims: what is needed for its volume.

    A cap has the triangles between the edges of a rim and the mean of its nodes. So the volume
    of a dome is the volume between the dome and the plane of its rim.

    Attributes
    ----------
    triangles
        (m, k) nodes of P1 or P2, in the order of `Cloth.cells`.
    rim
        (r, 2) edges that have a triangle on one side only, in the direction of that triangle;
        for P2 (r, 3), with the midpoints in the last column.
    centre
        (rims, n) matrix from nodal positions to the mean of each rim.
    part
        (r,) index of the rim of each edge.
    """

    triangles: np.ndarray
    rim: np.ndarray
    centre: sparse.csr_matrix
    part: np.ndarray

    @classmethod
    def from_triangles(cls, triangles: np.ndarray, nodes: int) -> Self:
        """Find the rims of triangles (m, 3), or P2 (m, 6), between this number of nodes.

        The triangles must be oriented alike. A rim is a closed curve of edges that have a
        triangle on one side only.
        """
        cells = triangles.astype(np.int64)
        corners = cells[:, :3]
        midpoints = cells[:, 3:].reshape(3 * len(cells), -1)
        edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
        # An edge is inside if another triangle runs along it in the opposite direction.
        is_inside = np.isin(edges @ (nodes, 1), edges @ (1, nodes))
        rim = np.hstack([edges, midpoints])[~is_inside]
        graph = sparse.csr_matrix((np.ones(len(rim)), rim[:, :2].T), shape=(nodes, nodes))
        label = connected_components(graph, directed=False)[1]
        _, part = np.unique(label[rim[:, 0]], return_inverse=True)
        # Each node of a rim once: without the ends of the edges, which begin the next ones.
        rim_nodes = np.delete(rim, 1, axis=1)
        entries = np.ones(rim_nodes.size), (np.repeat(part, rim_nodes.shape[1]), rim_nodes.ravel())
        sum_of_rim = sparse.csr_matrix(entries, shape=(part.max(initial=-1) + 1, nodes))
        share = sparse.diags(1.0 / np.asarray(sum_of_rim.sum(axis=1)).ravel())
        return cls(cells, rim, share @ sum_of_rim, part)

    def volume(self, x: np.ndarray) -> float:
        """Return V = ⅓ ∫ x · (x_ξ × x_η) over triangles and caps for positions x (n, 3) [m³].

        V is positive where the oriented normals point out of it. Triangles and edges of P2 are
        curved; the quadrature of the element's energy is exact for V.
        """
        element = ELEMENTS["P2" if self.triangles.shape[1] == 6 else "P1"]
        nodes = x[self.triangles]
        total = 0.0
        _, weights = element.rule
        for N, slopes, weight in zip(element.values, element.slopes, weights, strict=True):
            point, x_xi, x_eta = (np.einsum("k,eki->ei", c, nodes) for c in (N, *slopes))
            total += weight / 3 * np.vdot(point, np.cross(x_xi, x_eta))
        return float(total + self._caps_volume(x))

    def _caps_volume(self, x: np.ndarray) -> float:
        """Return the part of the integral over all caps for positions x (n, 3) [m³].

        A cap joins its centre c to the edges of its rim. An edge is r(t) = a + t e +
        4 t (1 − t) d, 0 ≤ t ≤ 1, with e = b − a and the bulge d = m − (a + b)/2 of its midpoint
        m. Its part is ⅙ c · ∫ r' × r dt, and the integral is b × a − 4/3 d × e. For P1, d is 0.
        """
        a = x[self.rim[:, 0]]
        b = x[self.rim[:, 1]]
        swept = np.cross(b, a)  # ∫ r' × r dt
        is_quadratic = self.rim.shape[1] == 3
        if is_quadratic:
            bulge = x[self.rim[:, 2]] - (a + b) / 2
            swept -= 4 / 3 * np.cross(bulge, b - a)
        centre_of_edge = (self.centre @ x)[self.part]  # c of the rim of each edge
        return np.vdot(centre_of_edge, swept) / 6
