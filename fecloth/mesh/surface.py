"""A deformed cloth as flat triangles: what is turned over, what intersects, what is enclosed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from fecloth.mesh.cloth import Cloth
from fecloth.mesh.hinges import Hinges
from fecloth.mesh.intersections import count_intersections

_QUADRATIC = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]  # in VTK's order of `Cloth.cells`


@dataclass(frozen=True, eq=False)
class Surface:
    """Flat triangles between the nodes of a cloth: those of P1, four of each triangle of P2."""

    triangles: np.ndarray  # (s, 3) nodes
    sides: np.ndarray  # (h, 2) the two triangles at each interior edge

    @classmethod
    def of(cls, cloth: Cloth) -> Surface:
        """Return the surface of a cloth."""
        if cloth.element == "P1":
            return cls(cloth.triangles, cloth.hinges.sides)
        triangles = np.ascontiguousarray(cloth.cells[:, _QUADRATIC].reshape(-1, 3))
        return cls(triangles, Hinges.from_triangles(cloth.X, triangles).sides)

    def node_areas(self, X: np.ndarray) -> np.ndarray:
        """(n,) a third of the areas of the triangles of each node, at X (n, 2) [m²]."""
        a, b, c = X[self.triangles].transpose(1, 0, 2)
        third = abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 6
        return np.bincount(self.triangles.ravel(), np.repeat(third, 3), len(X))

    def count_inverted(self, x: np.ndarray) -> int:
        """Count the triangles that are turned over against all their neighbours, at least two.

        x (n, 3) are positions [m]. At a fold one neighbour lies on the other side; a triangle with
        all of them there has been pushed through the cloth.
        """
        a, b, c = x[self.triangles].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        first, second = self.sides.T
        opposed = np.einsum("hi,hi->h", normals[first], normals[second]) < 0
        size = len(self.triangles)
        against = np.bincount(self.sides[opposed].ravel(), minlength=size)
        neighbours = np.bincount(self.sides.ravel(), minlength=size)
        return int(((against == neighbours) & (neighbours > 1)).sum())

    def count_intersections(self, x: np.ndarray) -> int | None:
        """Count the pairs of triangles that pass through each other; see `intersections`."""
        return count_intersections(self.triangles, x)


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A surface of triangles and a cap over each of its rims: what is needed for its volume.

    A cap has the triangles between the edges of a rim and the mean of its nodes. So the volume of
    a dome is that between the dome and the plane of its rim.

    Examples
    --------
    >>> x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> closed = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> [round(6 * Enclosure.of(some, 4).volume(x), 9) for some in (closed, closed[1:])]
    [1.0, 1.0]
    """

    triangles: np.ndarray  # (m, 3) oriented corners
    # (r, 2) edges that have a triangle on one side only, in the direction of that triangle.
    rim: np.ndarray
    centre: sparse.csr_matrix  # (rims, n) matrix from nodal positions to the mean of each rim
    part: np.ndarray  # (r,) rim of each edge

    @classmethod
    def of(cls, triangles: np.ndarray, nodes: int) -> Enclosure:
        """Find the rims of triangles (m, 3) over so many nodes."""
        corners = triangles.astype(np.int64)
        edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
        is_rim = ~np.isin(edges @ (nodes, 1), edges @ (1, nodes))
        rim = edges[is_rim]
        graph = sparse.csr_matrix((np.ones(len(rim)), rim.T), shape=(nodes, nodes))
        label = connected_components(graph, directed=False)[1]
        _, part = np.unique(label[rim[:, 0]], return_inverse=True)
        entries = np.ones(len(rim)), (part, rim[:, 0])
        centre = sparse.csr_matrix(entries, shape=(part.max(initial=-1) + 1, nodes))
        share = sparse.diags(1.0 / np.asarray(centre.sum(axis=1)).ravel())
        return cls(corners, rim, share @ centre, part)

    def volume(self, x: np.ndarray) -> float:
        """Return V = Σ x₁ · (x₂ × x₃) / 6 over triangles and caps for positions x (n, 3) [m³].

        V is positive where the oriented normals point out of it. For P2 the corners count.
        """
        surface = _signed_volume(*(x[corner] for corner in self.triangles.T))
        first, second = self.rim.T
        return surface + _signed_volume((self.centre @ x)[self.part], x[second], x[first])


def _signed_volume(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float(np.einsum("ei,ei->", a, np.cross(b, c))) / 6
