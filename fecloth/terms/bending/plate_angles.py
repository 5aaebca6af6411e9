"""The hinge angles of a plate, and the matrix that couples them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Call, Present, SharedCall
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.terms.bending import plate_loops
from fecloth.terms.bending.plate_stiffness import panel_plate
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.protocol import At


@dataclass(frozen=True, eq=False)
class CoupledRows:
    """Where the products with each row e of Q lie in the system matrix.

    A row has the nodes of all hinges that have an entry in it. Its blocks are the blocks of the
    four nodes of hinge e with all these nodes.

    Attributes
    ----------
    place
        (entries of Q, 4) Which nodes of the row the nodes of the entry's hinge are.
    start
        (h,) The first slot of each row.
    width
        (h,) The number of nodes of each row.
    slots
        The blocks, 4 · width for each row; −1 where the node of e is held in space.
    own
        (h,) The entry of Q on the diagonal of each row.
    """

    place: np.ndarray
    start: np.ndarray
    width: np.ndarray
    slots: np.ndarray
    own: np.ndarray

    @property
    def nbytes(self) -> int:
        arrays = self.place, self.start, self.width, self.slots, self.own
        return sum(array.nbytes for array in arrays)

    @classmethod
    def make(
        cls, nodes: np.ndarray, Q: sparse.csr_matrix, slots: FindSlots, pairs: np.ndarray, n: int
    ) -> Self:
        """Find the blocks of hinges among the blocks of pairs of nodes.

        Raises `InputError` if two nodes in a row of Q are no pair.

        Parameters
        ----------
        nodes
            (h, 4) The nodes of the hinges; −1 for a node that is held in space.
        Q
            (h, h) The matrix that couples the hinges.
        slots
            Finds blocks in the system matrix.
        pairs
            (p, 2) The pairs of different nodes that have blocks, each pair once.
        n
            The number of nodes.
        """
        blocks_of_pairs = slots(pairs)  # (p, 2, 2)
        blocks_of_nodes = slots(np.arange(n, dtype=np.int32)[:, None])  # on the diagonal
        # All blocks by row i and column j, then in the order of the rows: the nodes coupled with
        # node i are those from first_of_row[i] to first_of_row[i + 1].
        i = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(n)])
        j = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(n)])
        blocks = np.concatenate(
            [blocks_of_pairs[:, 0, 1], blocks_of_pairs[:, 1, 0], blocks_of_nodes.ravel()]
        )
        order = np.argsort(i * n + j)
        first_of_row = np.searchsorted(i[order], np.arange(n + 1)).astype(np.int32)
        width = _count_row_nodes(nodes, Q, n)
        start = np.concatenate([[0], np.cumsum(4 * width)])
        place = np.empty((Q.nnz, 4), np.int16)
        row_slots = np.empty(start[-1], np.int32)
        hinge_without_block = plate_loops.fill_rows(
            nodes=nodes,
            indptr=Q.indptr,
            indices=Q.indices,
            block_ptr=first_of_row,
            block_nodes=j[order].astype(np.int32),
            blocks=blocks[order],
            start=start,
            last=np.full(n, -1),
            position=np.empty(n, np.int64),
            row=np.empty(width.max(initial=0), np.int32),
            place=place,
            slots=row_slots,
        )
        if hinge_without_block >= 0:
            what = f"the nodes around hinge {hinge_without_block}"
            remedy = "Name the regions of both fabrics in the cloth: materials may change there."
            raise InputError(what, "are not all coupled in the matrix", "PlateBending", remedy)
        row_of_entry = np.repeat(np.arange(len(nodes)), np.diff(Q.indptr))
        own = np.flatnonzero(Q.indices == row_of_entry)
        return cls(place=place, start=start[:-1], width=width, slots=row_slots, own=own)


def _count_row_nodes(nodes: np.ndarray, Q: sparse.csr_matrix, n: int) -> np.ndarray:
    """(h,) the number of different nodes of the hinges in each row of Q."""
    is_node = nodes >= 0  # −1 is held in space
    start = np.concatenate([[0], np.cumsum(is_node.sum(axis=1))])
    ones = np.ones(start[-1], bool)
    nodes_of_hinge = sparse.csr_array((ones, nodes[is_node], start), (len(nodes), n))
    coupled_hinges = sparse.csr_array((np.ones(Q.nnz, bool), Q.indices, Q.indptr), Q.shape)
    # A row of the product of these patterns has an entry for each node.
    return np.diff((coupled_hinges @ nodes_of_hinge).indptr).astype(np.int64)


def clamped_gradient(corners: np.ndarray) -> np.ndarray:
    """(c, 4) ∂θ/∂z about flat of clamped edges; `corners` (c, 3, 2) of their triangles."""
    edge = corners[:, 1] - corners[:, 0]
    arm = corners[:, 2] - corners[:, 0]
    square = np.sum(edge * edge, axis=1)
    foot = np.sum(edge * arm, axis=1) / square
    height = np.abs(edge[:, 0] * arm[:, 1] - edge[:, 1] * arm[:, 0]) / np.sqrt(square)
    parts = [-(1 - foot), -foot, np.ones_like(foot), np.zeros_like(foot)]
    return np.stack(parts, axis=1) / height[:, None]


@dataclass(frozen=True, eq=False)
class PlateAngles:
    """The hinge angles of a cloth, and the matrix that couples them.

    The last c hinges are clamped edges, whose fourth node is held in space.

    Attributes
    ----------
    nodes
        (h, 4) The nodes of the hinges; −1 for a node that is held in space.
    held
        (c, 3) The positions of these nodes at the start [m].
    moved
        ``moved(held, t)`` returns their positions at the time t; None where they stay.
    stiffness
        (h, h) Q [N m].
    flat_gradient
        (h, 4) ∂θ/∂z about flat [1/m].
    find_slots
        Finds blocks in the system matrix, as `bind` of a term gets it.
    pairs
        (p, 2) The pairs of nodes that the term couples.
    n
        The number of nodes.
    panel
        The cloth with its fabrics.
    """

    nodes: np.ndarray
    held: np.ndarray
    moved: Callable[[np.ndarray, float], np.ndarray] | None
    stiffness: sparse.csr_matrix
    flat_gradient: np.ndarray
    find_slots: FindSlots
    pairs: np.ndarray
    n: int
    panel: Panel

    @cached_property
    def rows(self) -> CoupledRows:
        """Where products with Q lie in the system matrix."""
        return CoupledRows.make(self.nodes, self.stiffness, self.find_slots, self.pairs, self.n)

    def nbytes(self, explicit: bool) -> int:
        """Memory of Q, and of the rows of the tangent unless `explicit` [bytes]."""
        rows = 0 if explicit else self.rows.nbytes
        return int(self.stiffness.data.nbytes + self.stiffness.indices.nbytes) + rows

    @cached_property
    def loop(self) -> SharedLoop:
        return SharedLoop.over_elements(self.panel, self.nodes)

    def at(self, t: float) -> tuple:
        """`nodes`, `ghosts` and `first` of the loops over the hinges, at the time t."""
        held = self.held_at(t)
        return self.nodes, held, len(self.nodes) - len(held)

    def held_at(self, t: float) -> np.ndarray:
        """(c, 3) positions of the nodes that are held in space, at the time t [m]."""
        if self.moved is None:
            return self.held
        return self.moved(self.held, t)

    def energy(self, x: np.ndarray, t: float, rest: np.ndarray) -> float:
        """½ (μ − μ⁰)ᵀ Q (μ − μ⁰) [J] for the measures μ⁰ at rest."""
        change = self.measures(x, t) - rest
        return 0.5 * plate_loops.sum_products(self.loop.select(change), self.stiffness @ change)

    def measures(self, x: np.ndarray, t: float) -> np.ndarray:
        """μ (h,)."""
        mu = np.zeros(len(self.nodes))
        self.loop.each(partial(self._measures, x, t, mu))
        return mu

    def _measures(self, x: np.ndarray, t: float, mu: np.ndarray, part: slice) -> Call:
        nodes, held, first = self.at(t)
        own = nodes[part], held, first - part.start, x, 1.0, mu[part]
        return plate_loops.add_measures, own

    def measures_call(self, x: np.ndarray, t: float, mu: np.ndarray) -> SharedCall:
        return self.loop.shared_each(partial(self._measures, x, t, mu))

    def moments_call(self, change: np.ndarray, moment: np.ndarray) -> SharedCall:
        """The call that writes m = Q change (h,) [N m] to `moment`."""

        def call(part: slice) -> Call:
            row = pointers(self.stiffness, part), self.stiffness.indices, self.stiffness.data
            return plate_loops.fill_moments, (*row, change, moment[part])

        return self.loop.shared_each(call)

    def gradients(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """μ (h,) and ∂μ/∂x (h, 4, 3)."""
        mu = np.empty(len(self.nodes))
        g = np.empty((len(self.nodes), 4, 3))
        self.loop.each(partial(self._gradients, x, t, mu, g))
        return mu, g

    def _gradients(
        self, x: np.ndarray, t: float, mu: np.ndarray, g: np.ndarray, part: slice
    ) -> Call:
        nodes, held, first = self.at(t)
        own = nodes[part], held, first - part.start, x, mu[part], g[part]
        return plate_loops.fill_gradients, own

    def gradient_call(self, x: np.ndarray, t: float, mu: np.ndarray, g: np.ndarray) -> SharedCall:
        return self.loop.shared_each(partial(self._gradients, x, t, mu, g))

    def rates(self, g: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(h,) dμ/dt [1/s]."""
        rate = np.zeros(len(self.nodes))
        self.loop.each(partial(self._rates, g, v, rate))
        return rate

    def _rates(self, g: np.ndarray, v: np.ndarray, rate: np.ndarray, part: slice) -> Call:
        return plate_loops.add_rates, (self.nodes[part], g[part], v, rate[part])

    def rate_call(self, g: np.ndarray, v: np.ndarray, rate: np.ndarray) -> SharedCall:
        return self.loop.shared_each(partial(self._rates, g, v, rate))

    def add_force(
        self, change: np.ndarray, g: np.ndarray, f: np.ndarray, matrix: Any = None
    ) -> None:
        """f −= Σ m g with the moments m = Q change [N m], and g (h, 4, 3) [1/m].

        A `matrix` (h, …) stands in place of Q.
        """
        self.loop.add(partial(self._force, change, g, matrix=matrix), f)

    def force_call(self, change: np.ndarray, g: np.ndarray, f: np.ndarray) -> SharedCall:
        return self.loop.shared_add(partial(self._force, change, g), f)

    def _force(
        self, change: np.ndarray, g: np.ndarray, part: slice, f: np.ndarray, matrix: Any = None
    ) -> Call:
        Q = self.stiffness if matrix is None else matrix
        row = pointers(Q, part), Q.indices, Q.data
        return plate_loops.add_force, (self.nodes[part], *row, change, g[part], f)

    def add_products(
        self, left: np.ndarray, right: np.ndarray, scale: float, J, entries: Any = None
    ) -> None:
        """J += scale leftᵀ Q right, with left and right (h, 4, 3).

        `entries`, in the order of the entries of Q, are taken in their place.
        """
        self.loop.add_blocks(partial(self._products, left, right, scale, entries), J)

    def products_call(
        self, left: np.ndarray, right: np.ndarray, scale: float | Present, J: BlockMatrix
    ) -> SharedCall:
        return self.loop.shared_add_blocks(partial(self._products, left, right, scale, None), J)

    def _products(
        self,
        left: np.ndarray,
        right: np.ndarray,
        scale: float | Present,
        entries: Any,
        part: slice,
        blocks: np.ndarray,
    ) -> Call:
        Q = self.stiffness
        rows = self.rows
        of_Q = pointers(Q, part), Q.indices, Q.data if entries is None else entries
        of_rows = rows.place, rows.start[part], rows.width[part], rows.slots
        work = np.empty((rows.width.max(initial=0), 4))
        arguments = *of_Q, *of_rows, left[part], right, scale, work, blocks
        return plate_loops.add_products, arguments

    def add_curvatures(self, x: np.ndarray, t: float, moment: np.ndarray, scale: float, J) -> None:
        """J += scale Σ m ∂²μ/∂x∂x at x and t, for the moments m (h,) = `moment` [N m]."""
        self.loop.add_blocks(partial(self._curvatures, x, t, moment, scale), J)

    def curvatures_call(
        self, x: np.ndarray, t: float, moment: np.ndarray, scale: float | Present, J: BlockMatrix
    ) -> SharedCall:
        return self.loop.shared_add_blocks(partial(self._curvatures, x, t, moment, scale), J)

    def _curvatures(
        self,
        x: np.ndarray,
        t: float,
        moment: np.ndarray,
        scale: float | Present,
        part: slice,
        values: np.ndarray,
    ) -> Call:
        rows = self.rows
        nodes, held, first = self.at(t)
        # The clamped edges begin at `first`; the kernel counts from the begin of the part.
        of_hinges = nodes[part], held, first - part.start, x
        of_rows = rows.place, *cut((rows.own, rows.start, rows.width), part), rows.slots
        arguments = *of_hinges, *of_rows, moment[part], scale, values
        return plate_loops.add_curvatures, arguments

    def work_of_clamps(
        self, old: At, new: At, stages: Sequence[At], moments: Callable[[np.ndarray], np.ndarray]
    ) -> float:
        """Work [J] that moves the normals of clamps over a step: the mean of ∂W/∂p, times Δp.

        p are the points in space that stand for the normals.

        Parameters
        ----------
        old, new
            Positions and time (x, t) at the ends of the step.
        stages
            The (x, t) over which the mean is taken.
        moments
            ``moments(μ)`` returns ∂W/∂μ (h,) [N m].
        """
        if self.moved is None:
            return 0.0
        (_, begin), (_, end) = old, new
        motion = self.held_at(end) - self.held_at(begin)
        first = len(self.nodes) - len(self.held)  # of the clamped edges, which are the last
        force = np.zeros_like(motion)
        for x, t in stages:
            mu, g = self.gradients(x, t)
            # A point in space is the fourth node of its edge.
            force += self.loop.select(moments(mu))[first:, None] * g[first:, 3]
        return float(np.sum(force * motion)) / len(stages)


