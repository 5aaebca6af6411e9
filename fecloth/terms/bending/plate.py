"""Bending as a plate: Morley's triangle, its edge slopes reconstructed from the hinge angles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.mesh.cloth import Cloth
from fecloth.terms.bending import plate_loops
from fecloth.terms.bending.fold_measure import fold_measure
from fecloth.terms.bending.plate_stiffness import angle_stiffness, plate_rigidity


@dataclass(frozen=True)
class PlateBending:
    """Placeholder."""

    rest: str | float | tuple[float, ...] = "flat"

    elements = ("P1", "P2")

    def stencil(self, cloth: Cloth) -> np.ndarray:
        """(p, 2) pairs of nodes that share the slopes of a triangle."""
        return cloth.edge_slopes.pairs

    def bind(self, panel: Panel, slots: Callable) -> BoundPlate:
        slopes = panel.cloth.edge_slopes
        copies = len(slopes.edges.triangles) // len(panel.cloth.triangles)
        D = np.repeat(plate_rigidity(panel, "PlateBending"), copies, axis=0)
        material = np.repeat(_materials(panel), copies)
        Q = angle_stiffness(slopes, D, material, np.empty(0, int))
        hinges, n = slopes.edges.hinges, len(panel.cloth.X)
        rows = CoupledRows.make(hinges.nodes, Q, slots, slopes.pairs, n)
        rest = np.zeros(len(hinges.nodes))
        return BoundPlate(hinges.nodes, np.empty((0, 3)), Q, rest, rows, hinges.flat_gradient, n)


def _materials(panel: Panel) -> np.ndarray:
    rows = np.column_stack([panel.region, panel.grain])
    return np.unique(rows, axis=0, return_inverse=True)[1].ravel()


@dataclass(frozen=True, eq=False)
class CoupledRows:
    """Where the products of a row of Q lie in the system matrix; see `plate_loops.add_products`."""

    place: np.ndarray
    start: np.ndarray
    width: np.ndarray
    slots: np.ndarray
    own: np.ndarray

    @classmethod
    def make(cls, nodes, Q, slots, pairs, n) -> CoupledRows:
        both = slots(pairs)
        i = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(n)])
        j = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(n)])
        alone = slots(np.arange(n, dtype=np.int32)[:, None]).ravel()
        value = np.concatenate([both[:, 0, 1], both[:, 1, 0], alone])
        order = np.lexsort((j, i))
        ptr = np.searchsorted(i[order], np.arange(n + 1))
        width = np.empty(len(nodes), np.int64)
        plate_loops.count_row_nodes(nodes, Q.indptr, Q.indices, n, width)
        start = np.concatenate([[0], np.cumsum(4 * width)])
        place = np.empty((Q.nnz, 4), np.int16)
        made = np.empty(start[-1], np.int32)
        plate_loops.fill_rows(
            nodes, Q.indptr, Q.indices, ptr, j[order], value[order], start, width, place, made
        )
        row = np.repeat(np.arange(len(nodes)), np.diff(Q.indptr))
        own = np.flatnonzero(Q.indices == row)
        return cls(place, start, width, made, own)


@dataclass(frozen=True, eq=False)
class BoundPlate:
    """`PlateBending` on a cloth."""

    nodes: np.ndarray
    ghosts: np.ndarray
    stiffness: sparse.csr_matrix
    rest: np.ndarray
    rows: CoupledRows
    flat_gradient: np.ndarray
    n: int

    name = "PlateBending"
    symmetric = True
    has_energy = True
    dissipative = False
    velocity_dependent = False

    @property
    def first(self) -> int:
        return len(self.nodes) - len(self.ghosts)

    def energy(self, x, t) -> float:
        change = -self.rest
        plate_loops.add_measures(self.nodes, self.ghosts, self.first, x, 1.0, change)
        return 0.5 * plate_loops.sum_products(change, self.stiffness @ change)

    def _gradients(self, x):
        mu, g = np.empty(len(self.nodes)), np.empty((len(self.nodes), 4, 3))
        plate_loops.fill_gradients(self.nodes, self.ghosts, self.first, x, mu, g)
        return mu, g

    def add_force(self, x, v, t, f) -> None:
        mu, g = self._gradients(x)
        plate_loops.add_force(self.nodes, g, self.stiffness @ (mu - self.rest), f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        mu, g = self._gradients(x)
        Q, r = self.stiffness, self.rows
        plate_loops.add_products(
            Q.indptr, Q.indices, Q.data, r.place, r.start, r.width, r.slots, g, g, wx, J.values
        )
        if not definite:
            plate_loops.add_curvatures(
                self.nodes, self.ghosts, self.first, x, r.place, r.own, r.start, r.width, r.slots,
                Q @ (mu - self.rest), wx, J.values,
            )

    def rate_bounds(self, mass):
        h = len(self.nodes)
        G = sparse.csr_matrix(
            (self.flat_gradient.ravel(), (np.repeat(np.arange(h), 4), self.nodes.ravel())),
            shape=(h, self.n),
        )
        K = abs(G.T @ self.stiffness @ G)
        r = np.sqrt(mass)
        return float(((K @ (1 / r)) / r).max()), 0.0
