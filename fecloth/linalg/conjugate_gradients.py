"""The compiled loop of conjugate gradients, which threads share to the same bits.

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, algorithm 9.1 (PCG)
and section 4.1.1 (block Jacobi). Matrices are given as the block rows of a `BlockMatrix`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fecloth.jit import Array, inner, kernel
from fecloth.thread_meeting import meet

BLOCK = 256  # nodes whose sums are added up first, for the same bits on any number of threads
CONVERGED, NOT_FINITE, INDEFINITE, OUT_OF_ITERATIONS = range(4)


@kernel
def conjugate_gradients(
    indptr: Array,
    indices: Array,
    values: Array,
    inverse: Array,
    x: Array,
    r: Array,
    z: Array,
    p: Array,
    q: Array,
    sums: Array,
    carry: Array,
    threshold: float,
    limit: int,
    meeting: Array,
    thread: int,
    threads: int,
) -> tuple[int, int]:
    """Iterate until ‖r‖² <= threshold, with r from its recurrence, or for `limit` iterations.

    Each thread calls it with its number, and does the rows of its blocks of nodes.

    Parameters
    ----------
    inverse
        (n, 6) M⁻¹, the inverses of the diagonal blocks; see `invert_blocks`.
    x, r
        (n, 3) initial x and its residual b − A x; both are overwritten.
    z, p, q
        (n, 3) work arrays for M⁻¹ r, the search direction p, and A p.
    sums
        (3, blocks) work array for the sums pᵀ q, rᵀ z and rᵀ r of each block.
    carry
        (3,) rᵀ z, rᵀ r and β where an earlier call ended at its limit; or rᵀ z < 0.

    Returns
    -------
    The number of iterations and one of CONVERGED, NOT_FINITE, INDEFINITE, OUT_OF_ITERATIONS.
    """
    blocks = sums.shape[1]
    begin, end, round_ = blocks * thread // threads, blocks * (thread + 1) // threads, 1
    rz, rr, beta = carry[0], carry[1], carry[2]
    if rz < 0.0:
        beta = 0.0
        for block in range(begin, end):
            first, last = _nodes(block, len(x))
            sums[1, block], sums[2, block] = _advance(first, last, 0.0, p, q, inverse, x, r, z)
        round_ = meet(meeting, threads, round_)
        rz, rr = _total(sums[1]), _total(sums[2])
    status = CONVERGED if rr <= threshold else OUT_OF_ITERATIONS
    j = 0
    while j < limit and status == OUT_OF_ITERATIONS:
        _turn(begin * BLOCK, min(end * BLOCK, len(p)), z, beta, p)
        round_ = meet(meeting, threads, round_)
        for block in range(begin, end):
            first, last = _nodes(block, len(x))
            sums[0, block] = _multiply(first, last, indptr, indices, values, p, q)
        round_ = meet(meeting, threads, round_)
        pq = _total(sums[0])
        if not np.isfinite(pq) or not np.isfinite(rz):
            status = NOT_FINITE
        elif pq <= 0.0 or rz <= 0.0:
            status = INDEFINITE
        else:
            old, alpha = rz, rz / pq
            for block in range(begin, end):
                first, last = _nodes(block, len(x))
                sums[1, block], sums[2, block] = _advance(
                    first, last, alpha, p, q, inverse, x, r, z
                )
            round_ = meet(meeting, threads, round_)
            rz, rr = _total(sums[1]), _total(sums[2])
            beta = rz / old
            j += 1
            status = CONVERGED if rr <= threshold else OUT_OF_ITERATIONS
    meet(meeting, threads, round_)  # all have read `carry`
    if thread == 0:
        carry[0], carry[1], carry[2] = rz, rr, beta
    return j, status


@inner
def _total(sums: Array) -> float:
    """Sum in order."""
    total = 0.0
    for block in range(len(sums)):
        total += sums[block]
    return total


@kernel
def turn(z: Array, beta: float, p: Array) -> None:
    """p = z + β p; with β = 0 the old p is not used, because it may be not finite."""
    _turn(0, len(p), z, beta, p)


@kernel
def multiply(indptr: Array, indices: Array, values: Array, p: Array, q: Array) -> float:
    """q = A p; returns pᵀ q."""
    return _multiply(0, len(p), indptr, indices, values, p, q)


@kernel
def advance(alpha: float, p: Array, q: Array, x: Array, r: Array) -> float:
    """x += α p, r −= α q; returns rᵀ r."""
    rr = 0.0
    for i in range(len(x)):
        rr += _advance_node(i, alpha, p, q, x, r)
    return rr


@inner
def _nodes(block: int, n: int) -> tuple[int, int]:
    """The first node of a block, and the end."""
    return block * BLOCK, min(block * BLOCK + BLOCK, n)


@inner
def _turn(begin: int, end: int, z: Array, beta: float, p: Array) -> None:
    """`turn` of nodes begin … end − 1."""
    for node in range(begin, end):
        i = np.uintp(node)  # not negative: the compiler need not look
        for c in range(3):
            p[i, c] = z[i, c] + beta * p[i, c] if beta != 0.0 else z[i, c]


@inner
def _multiply(
    begin: int, end: int, indptr: Array, indices: Array, values: Array, p: Array, q: Array
) -> float:
    """`multiply` of rows begin … end − 1."""
    pq = 0.0
    for node in range(begin, end):
        i = np.uintp(node)
        q1 = q2 = q3 = 0.0
        for s in range(indptr[i], indptr[i + 1]):
            j = indices[s]
            p1, p2, p3 = p[j, 0], p[j, 1], p[j, 2]
            q1 += values[s, 0, 0] * p1 + values[s, 0, 1] * p2 + values[s, 0, 2] * p3
            q2 += values[s, 1, 0] * p1 + values[s, 1, 1] * p2 + values[s, 1, 2] * p3
            q3 += values[s, 2, 0] * p1 + values[s, 2, 1] * p2 + values[s, 2, 2] * p3
        q[i, 0], q[i, 1], q[i, 2] = q1, q2, q3
        pq += p[i, 0] * q1 + p[i, 1] * q2 + p[i, 2] * q3
    return pq


@inner
def _advance(
    begin: int,
    end: int,
    alpha: float,
    p: Array,
    q: Array,
    inverse: Array,
    x: Array,
    r: Array,
    z: Array,
) -> tuple[float, float]:
    """x += α p, r −= α q, z = M⁻¹ r of nodes begin … end − 1; returns rᵀ z and rᵀ r."""
    rz = rr = 0.0
    for node in range(begin, end):
        i = np.uintp(node)
        rr += _advance_node(i, alpha, p, q, x, r)
        r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
        m = inverse[i]
        z1 = m[0] * r1 + m[5] * r2 + m[4] * r3
        z2 = m[5] * r1 + m[1] * r2 + m[3] * r3
        z3 = m[4] * r1 + m[3] * r2 + m[2] * r3
        z[i, 0], z[i, 1], z[i, 2] = z1, z2, z3
        rz += r1 * z1 + r2 * z2 + r3 * z3
    return rz, rr


@inner
def _advance_node(i: Any, alpha: float, p: Array, q: Array, x: Array, r: Array) -> float:
    """Node i of `advance`; with α = 0 the old p and q are not used, as they may be not finite."""
    if alpha != 0.0:
        for c in range(3):
            x[i, c] += alpha * p[i, c]
            r[i, c] -= alpha * q[i, c]
    r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
    rr: float = r1 * r1 + r2 * r2 + r3 * r3
    return rr
