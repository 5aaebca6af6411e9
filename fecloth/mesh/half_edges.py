"""Half-edges of a triangle mesh: the three edges of each triangle, and their hinges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.hinges import Hinges


@dataclass(frozen=True, eq=False)
class HalfEdges:
    """The edges of each triangle: half-edge 3 t + i leads from corner i of t to the next corner."""

    X: np.ndarray  # (n, 2) node coordinates [m]
    triangles: np.ndarray  # (m, 3) corners, counter-clockwise
    hinges: Hinges  # the interior edges of the same triangles

    @classmethod
    def from_triangles(cls, X: np.ndarray, triangles: np.ndarray) -> HalfEdges:
        """Find the half-edges of a mesh from node coordinates (n, 2) and corners (m, 3)."""
        return cls(X, triangles, Hinges.from_triangles(X, triangles))

    @cached_property
    def of_hinge(self) -> np.ndarray:
        """(h, 2) half-edges of each interior edge: in the left and in the right triangle."""
        nodes, sides = self.hinges.nodes, self.hinges.sides
        corner = [
            np.argmax(self.triangles[sides[:, s]] == nodes[:, s, None], axis=1) for s in (0, 1)
        ]
        return 3 * sides + np.stack(corner, axis=1)

    @cached_property
    def hinge(self) -> np.ndarray:
        """(3m,) hinge of each half-edge; −1 for a free edge of the boundary."""
        hinge = np.full(3 * len(self.triangles), -1)
        hinge[self.of_hinge] = np.arange(len(self.of_hinge))[:, None]
        return hinge

    @cached_property
    def vector(self) -> np.ndarray:
        """(m, 3, 2) vectors along the half-edges [m]."""
        corners = self.X[self.triangles]
        return np.roll(corners, -1, axis=1) - corners

    @cached_property
    def area(self) -> np.ndarray:
        """(m,) reference areas [m²]."""
        e, f = self.vector[:, 0], self.vector[:, 1]
        return 0.5 * (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])

    @cached_property
    def curvature_of_slopes(self) -> np.ndarray:
        """(m, 3, 3) B with κ = B α for (κ₁₁, κ₂₂, 2κ₁₂) [1/m] and the slopes α of the three edges.

        κ = Σ l_i/A α_i n_i n_iᵀ, where α_i is the angle from the triangle to the normal that
        belongs to edge i, and n_i the unit normal of the edge in the plane, which points out of
        the triangle (Morley 1968; Grinspun et al. 2006, Computing discrete shape operators on
        general meshes, eq. 4).
        """
        e = self.vector
        length = np.hypot(e[..., 0], e[..., 1])
        n1, n2 = e[..., 1] / length, -e[..., 0] / length
        rows = np.stack([n1 * n1, n2 * n2, 2.0 * n1 * n2], axis=1)
        return rows * (length / self.area[:, None])[:, None, :]

    @cached_property
    def slopes_of_curvature(self) -> np.ndarray:
        """(3m, 3) row a with α = a · (κ₁₁, κ₂₂, 2κ₁₂) of each half-edge where κ is constant [m]."""
        return np.linalg.inv(self.curvature_of_slopes).reshape(-1, 3)

    @cached_property
    def at_node(self) -> sparse.csr_matrix:
        """(n, m) 1 where a triangle has the node for a corner."""
        m = len(self.triangles)
        data = np.ones(3 * m), (self.triangles.ravel(), np.repeat(np.arange(m), 3))
        return sparse.csr_matrix(data, shape=(len(self.X), m))
