"""The volume that a surface of triangles encloses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A surface of triangles and a cap over each of its rims: what is needed for its volume.

    A cap has the triangles between the edges of a rim and the mean of its nodes. So the volume of
    a dome is that between the dome and the plane of its rim.

    Attributes
    ----------
    triangles
        (m, 3) oriented corners.
    rim
        (r, 2) edges that have a triangle on one side only, in the direction of that triangle.
    centre
        (rims, n) matrix from nodal positions to the mean of each rim.
    part
        (r,) rim of each edge.

    Examples
    --------
    >>> x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> closed = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> [round(6 * Enclosure.of(some, 4).volume(x), 9) for some in (closed, closed[1:])]
    [1.0, 1.0]
    """

    triangles: np.ndarray
    rim: np.ndarray
    centre: sparse.csr_matrix
    part: np.ndarray

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
