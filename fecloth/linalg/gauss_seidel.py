"""Gauss–Seidel sweeps over the blocks of a `BlockMatrix`, one colour of nodes after the other.

Nodes of one colour are not coupled, so that the result does not depend on their order, nor on the
threads among which they may be shared. Vectors and matrix are stored in the order of the sweep.
With the mesh's order each colour would read most of the memory of all nodes: a sweep over 100,000
nodes took four times as long.

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, sections 4.1.1 (block
relaxation) and 12.4.3 (multicolouring).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.jit import Array, inner, kernel
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern


@dataclass(frozen=True)
class SweepOrder:
    """The nodes of a pattern by colours, and its blocks in the same order.

    For place q of the order, blocks indptr[q] … indptr[q + 1] − 1 are those in columns of earlier
    colours, and indptr[n + q] … indptr[n + q + 1] − 1 those of later ones: L and U are apart in
    memory. Those on the diagonal are left out.

    Attributes
    ----------
    nodes, places
        (n,) int32 node at each place, and place of each node.
    starts
        (colours + 1,) int32 first place of each colour, and n.
    indptr
        (2n + 1,) int32.
    indices, slots
        (b − n,) int32 place of the column of these blocks, and their numbers in the pattern.
    """

    nodes: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    slots: np.ndarray

    @classmethod
    def of(cls, pattern: BlockPattern) -> SweepOrder:
        """Colour the nodes greedily, each with the first colour that no neighbour has."""
        n, colours = len(pattern), np.full(len(pattern), -1, np.int32)
        _colour(pattern.indptr, pattern.indices, colours)
        nodes = np.argsort(colours, kind="stable").astype(np.int32)
        places = np.empty(n, np.int32)
        places[nodes] = np.arange(n, dtype=np.int32)
        starts = np.searchsorted(colours[nodes], np.arange(colours.max() + 2)).astype(np.int32)
        indptr, slots = np.zeros(2 * n + 1, np.int32), np.empty(len(pattern.indices) - n, np.int32)
        _split(pattern.indptr, pattern.indices, colours, nodes, indptr, slots)
        return cls(nodes, places, starts, indptr, places[pattern.indices[slots]], slots)

    def gather(self, A: BlockMatrix, values: np.ndarray) -> None:
        """Write the blocks of A in this order to `values` (b − n, 3, 3)."""
        _gather(self.slots, A.values, values)

    def permute(self, b: np.ndarray, sorted_b: np.ndarray) -> None:
        """Write the rows of b (n, 3 or 6) in this order."""
        _permute(self.nodes, b, sorted_b)

    def permute_back(self, sorted_x: np.ndarray, x: np.ndarray) -> None:
        """Write rows that are in this order in the order of the pattern."""
        _permute(self.places, sorted_x, x)

    def forward(
        self, values: np.ndarray, inverse: np.ndarray, b: np.ndarray, x: np.ndarray
    ) -> None:
        """x = (D + L)⁻¹ b: a sweep from x = 0; A = L + D + U in the order of colours.

        Parameters
        ----------
        values
            The blocks from `gather`.
        inverse
            (n, 6) D⁻¹ in this order; see `diagonal_blocks`.
        b, x
            (n, 3) right-hand side and output, in this order.
        """
        _forward(self.indptr, self.indices, values, inverse, b, x)

    def residual(self, values: np.ndarray, x: np.ndarray, r: np.ndarray) -> None:
        """r = b − A x = −U x for the x of `forward`."""
        _residual(self.indptr, self.indices, values, x, r)

    def backward(
        self, values: np.ndarray, inverse: np.ndarray, b: np.ndarray, x: np.ndarray
    ) -> None:
        """x ← (D + U)⁻¹ (b − L x), in place."""
        _backward(self.starts, self.indptr, self.indices, values, inverse, b, x)


@kernel
def _colour(indptr: Array, indices: Array, colours: Array) -> None:
    """Number the colours in `colours`, −1 at first."""
    last = np.full(len(colours), -1)  # the last node with a neighbour of this colour
    for i in range(len(colours)):
        for j in indices[indptr[i] : indptr[i + 1]]:
            if colours[j] >= 0:
                last[colours[j]] = i
        colour = 0
        while last[colour] == i:
            colour += 1
        colours[i] = colour


@kernel
def _split(
    indptr: Array, indices: Array, colours: Array, nodes: Array, new_indptr: Array, slots: Array
) -> None:
    """Write the blocks of each row in columns of earlier colours, then those of later ones."""
    k, n = 0, len(nodes)
    for side in (0, 1):
        for q in range(n):
            i = nodes[q]
            for s in range(indptr[i], indptr[i + 1]):
                other = colours[indices[s]]
                if (other < colours[i]) if side == 0 else (other > colours[i]):
                    slots[k] = s
                    k += 1
            new_indptr[side * n + q + 1] = k


@kernel
def _gather(slots: Array, values: Array, gathered: Array) -> None:
    for t in range(len(slots)):
        s = slots[t]
        for c in range(3):
            for d in range(3):
                gathered[t, c, d] = values[s, c, d]


@kernel
def _permute(order: Array, rows: Array, permuted: Array) -> None:
    for q in range(len(order)):
        i = order[q]
        for c in range(rows.shape[1]):
            permuted[q, c] = rows[i, c]


@kernel
def _forward(
    indptr: Array, indices: Array, values: Array, inverse: Array, b: Array, x: Array
) -> None:
    for q in range(len(x)):
        r = _subtract(indices, values, indptr[q], indptr[q + 1], b[q, 0], b[q, 1], b[q, 2], x)
        _divide(inverse[q], r, x[q])


@kernel
def _residual(indptr: Array, indices: Array, values: Array, x: Array, r: Array) -> None:
    n = len(x)
    for q in range(n):
        first, end = indptr[n + q], indptr[n + q + 1]
        r[q, 0], r[q, 1], r[q, 2] = _subtract(indices, values, first, end, 0.0, 0.0, 0.0, x)


@kernel
def _backward(
    starts: Array, indptr: Array, indices: Array, values: Array, inverse: Array, b: Array, x: Array
) -> None:
    """Sweep over the colours from the last one; ascending places in a colour are four times as fast
    as descending ones."""
    n = len(x)
    for colour in range(len(starts) - 2, -1, -1):
        for q in range(starts[colour], starts[colour + 1]):
            r = _subtract(indices, values, indptr[q], indptr[q + 1], b[q, 0], b[q, 1], b[q, 2], x)
            r = _subtract(indices, values, indptr[n + q], indptr[n + q + 1], r[0], r[1], r[2], x)
            _divide(inverse[q], r, x[q])


@inner
def _subtract(
    indices: Array,
    values: Array,
    first: int,
    end: int,
    y1: float,
    y2: float,
    y3: float,
    x: Array,
) -> tuple[float, float, float]:
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
