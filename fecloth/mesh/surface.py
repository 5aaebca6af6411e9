"""The deformed cloth as a surface of flat triangles: what is turned over, what intersects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.mesh.hinges import Hinges
from fecloth.mesh.intersections import count_intersections

_QUADRATIC = [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]  # in VTK's order of `Cloth.cells`


@dataclass(frozen=True, eq=False)
class Surface:
    """Flat triangles between the nodes of a cloth: those of P1, four of each triangle of P2.

    Attributes
    ----------
    triangles
        (s, 3) nodes.
    sides
        (h, 2) the two triangles at each interior edge.
    """

    triangles: np.ndarray
    sides: np.ndarray

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