def bind_angles(panel: Panel, slots: FindSlots, where: str) -> PlateAngles:
    """The hinge angles of a panel, coupled by the stiffness of its plate.

    `slots` finds blocks in the system matrix. Raises `InputError`, for the term `where`, for a
    fabric without a bending rigidity.
    """
    slopes = panel.cloth.edge_slopes
    _, Q = panel_plate(panel, where)
    nodes = slopes.edges.hinges.nodes
    gradient = slopes.edges.hinges.flat_gradient
    held = np.empty((0, 3))
    moved = None
    if panel.clamps:
        # Half-edge 3 e + i is edge i of triangle e. Its two nodes come first, then the apex.
        triangles, edge = np.divmod(panel.clamps.half_edges, 3)
        corners = slopes.edges.triangles[triangles[:, None], (edge[:, None] + np.arange(3)) % 3]
        # A clamped edge is a hinge with a triangle in space, whose apex is no node.
        in_space = np.full((len(corners), 1), -1, np.int32)
        clamped = np.hstack([corners, in_space]).astype(np.int32)
        nodes = np.concatenate([nodes, clamped])
        moved = panel.clamps.moved
        gradient = np.concatenate([gradient, clamped_gradient(panel.cloth.X[corners])])
        held = panel.clamps.points
    return PlateAngles(
        nodes=nodes,
        held=held,
        moved=moved,
        stiffness=Q,
        flat_gradient=gradient,
        find_slots=slots,
        pairs=slopes.pairs,
        n=len(panel.cloth.X),
        panel=panel,
    )


def pointers(matrix: sparse.csr_matrix, part: slice) -> np.ndarray:
    """Where the entries of a range of rows begin, and where the last of them ends."""
    return matrix.indptr[part.start : part.stop + 1]
