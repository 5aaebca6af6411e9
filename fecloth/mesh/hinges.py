"""Hinges of a triangle mesh: the interior edges, each with its two adjacent triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Hinges:
    """All interior edges of a flat mesh; create them with `from_triangles`.

    A hinge is the edge from its node 0 to its node 1. Node 2 is the opposite corner of the triangle
    to the left of 0 → 1, and node 3 the opposite corner of the triangle to the right.
    """

    nodes: np.ndarray  # (h, 4) int32 node indices
    sides: np.ndarray  # (h, 2) indices of the left and the right triangle
    vector: np.ndarray  # (h, 2) vector from node 0 to node 1 in the reference plane [m]
    areas: np.ndarray  # (h, 2) reference areas of the two triangles [m²]
    # (h, 2) feet of the heights from nodes 2 and 3 on the edge: 0 at node 0, 1 at node 1.
    feet: np.ndarray

    @classmethod
    def from_triangles(cls, X: np.ndarray, triangles: np.ndarray) -> Hinges:
        """Find the hinges of a mesh, in the order of their left triangles.

        Parameters
        ----------
        X : (n, 2) array
            Node coordinates [m].
        triangles : (m, 3) integer array
            Corners, counter-clockwise.

        Examples
        --------
        >>> X = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        >>> Hinges.from_triangles(X, np.array([[0, 1, 2], [0, 2, 3]])).nodes.tolist()
        [[2, 0, 1, 3]]
        """
        start = triangles.ravel().astype(np.int64)
        end, opposite = (np.roll(triangles, -s, axis=1).ravel().astype(np.int64) for s in (1, 2))
        n = len(X)
        order = np.argsort(end * n + start)
        backward = (end * n + start)[order]  # the key of the same edge seen from the other side
        position = np.minimum(np.searchsorted(backward, start * n + end), len(order) - 1)
        twin = order[position]
        has_twin = backward[position] == start * n + end
        left = np.flatnonzero(has_twin & (np.arange(len(start)) < twin))
        right = twin[left]
        nodes = np.stack([start[left], end[left], opposite[left], opposite[right]], axis=1)
        sides = np.stack([left // 3, right // 3], axis=1)
        return cls._from_nodes(X, nodes.astype(np.int32), sides)

    @classmethod
    def _from_nodes(cls, X, nodes, sides) -> Hinges:
        e, *apexes = (X[nodes[:, a]] - X[nodes[:, 0]] for a in (1, 2, 3))
        square = np.sum(e * e, axis=1)
        areas = [0.5 * np.abs(e[:, 0] * a[:, 1] - e[:, 1] * a[:, 0]) for a in apexes]
        feet = [np.sum(e * a, axis=1) / square for a in apexes]
        return cls(nodes, sides, e, np.stack(areas, axis=1), np.stack(feet, axis=1))

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

        A deflection z of an opposite node turns its triangle by z/h_i, where h_i is the height of
        the triangle above the edge. The entries of the edge's nodes follow from the lever rule.
        Σ g_a X_a = 0: an affine deflection does not bend the cloth.
        """
        g2, g3 = (0.5 * self.length[:, None] / self.areas).T
        s2, s3 = self.feet.T
        return np.stack([-(1 - s2) * g2 - (1 - s3) * g3, -s2 * g2 - s3 * g3, g2, g3], axis=1)
