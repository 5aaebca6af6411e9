"""The smoothed prolongator P of an aggregation, and the coarse matrix Pᵀ A P, on fixed patterns.

The source is section 3 of the paper that `aggregation` names.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import Array, inner, kernel
from fecloth.compiled.threads import Member, part_of, wait
from fecloth.linalg.aggregation import Aggregates
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.protocol import block_rows


@dataclass(frozen=True)
class Transfer:
    """The patterns of P, of Pᵀ, of A P and of Pᵀ A P, for one pattern of A.

    P has a block of 3×6 for a node and an aggregate, A P too. Pᵀ A P has four blocks of 3×3 for
    two aggregates: its "nodes" 2a and 2a + 1 are the first and the last three motions of a.
    """

    aggregates: Aggregates  # the aggregates of the pattern of A
    # P by rows.
    indptr: np.ndarray
    indices: np.ndarray
    # P by columns: row and number of the blocks of each aggregate.
    starts: np.ndarray
    rows: np.ndarray
    entries: np.ndarray
    # A P by rows.
    product_indptr: np.ndarray
    product_indices: np.ndarray
    coarse: BlockPattern  # pattern of Pᵀ A P

    @classmethod
    def from_aggregates(cls, pattern: BlockPattern, aggregates: Aggregates) -> Self:
        n, m = len(pattern), len(aggregates)
        A = _ones(pattern.indptr, pattern.indices, (n, n))
        P = _sorted(A @ _ones(np.arange(n + 1, dtype=np.int32), aggregates.of_node, (n, m)))
        product = _sorted(A @ P)
        pairs = _sorted(P.T.tocsr() @ product)
        entries = np.argsort(P.indices, kind="stable").astype(np.int32)
        starts = np.searchsorted(P.indices[entries], np.arange(m + 1)).astype(np.int32)
        rows = np.repeat(np.arange(n, dtype=np.int32), np.diff(P.indptr))[entries]
        coarse = _sorted(sparse.kron(pairs, np.ones((2, 2)), format="csr"))
        return cls(
            aggregates,
            *(P.indptr, P.indices),
            *(starts, rows, entries),
            *(product.indptr, product.indices),
            BlockPattern(coarse.indptr, coarse.indices),
        )

    def prolongator(self, A: BlockMatrix, inverse: Array, damping: float, T: Array) -> Array:
        """P (p, 3, 6) = (I − damping D⁻¹ A) T, with T (n, 3, 6) and D⁻¹ as `inverse` (n, 6)."""
        P = np.zeros((len(self.indices), 3, 6))
        own = inverse, damping, self.aggregates.of_node, T, self.indptr, self.indices
        _on_rows(_smooth, A, (*own, len(self.aggregates), P))
        return P

    def coarse_matrix(self, A: BlockMatrix, P: Array) -> BlockMatrix:
        """Pᵀ A P, with 1 on the diagonal where P has an empty column."""
        m = len(self.aggregates)
        product = np.zeros((len(self.product_indices), 3, 6))
        own = self.product_indptr, self.product_indices
        _on_rows(_multiply, A, (self.indptr, self.indices, P, *own, m, product))
        coarse = BlockMatrix.zeros(self.coarse, A.team)
        data = *(self.starts, self.rows, self.entries), P, *own, product, *block_rows(coarse)
        A.team.each(m, lambda part: (_project, (*data, part.start, part.stop)), m)
        return coarse


def _on_rows(function: Callable[..., None], A: BlockMatrix, data: tuple[Any, ...]) -> None:
    n = len(A.pattern)
    A.team.each(n, lambda part: (function, (*block_rows(A), *data, part.start, part.stop)), n)


def clear_uncoupled(A: BlockMatrix, T: np.ndarray) -> None:
    """Clear the components of T (n, 3, 6) in which a node is coupled to no other, as by a pin."""
    _on_rows(_clear_uncoupled, A, (T,))


def _ones(indptr: np.ndarray, indices: np.ndarray, shape: tuple[int, int]) -> sparse.csr_matrix:
    return sparse.csr_matrix((np.ones(len(indices), np.float32), indices, indptr), shape)


def _sorted(matrix: sparse.csr_matrix) -> sparse.csr_matrix:
    matrix.sort_indices()
    return matrix


@kernel
def _smooth(
    indptr: Array, indices: Array, values: Array, inverse: Array, damping: float, of_node: Array,
    T: Array, p_indptr: Array, p_indices: Array, aggregates: int, P: Array, begin: int, end: int,
) -> None:  # fmt: skip
    """P = T − damping D⁻¹ A T, in rows begin … end − 1."""
    places = np.zeros(aggregates, np.int32)
    for i in range(begin, end):
        for s in range(p_indptr[i], p_indptr[i + 1]):
            places[p_indices[s]] = s
        for s in range(indptr[i], indptr[i + 1]):
            j = indices[s]
            _add_product(values, s, T, j, P, places[of_node[j]])
        q = inverse[i]
        for s in range(p_indptr[i], p_indptr[i + 1]):
            for k in range(6):
                r1, r2, r3 = P[s, 0, k], P[s, 1, k], P[s, 2, k]
                P[s, 0, k] = -damping * (q[0] * r1 + q[5] * r2 + q[4] * r3)
                P[s, 1, k] = -damping * (q[5] * r1 + q[1] * r2 + q[3] * r3)
                P[s, 2, k] = -damping * (q[4] * r1 + q[3] * r2 + q[2] * r3)
        own = places[of_node[i]]
        for c in range(3):
            for k in range(6):
                P[own, c, k] += T[i, c, k]


@kernel
def _multiply(
    indptr: Array, indices: Array, values: Array, p_indptr: Array, p_indices: Array, P: Array,
    q_indptr: Array, q_indices: Array, aggregates: int, product: Array, begin: int, end: int,
) -> None:  # fmt: skip
    """Add rows begin … end − 1 of A P to `product`."""
    places = np.zeros(aggregates, np.int32)
    for i in range(begin, end):
        for s in range(q_indptr[i], q_indptr[i + 1]):
            places[q_indices[s]] = s
        for s in range(indptr[i], indptr[i + 1]):
            j = indices[s]
            for e in range(p_indptr[j], p_indptr[j + 1]):
                _add_product(values, s, P, e, product, places[p_indices[e]])


@inner
def _add_product(A: Array, s: int, B: Array, e: int, C: Array, t: int) -> None:
    """C[t] += A[s] B[e], of shapes (3, 6), (3, 3) and (3, 6)."""
    # Numbers in place of views of the arrays make this three times as fast.
    a11, a12, a13 = A[s, 0, 0], A[s, 0, 1], A[s, 0, 2]
    a21, a22, a23 = A[s, 1, 0], A[s, 1, 1], A[s, 1, 2]
    a31, a32, a33 = A[s, 2, 0], A[s, 2, 1], A[s, 2, 2]
    for k in range(6):
        b1, b2, b3 = B[e, 0, k], B[e, 1, k], B[e, 2, k]
        C[t, 0, k] += a11 * b1 + a12 * b2 + a13 * b3
        C[t, 1, k] += a21 * b1 + a22 * b2 + a23 * b3
        C[t, 2, k] += a31 * b1 + a32 * b2 + a33 * b3


@kernel
def _project(
    starts: Array, rows: Array, entries: Array, P: Array, q_indptr: Array, q_indices: Array,
    product: Array, indptr: Array, indices: Array, values: Array, begin: int, end: int,
) -> None:  # fmt: skip
    """Pᵀ (A P) in the rows of aggregates begin … end − 1."""
    places = np.zeros(len(starts) - 1, np.int32)
    sums = np.empty((np.diff(indptr).max() // 2, 6, 6))  # a row of blocks, one after the other
    for a in range(begin, end):
        first, width = indptr[2 * a], indptr[2 * a + 1] - indptr[2 * a]
        for u in range(width // 2):
            places[indices[first + 2 * u] // 2] = u
            sums[u] = 0.0
        for t in range(starts[a], starts[a + 1]):
            p, i = entries[t], rows[t]
            for e in range(q_indptr[i], q_indptr[i + 1]):
                _add_transposed_product(P, p, product, e, sums, places[q_indices[e]])
        _fill_empty(sums[places[a]])
        for u in range(width // 2):
            for c in range(6):
                s = first + 2 * u + (c // 3) * width
                for k in range(3):
                    values[s, c % 3, k], values[s + 1, c % 3, k] = sums[u, c, k], sums[u, c, k + 3]


@inner
def _add_transposed_product(P: Array, p: int, Q: Array, e: int, C: Array, u: int) -> None:
    """C[u] += P[p]ᵀ Q[e], of shapes (6, 6), (3, 6) and (3, 6)."""
    for c in range(6):
        p1, p2, p3 = P[p, 0, c], P[p, 1, c], P[p, 2, c]
        for k in range(6):
            C[u, c, k] += p1 * Q[e, 0, k] + p2 * Q[e, 1, k] + p3 * Q[e, 2, k]


@inner
def _fill_empty(block: Array) -> None:
    """Set the diagonal to 1 where a motion of an aggregate is missing, and its row is zero."""
    for c in range(6):
        if block[c, c] == 0.0:
            block[c, c] = 1.0


@inner
def restrict(
    starts: Array, rows: Array, places: Array, columns: Array, r: Array, coarse: Array,
    member: Member,
) -> None:  # fmt: skip
    """coarse (m, 6) = Pᵀ r, by aggregates."""
    # `columns` (p, 3, 6) are the blocks of P by columns; r has the row of node i at places[i].
    begin, end = part_of(member, 0, len(starts) - 1)
    for a in range(begin, end):
        s1 = s2 = s3 = s4 = s5 = s6 = 0.0
        for t in range(starts[a], starts[a + 1]):
            B, i = columns[t], places[rows[t]]
            r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
            s1 += B[0, 0] * r1 + B[1, 0] * r2 + B[2, 0] * r3
            s2 += B[0, 1] * r1 + B[1, 1] * r2 + B[2, 1] * r3
            s3 += B[0, 2] * r1 + B[1, 2] * r2 + B[2, 2] * r3
            s4 += B[0, 3] * r1 + B[1, 3] * r2 + B[2, 3] * r3
            s5 += B[0, 4] * r1 + B[1, 4] * r2 + B[2, 4] * r3
            s6 += B[0, 5] * r1 + B[1, 5] * r2 + B[2, 5] * r3
        coarse[a, 0], coarse[a, 1], coarse[a, 2] = s1, s2, s3
        coarse[a, 3], coarse[a, 4], coarse[a, 5] = s4, s5, s6
    wait(member)


@inner
def add_prolonged(
    indptr: Array, indices: Array, places: Array, P: Array, coarse: Array, x: Array, member: Member
) -> None:
    """x += P coarse, with coarse (m, 6); x has the row of node i at places[i]."""
    begin, end = part_of(member, 0, len(indptr) - 1)
    for i in range(begin, end):
        q = places[i]
        x1, x2, x3 = x[q, 0], x[q, 1], x[q, 2]
        for s in range(indptr[i], indptr[i + 1]):
            y = coarse[indices[s]]
            for k in range(6):
                x1 += P[s, 0, k] * y[k]
                x2 += P[s, 1, k] * y[k]
                x3 += P[s, 2, k] * y[k]
        x[q, 0], x[q, 1], x[q, 2] = x1, x2, x3
    wait(member)


@kernel
def _clear_uncoupled(
    indptr: Array, indices: Array, values: Array, T: Array, begin: int, end: int
) -> None:
    for i in range(begin, end):
        for c in range(3):
            total = 0.0
            for s in range(indptr[i], indptr[i + 1]):
                if indices[s] != i:
                    total += abs(values[s, c, 0]) + abs(values[s, c, 1]) + abs(values[s, c, 2])
            if total == 0.0:
                T[i, c] = 0.0
