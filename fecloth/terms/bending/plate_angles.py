"""The hinge angles of a plate, and the matrix that couples them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled_calls import Call
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots
from fecloth.terms.bending import plate_loops
from fecloth.terms.bending.plate_rows import CoupledRows
from fecloth.terms.bending.plate_stiffness import panel_stiffness


def bind_angles(panel: Panel, slots: FindSlots, where: str) -> PlateAngles:
    """The hinge angles of a panel, coupled by the stiffness of its plate."""
    slopes, Q = panel.cloth.edge_slopes, panel_stiffness(panel, where)
    nodes, gradient = slopes.edges.hinges.nodes, slopes.edges.hinges.flat_gradient
    held, moved = np.empty((0, 3)), None
    if panel.clamps:
        triangles, edge = np.divmod(panel.clamps.half_edges, 3)
        corners = slopes.edges.triangles[triangles[:, None], (edge[:, None] + np.arange(3)) % 3]
        none = np.full((len(corners), 1), -1, np.int32)
        clamped = np.hstack([corners, none]).astype(np.int32)
        nodes, moved = np.concatenate([nodes, clamped]), panel.clamps.moved
        gradient = np.concatenate([gradient, clamped_gradient(panel.cloth.X[corners])])
        held = mirror(panel.clamps.start[corners])
    return PlateAngles(nodes, held, moved, Q, gradient, slots, slopes.pairs, len(panel.cloth.X))


def mirror(corners: np.ndarray) -> np.ndarray:
    """(c, 3) the third corners of triangles (c, 3, 3), mirrored in their planes at the first edge.

    The plane through the edge and this point is that of the triangle.
    """
    a, b, apex = np.moveaxis(corners, 1, 0)
    edge, arm = b - a, apex - a
    along = np.sum(edge * arm, axis=1, keepdims=True) / np.sum(edge * edge, axis=1, keepdims=True)
    return apex - 2 * (arm - along * edge)


def clamped_gradient(corners: np.ndarray) -> np.ndarray:
    """(c, 4) ∂θ/∂z about flat of clamped edges, from the corners (c, 3, 2) of their triangles."""
    edge, arm = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    square = np.sum(edge * edge, axis=1)
    foot = np.sum(edge * arm, axis=1) / square
    height = np.abs(edge[:, 0] * arm[:, 1] - edge[:, 1] * arm[:, 0]) / np.sqrt(square)
    parts = [-(1 - foot), -foot, np.ones_like(foot), np.zeros_like(foot)]
    return np.stack(parts, axis=1) / height[:, None]


@dataclass(frozen=True, eq=False)
class PlateAngles:
    """The hinge angles of a cloth, and the matrix that couples them.

    Attributes
    ----------
    nodes
        (h, 4) nodes of the hinges; −1 for one that is held in space.
    held
        (c, 3) positions of those at the start [m].
    moved
        ``moved(held, t)``: their positions at the time t, or None where they stay.
    stiffness
        (h, h) Q [N m].
    flat_gradient
        (h, 4) ∂θ/∂z about flat [1/m].
    find_slots, pairs, n
        For `rows`: as `bind` of a term gets it, the stencil of the term, and the number of nodes.
    """

    nodes: np.ndarray
    held: np.ndarray
    moved: Callable[[np.ndarray, float], np.ndarray] | None
    stiffness: sparse.csr_matrix
    flat_gradient: np.ndarray
    find_slots: FindSlots
    pairs: np.ndarray
    n: int

    @cached_property
    def rows(self) -> CoupledRows:
        """Where products with Q lie in the system matrix."""
        return CoupledRows.make(self.nodes, self.stiffness, self.find_slots, self.pairs, self.n)

    @property
    def nbytes(self) -> int:
        """Memory of Q [bytes]."""
        return int(self.stiffness.data.nbytes + self.stiffness.indices.nbytes)

    def at(self, t: float) -> tuple:
        """What the loops over the hinges take first, at the time t."""
        held = self.held_at(t)
        return self.nodes, held, len(self.nodes) - len(held)

    def held_at(self, t: float) -> np.ndarray:
        """(c, 3) positions of the nodes that are held in space, at the time t [m]."""
        return self.held if self.moved is None else self.moved(self.held, t)

    def energy(self, x: np.ndarray, t: float, rest: np.ndarray) -> float:
        """½ (μ − μ⁰)ᵀ Q (μ − μ⁰) [J] for the measures μ⁰ at rest."""
        change = self.measures(x, t) - rest
        return 0.5 * plate_loops.sum_products(change, self.stiffness @ change)

    def measures(self, x: np.ndarray, t: float) -> np.ndarray:
        """μ (h,)."""
        mu = np.zeros(len(self.nodes))
        plate_loops.add_measures(*self.at(t), x, 1.0, mu)
        return mu

    def gradients(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """μ (h,) and ∂μ/∂x (h, 4, 3)."""
        mu, g = np.empty(len(self.nodes)), np.empty((len(self.nodes), 4, 3))
        plate_loops.fill_gradients(*self.at(t), x, mu, g)
        return mu, g

    def rates(self, g: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(h,) dμ/dt [1/s]."""
        rate = np.zeros(len(self.nodes))
        plate_loops.add_rates(self.nodes, g, v, rate)
        return rate

    def add_force(self, change: np.ndarray, g: np.ndarray, f: np.ndarray) -> None:
        """f −= Σ m g with the moments m = Q change [N m], and g (h, 4, 3) [1/m]."""
        function, arguments = self.force_call(change, g, f)
        function(*arguments)

    def force_call(self, change: np.ndarray, g: np.ndarray, f: np.ndarray) -> Call:
        """The compiled call that `add_force` makes."""
        Q = self.stiffness
        data = self.nodes, Q.indptr, Q.indices, Q.data
        return plate_loops.add_force, (*data, change, g, f)

    def add_products(self, left: np.ndarray, right: np.ndarray, scale: float, J) -> None:
        """J += scale leftᵀ Q right, both (h, 4, 3)."""
        Q, rows = self.stiffness, self.rows
        data = Q.indptr, Q.indices, Q.data, rows.place, rows.start, rows.width, rows.slots
        plate_loops.add_products(*data, left, right, scale, J.values)

    def add_curvatures(self, x: np.ndarray, t: float, moment: np.ndarray, scale: float, J) -> None:
        """J += scale Σ m ∂²μ/∂x∂x for the moments m (h,)."""
        rows = self.rows
        data = rows.place, rows.own, rows.start, rows.width, rows.slots
        plate_loops.add_curvatures(*self.at(t), x, *data, moment, scale, J.values)

    def bound(self, mass: np.ndarray) -> float:
        """Upper bound of the eigenvalues of M⁻¹ GᵀQG at flat: the largest row sum."""
        here = self.nodes >= 0
        hinge = np.repeat(np.arange(len(self.nodes)), here.sum(axis=1))
        shape = len(self.nodes), len(mass)
        G = sparse.csr_matrix((self.flat_gradient[here], (hinge, self.nodes[here])), shape=shape)
        scale = sparse.diags(1.0 / np.sqrt(mass))
        K = scale @ (G.T @ self.stiffness @ G) @ scale
        return float(abs(K).sum(axis=1).max()) if K.nnz else 0.0
