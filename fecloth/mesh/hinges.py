"""The edges of a triangle mesh: hinges, which are the interior ones, and half-edges."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import scipy.sparse as sparse


@dataclass(frozen=True, eq=False)
class Hinges:
    """All interior edges of a flat mesh; create them with `from_triangles`.

    A hinge is the edge from its node 0 to its node 1. Node 2 is the opposite corner of the
    triangle to the left of 0 → 1, and node 3 the opposite corner of the triangle to the right.

    Attributes
    ----------
    nodes
        (h, 4) int32 node indices.
    sides
        (h, 2) indices of the left and the right triangle.
    vector
        (h, 2) vectors from node 0 to node 1 in the reference plane [m].
    areas
        (h, 2) reference areas of the two triangles [m²].
    feet
        (h, 2) feet of the heights from nodes 2 and 3 on the edge: 0 at node 0, 1 at node 1.
    """

    nodes: np.ndarray
    sides: np.ndarray
    vector: np.ndarray
    areas: np.ndarray
    feet: np.ndarray

    @classmethod
    def from_triangles(
        cls, X: np.ndarray, triangles: np.ndarray, corners: np.ndarray | None = None
    ) -> Self:
        """Find the hinges of triangles (m, 3) between nodes X (n, 2), ordered by left triangle.

        The triangles must be counter-clockwise. The left triangle of a hinge is the one with
        the lower half-edge number. `corners` (m, 3, 2) are the coordinates of their corners
        where these are not those of the nodes.
        """
        n = len(X)
        numbers = triangles.astype(np.int64)
        start, end, opposite = (np.roll(numbers, -shift, axis=1).ravel() for shift in range(3))
        key = start * n + end
        # Neighbours run along their edge in opposite directions, so the key of the twin, the
        # half-edge in the other triangle, has the nodes exchanged.
        twin_key = end * n + start
        order = np.argsort(twin_key)
        position = np.minimum(np.searchsorted(twin_key[order], key), len(order) - 1)
        twin = order[position]
        has_twin = twin_key[twin] == key
        left = np.flatnonzero(has_twin & (np.arange(len(start)) < twin))  # each edge once
        right = twin[left]
        nodes = np.stack([start[left], end[left], opposite[left], opposite[right]], axis=1)
        sides = np.stack([left // 3, right // 3], axis=1)
        corners = X[triangles] if corners is None else corners
        first, second, apex = (
            np.roll(corners, -shift, axis=1).reshape(-1, 2) for shift in range(3)
        )
        # the right half-edge begins where the left one ends
        e = second[left] - first[left]
        arms = apex[left] - first[left], apex[right] - second[right]
        square = np.sum(e * e, axis=1)
        areas = [0.5 * np.abs(e[:, 0] * a[:, 1] - e[:, 1] * a[:, 0]) for a in arms]
        feet = [np.sum(e * a, axis=1) / square for a in arms]
        of_sides = np.stack(areas, axis=1), np.stack(feet, axis=1)
        return cls(nodes.astype(np.int32), sides, e, *of_sides)

    @cached_property
    def length(self) -> np.ndarray:
        """(h,) reference length of the edges [m]."""
        return np.hypot(*self.vector.T)

    @cached_property
    def area(self) -> np.ndarray:
        """(h,) area A₁ + A₂ of the two triangles [m²]."""
        return self.areas.sum(axis=1)

    @cached_property
    def flat_gradient(self) -> np.ndarray:
        """(h, 4) g with θ = Σ g_a z_a to first order in the deflections z of the nodes [1/m].

        A deflection z of an opposite node turns its triangle by z/h_i, where h_i is the height
        of the triangle above the edge. The entries of the edge's nodes follow from the lever
        rule. Σ g_a X_a = 0: an affine deflection does not bend the cloth.
        """
        g2, g3 = (0.5 * self.length[:, None] / self.areas).T
        s2, s3 = self.feet.T
        return np.stack([-(1 - s2) * g2 - (1 - s3) * g3, -s2 * g2 - s3 * g3, g2, g3], axis=1)


@dataclass(frozen=True, eq=False)
class HalfEdges:
    """The edges of each triangle: half-edge 3 t + i leads from corner i of t to the next corner.

    Attributes
    ----------
    X
        (n, 2) node coordinates [m].
    triangles
        (m, 3) corners, counter-clockwise.
    hinges
        The interior edges of the same triangles.
    own_corners
        (m, 3, 2) coordinates of the corners of each triangle [m], where these are not those of
        the nodes; else None.
    """

    X: np.ndarray
    triangles: np.ndarray
    hinges: Hinges
    own_corners: np.ndarray | None = None

    @classmethod
    def from_triangles(cls, X: np.ndarray, triangles: np.ndarray) -> Self:
        """Find the half-edges of a mesh from node coordinates (n, 2) and corners (m, 3)."""
        return cls(X, triangles, Hinges.from_triangles(X, triangles))

    @cached_property
    def of_hinge(self) -> np.ndarray:
        """(h, 2) half-edges of each interior edge: in the left and in the right triangle."""
        nodes = self.hinges.nodes
        sides = self.hinges.sides
        is_start = self.triangles[sides] == nodes[:, :2, None]  # (h, 2, 3)
        return 3 * sides + np.argmax(is_start, axis=2)

    @cached_property
    def hinge(self) -> np.ndarray:
        """(3m,) hinge of each half-edge; −1 for a free edge of the boundary."""
        hinge = np.full(3 * len(self.triangles), -1)
        hinge[self.of_hinge] = np.arange(len(self.of_hinge))[:, None]
        return hinge

    @cached_property
    def vector(self) -> np.ndarray:
        """(m, 3, 2) vectors along the half-edges [m]."""
        corners = self.X[self.triangles] if self.own_corners is None else self.own_corners
        return np.roll(corners, -1, axis=1) - corners

    @cached_property
    def area(self) -> np.ndarray:
        """(m,) reference areas [m²]."""
        e = self.vector[:, 0]
        f = self.vector[:, 1]
        return 0.5 * (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])

    @cached_property
    def curvature_of_slopes(self) -> np.ndarray:
        """(m, 3, 3) B with κ = B α, from the slopes α of three edges to (κ₁₁, κ₂₂, 2κ₁₂) [1/m].

        κ = Σ l_i/A α_i n_i n_iᵀ, where α_i is the angle from the triangle to the normal that
        belongs to edge i, and n_i the unit normal of the edge in the plane, which points out of
        the triangle (Morley 1968; Grinspun et al. 2006, Computing discrete shape operators on
        general meshes, eq. 4).
        """
        e = self.vector
        length = np.hypot(e[..., 0], e[..., 1])
        n1 = e[..., 1] / length
        n2 = -e[..., 0] / length
        rows = np.stack([n1 * n1, n2 * n2, 2.0 * n1 * n2], axis=1)
        return rows * (length / self.area[:, None])[:, None, :]

    @cached_property
    def slopes_of_curvature(self) -> np.ndarray:
        """(3m, 3) row a of each half-edge, α = a · (κ₁₁, κ₂₂, 2κ₁₂) for a constant κ [m]."""
        return np.linalg.inv(self.curvature_of_slopes).reshape(-1, 3)

    @cached_property
    def at_node(self) -> sparse.csr_matrix:
        """(n, m) matrix with 1 where the node is a corner of the triangle."""
        m = len(self.triangles)
        data = np.ones(3 * m), (self.triangles.ravel(), np.repeat(np.arange(m), 3))
        return sparse.csr_matrix(data, shape=(len(self.X), m))
