"""Gauss–Seidel sweeps over the blocks of a `BlockMatrix`, one colour of nodes after the other.

Nodes of one colour are not coupled, so that the result does not depend on their order, nor on the
threads among which they may be shared.

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
    """The nodes of a pattern by colours, and the blocks of each row in the same order.

    Attributes
    ----------
    nodes
        (n,) int32 node of each row.
    indptr, middle
        (n + 1,), (n,) int32. Row q has the blocks indptr[q] … middle[q] − 1 in columns of earlier
        colours, and from there to indptr[q + 1] − 1 those of later ones.
    indices, slots
        (b − n,) int32 column of these blocks, and their numbers in the pattern. Those on the
        diagonal are left out.
    """

    nodes: np.ndarray
    indptr: np.ndarray
    middle: np.ndarray
    indices: np.ndarray
    slots: np.ndarray

    @classmethod
    def of(cls, pattern: BlockPattern) -> SweepOrder:
        """Colour the nodes greedily, each with the first colour that no neighbour has."""
        colours = np.full(len(pattern), -1, np.int32)
        _colour(pattern.indptr, pattern.indices, colours)
        nodes = np.argsort(colours, kind="stable").astype(np.int32)
        indptr = np.zeros(len(nodes) + 1, np.int32)
        indptr[1:] = np.cumsum(np.diff(pattern.indptr)[nodes] - 1)
        middle, slots = np.empty(len(nodes), np.int32), np.empty(indptr[-1], np.int32)
        _split(pattern.indptr, pattern.indices, colours, nodes, indptr, middle, slots)
        return cls(nodes, indptr, middle, pattern.indices[slots], slots)

    def gather(self, A: BlockMatrix, kind: type) -> np.ndarray:
        """(b − n, 3, 3) the blocks of A in this order, of type np.float32 or np.float64."""
        values: np.ndarray = np.empty((len(self.slots), 3, 3), kind)
        _gather(self.slots, A.values, values)
        return values

    def forward(
        self, values: np.ndarray, inverse: np.ndarray, b: np.ndarray, x: np.ndarray
    ) -> None:
        """x = (D + L)⁻¹ b: a sweep from x = 0; A = L + D + U in the order of colours.

        Parameters
        ----------
        values
            The blocks from `gather`.
        inverse
            (n, 6) D⁻¹; see `pcg.invert_blocks`.
        b, x
            (n, 3) right-hand side and output.
        """
        _forward(self.nodes, self.indptr, self.middle, self.indices, values, inverse, b, x)

    def residual(self, values: np.ndarray, x: np.ndarray, r: np.ndarray) -> None:
        """r = b − A x = −U x for the x of `forward`."""
        _residual(self.nodes, self.indptr, self.middle, self.indices, values, x, r)

    def backward(
        self, values: np.ndarray, inverse: np.ndarray, b: np.ndarray, x: np.ndarray
    ) -> None:
        """x ← (D + U)⁻¹ (b − L x), in place."""
        _backward(self.nodes, self.indptr, self.indices, values, inverse, b, x)


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
    indptr: Array,
    indices: Array,
    colours: Array,
    nodes: Array,
    new_indptr: Array,
    middle: Array,
    slots: Array,
) -> None:
    """Write the blocks of each row: first those of earlier colours, then those of later ones."""
    for q in range(len(nodes)):
        i, k = nodes[q], new_indptr[q]
        for s in range(indptr[i], indptr[i + 1]):
            if colours[indices[s]] < colours[i]:
                slots[k] = s
                k += 1
        middle[q] = k
        for s in range(indptr[i], indptr[i + 1]):
            if colours[indices[s]] > colours[i]:
                slots[k] = s
                k += 1


@kernel
def _gather(slots: Array, values: Array, gathered: Array) -> None:
    for t in range(len(slots)):
        A = values[slots[t]]
        for c in range(3):
            for d in range(3):
                gathered[t, c, d] = A[c, d]


@kernel
def _forward(
    nodes: Array,
    indptr: Array,
    middle: Array,
    indices: Array,
    values: Array,
    inverse: Array,
    b: Array,
    x: Array,
) -> None:
    for q in range(len(nodes)):
        i = nodes[q]
        r = _row(indices, values, indptr[q], middle[q], x)
        _divide(inverse[i], b[i, 0] - r[0], b[i, 1] - r[1], b[i, 2] - r[2], x[i])


@kernel
def _residual(
    nodes: Array, indptr: Array, middle: Array, indices: Array, values: Array, x: Array, r: Array
) -> None:
    for q in range(len(nodes)):
        i = nodes[q]
        u = _row(indices, values, middle[q], indptr[q + 1], x)
        r[i, 0], r[i, 1], r[i, 2] = -u[0], -u[1], -u[2]


@kernel
def _backward(
    nodes: Array, indptr: Array, indices: Array, values: Array, inverse: Array, b: Array, x: Array
) -> None:
    for q in range(len(nodes) - 1, -1, -1):
        i = nodes[q]
        r = _row(indices, values, indptr[q], indptr[q + 1], x)
        _divide(inverse[i], b[i, 0] - r[0], b[i, 1] - r[1], b[i, 2] - r[2], x[i])


@inner
def _row(
    indices: Array, values: Array, first: int, end: int, x: Array
) -> tuple[float, float, float]:
    """Σ A_s x_j over the blocks from `first` to before `end`."""
    y1 = y2 = y3 = 0.0
    for s in range(first, end):
        j = indices[s]
        x1, x2, x3 = x[j, 0], x[j, 1], x[j, 2]
        y1 += values[s, 0, 0] * x1 + values[s, 0, 1] * x2 + values[s, 0, 2] * x3
        y2 += values[s, 1, 0] * x1 + values[s, 1, 1] * x2 + values[s, 1, 2] * x3
        y3 += values[s, 2, 0] * x1 + values[s, 2, 1] * x2 + values[s, 2, 2] * x3
    return y1, y2, y3


@inner
def _divide(m: Array, r1: float, r2: float, r3: float, x: Array) -> None:
    """x (3,) = D⁻¹ r, with the entries 11, 22, 33, 23, 13, 12 of D⁻¹."""
    x[0] = m[0] * r1 + m[5] * r2 + m[4] * r3
    x[1] = m[5] * r1 + m[1] * r2 + m[3] * r3
    x[2] = m[4] * r1 + m[3] * r2 + m[2] * r3
