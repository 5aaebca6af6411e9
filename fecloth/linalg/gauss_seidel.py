"""Gauss–Seidel sweeps over the blocks of a `BlockMatrix`, one colour of nodes after the other.

Nodes of one colour are not coupled, so that the result does not depend on their order, nor on
the threads among which they may be shared. Vectors and matrix are stored in the order of the
sweep: with the mesh's order each colour would read most of the memory of all nodes.

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, sections 4.1.1
(block relaxation) and 12.4.3 (multicolouring).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.compiled.jit import Array, inner, kernel
from fecloth.compiled.threads import Member, part_of, wait
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern


@dataclass(frozen=True)
class SweepOrder:
    """The nodes of a pattern by colours, and its blocks in the same order.

    The node at place q has the blocks indptr[q] … indptr[q + 1] − 1 in columns of earlier
    colours, and the blocks indptr[n + q] … indptr[n + q + 1] − 1 in columns of later colours. So
    L and U are apart in memory. Blocks on the diagonal are left out.

    Attributes
    ----------
    nodes, places
        (n,) int32 node at each place, and place of each node.
    starts
        (colours + 1,) int32 first place of each colour, and n.
    indptr
        (2n + 1,) int32 first block of each row of L, and then of U.
    indices
        (b − n,) int32 place of the column of each block.
    slots
        (b − n,) int32 number of each block in the pattern.
    """

    nodes: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    slots: np.ndarray

    @classmethod
    def from_pattern(cls, pattern: BlockPattern) -> Self:
        """Colour the nodes of a pattern, and sort its nodes and blocks by colours.

        Each node gets the first colour that no neighbour has. Within a colour nodes keep the
        order of the mesh.
        """
        n = len(pattern)
        colours = _colour(pattern.indptr, pattern.indices)
        nodes = np.argsort(colours, kind="stable").astype(np.int32)
        places = np.empty(n, np.int32)
        places[nodes] = np.arange(n, dtype=np.int32)
        starts = np.searchsorted(colours[nodes], np.arange(colours.max() + 2)).astype(np.int32)
        difference = colours[pattern.indices] - colours[pattern.rows]
        # coupled nodes differ in colour: without a difference a block is on the diagonal
        off_diagonal = np.flatnonzero(difference)
        is_later = difference[off_diagonal] > 0  # it belongs to U
        row = places[pattern.rows][off_diagonal] + n * is_later  # the row of L, or n + row of U
        slots = off_diagonal[np.argsort(row, kind="stable")].astype(np.int32)
        indptr = np.append(0, np.cumsum(np.bincount(row, minlength=2 * n))).astype(np.int32)
        return cls(
            nodes=nodes,
            places=places,
            starts=starts,
            indptr=indptr,
            indices=places[pattern.indices[slots]],
            slots=slots,
        )

    def gather(self, A: BlockMatrix, values: np.ndarray) -> None:
        """Write the blocks of A in this order to `values` (b − n, 3, 3)."""
        n = len(self.slots)
        A.team.each(n, lambda at: (_gather, (self.slots[at], A.values, values[at])), n)


@kernel
def _colour(indptr: Array, indices: Array) -> Array:
    """Return the colour of each node of a pattern, (n,) int32, numbered from 0 on.

    Each node in turn gets the first colour that none of its neighbours has.
    """
    colours = np.full(len(indptr) - 1, -1, np.int32)
    last = np.full(len(colours), -1)  # of each colour: the last node with a neighbour that has it
    for i in range(len(colours)):
        for j in indices[indptr[i] : indptr[i + 1]]:
            if colours[j] >= 0:
                last[colours[j]] = i
        colour = 0
        while last[colour] == i:
            colour += 1
        colours[i] = colour
    return colours


@kernel
def _gather(at: Array, blocks: Array, gathered: Array) -> None:
    """gathered[t] = blocks[at[t]] of (3, 3)."""
    for t in range(len(at)):
        for c in range(3):
            for d in range(3):
                gathered[t, c, d] = blocks[at[t], c, d]


@inner
def permute(at: Array, rows: Array, permuted: Array, member: Member) -> None:
    """permuted[q] = rows[at[q]] of (n, 3)."""
    begin, end = part_of(member, 0, len(at))
    for q in range(begin, end):
        i = at[q]
        permuted[q, 0] = rows[i, 0]
        permuted[q, 1] = rows[i, 1]
        permuted[q, 2] = rows[i, 2]


@inner
def permute_back(at: Array, permuted: Array, rows: Array, member: Member) -> None:
    """rows[at[q]] = permuted[q] of (n, 3)."""
    begin, end = part_of(member, 0, len(at))
    for q in range(begin, end):
        i = at[q]
        rows[i, 0] = permuted[q, 0]
        rows[i, 1] = permuted[q, 1]
        rows[i, 2] = permuted[q, 2]


@inner
def sweep_forward(
    starts: Array, indptr: Array, indices: Array, values: Array, inverse: Array, b: Array,
    x: Array, member: Member,
) -> None:  # fmt: skip
    """x = (D + L)⁻¹ b: a sweep from x = 0, with A = L + D + U in the order of the colours.

    `values` are the blocks from `gather`, `inverse` (n, 6) is D⁻¹, see `pcg.invert_blocks`,
    and b and x are (n, 3), all in the order of a `SweepOrder`.
    """
    for colour in range(len(starts) - 1):
        begin, end = part_of(member, starts[colour], starts[colour + 1])
        for q in range(begin, end):
            r = _subtract(indices, values, indptr[q], indptr[q + 1], b[q, 0], b[q, 1], b[q, 2], x)
            _divide(inverse[q], r, x[q])
        wait(member)


@inner
def sweep_residual(
    starts: Array, indptr: Array, indices: Array, values: Array, x: Array, r: Array,
    member: Member,
) -> None:  # fmt: skip
    """r = b − A x = −U x for the x of `sweep_forward`, which satisfies (D + L) x = b.

    The parameters are as there. The threads divide each colour, because the early colours have
    most of U.
    """
    n = len(x)
    for colour in range(len(starts) - 1):
        begin, end = part_of(member, starts[colour], starts[colour + 1])
        for q in range(begin, end):
            first = indptr[n + q]
            last = indptr[n + q + 1]
            r[q, 0], r[q, 1], r[q, 2] = _subtract(indices, values, first, last, 0.0, 0.0, 0.0, x)
    wait(member)


@inner
def sweep_backward(
    starts: Array, indptr: Array, indices: Array, values: Array, inverse: Array, b: Array,
    x: Array, member: Member,
) -> None:  # fmt: skip
    """x ← (D + U)⁻¹ (b − L x), in place, from the last colour to the first.

    The parameters are as in `sweep_forward`. Within a colour the places ascend: this is four
    times as fast as descending places.
    """
    n = len(x)
    for colour in range(len(starts) - 2, -1, -1):
        begin, end = part_of(member, starts[colour], starts[colour + 1])
        for q in range(begin, end):
            r = _subtract(indices, values, indptr[q], indptr[q + 1], b[q, 0], b[q, 1], b[q, 2], x)
            r = _subtract(indices, values, indptr[n + q], indptr[n + q + 1], r[0], r[1], r[2], x)
            _divide(inverse[q], r, x[q])
        wait(member)


@inner
def _subtract(
    indices: Array, values: Array, first: int, end: int, y1: float, y2: float, y3: float,
    x: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """y − Σ A_s x_j over the blocks from `first` to before `end`."""
    for s in range(first, end):
        j = indices[s]
        x1, x2, x3 = x[j, 0], x[j, 1], x[j, 2]
        y1 -= values[s, 0, 0] * x1 + values[s, 0, 1] * x2 + values[s, 0, 2] * x3
        y2 -= values[s, 1, 0] * x1 + values[s, 1, 1] * x2 + values[s, 1, 2] * x3
        y3 -= values[s, 2, 0] * x1 + values[s, 2, 1] * x2 + values[s, 2, 2] * x3
    return y1, y2, y3


@inner
def _divide(m: Array, r: tuple[float, float, float], x: Array) -> None:
    """x (3,) = D⁻¹ r, with the entries 11, 22, 33, 23, 13, 12 of D⁻¹."""
    x[0] = m[0] * r[0] + m[5] * r[1] + m[4] * r[2]
    x[1] = m[5] * r[0] + m[1] * r[1] + m[3] * r[2]
    x[2] = m[4] * r[0] + m[3] * r[1] + m[2] * r[2]
