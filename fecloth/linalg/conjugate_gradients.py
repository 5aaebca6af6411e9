"""The compiled loop of conjugate gradients, which threads share to the same bits.

The names are as in the book of Saad: r is the residual, z = M⁻¹ r, p the search direction, q = A p,
α = rᵀz / pᵀq and β = (new rᵀz) / (old rᵀz).

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, algorithm 9.1
(PCG) and section 4.1.1 (block Jacobi).
"""

from typing import Any, NamedTuple

import numpy as np

from fecloth.compiled.jit import Array, inner, kernel
from fecloth.compiled.threads import Member, part_of, wait
from fecloth.linalg.products import multiply
from fecloth.linalg.protocol import BlockRows
from fecloth.linalg.reductions import BLOCK, nodes_of, total

CONVERGED, NOT_FINITE, INDEFINITE, OUT_OF_ITERATIONS, STANDS_STILL = range(5)


class Vectors(NamedTuple):
    """The vectors of conjugate gradients besides x, which iterations overwrite.

    Attributes
    ----------
    r
        (n, 3) the residual b − A x.
    z
        (n, 3) M⁻¹ r.
    p
        (n, 4) the search direction; the fourth number is 0.
    q
        (n, 3) A p.
    """

    r: np.ndarray
    z: np.ndarray
    p: np.ndarray
    q: np.ndarray

    @classmethod
    def zeros(cls, n: int, precision: Any = np.float64) -> "Vectors":
        """The vectors of n nodes, all zero."""
        r, z, q = np.zeros((3, n, 3), precision)
        return cls(r, z, np.zeros((n, 4), precision), q)


class Carry(NamedTuple):
    """The numbers that an iteration takes from the iteration before.

    Attributes
    ----------
    rz
        rᵀz; negative before the first iteration.
    rr
        rᵀr.
    beta
        β of the next direction.
    scale
        pᵀM p of the last direction p.
    """

    rz: float
    rr: float
    beta: float
    scale: float


START = Carry(-1.0, 0.0, 0.0, 0.0)


@inner
def conjugate_gradients(
    A: BlockRows, inverse: Array, x: Array, vectors: Vectors, sums: Array, carry: Carry,
    threshold: float, least: float, limit: int, member: Member,
) -> tuple[int, int, Carry]:  # fmt: skip
    """Iterate until ‖r‖² <= threshold, with r from its recurrence, or for `limit` iterations.

    Each thread calls it as its `member`, and does the rows of its blocks of nodes. The arrays
    have one precision, float64 or float32; sums over nodes are in float64.

    Parameters
    ----------
    A
        The matrix.
    inverse
        (n, 6) M⁻¹, see `invert_blocks`.
    x
        (n, 3) the initial x, which is overwritten; ``vectors.r`` is its residual b − A x.
    vectors
        The other vectors.
    sums
        (3, blocks) work array for pᵀq, rᵀz and rᵀr of each block of nodes.
    carry
        `START`, or what an earlier call returned that ended at its limit.
    threshold, limit
        ‖r‖² at the end, and the largest number of iterations.
    least
        The smallest pᵀAp / pᵀMp that is taken for positive.
    member
        The thread.

    Returns
    -------
    tuple
        The number of iterations; CONVERGED, NOT_FINITE, INDEFINITE or OUT_OF_ITERATIONS; and
        the numbers to go on with.
    """
    _, z, p, q = vectors
    begin, end = part_of(member, 0, sums.shape[1])  # this thread's blocks of nodes
    rz, rr, beta, scale = carry
    if rz < 0.0:  # a start: z = M⁻¹ r, without a step
        rz, rr = _advance(begin, end, 0.0, inverse, x, vectors, sums, member)
    status = CONVERGED if rr <= threshold else OUT_OF_ITERATIONS
    j = 0
    while j < limit and status == OUT_OF_ITERATIONS:
        pq = _search(begin, end, A, z, beta, p, q, sums, member)
        # r and the last p are orthogonal, so that pᵀMp has no mixed term
        scale = rz + beta * beta * scale
        status = _check(pq, rz, least * scale)
        if status == OUT_OF_ITERATIONS:
            old_rz = rz
            rz, rr = _advance(begin, end, rz / pq, inverse, x, vectors, sums, member)
            beta = rz / old_rz
            j += 1
            status = CONVERGED if rr <= threshold else OUT_OF_ITERATIONS
    return j, status, Carry(rz, rr, beta, scale)


@kernel
def step(
    A: BlockRows, x: Array, vectors: Vectors, sums: Array, old: float, threshold: float,
    member: Member,
) -> tuple[float, int]:  # fmt: skip
    """Do one iteration with z = M⁻¹ r given, for any preconditioner M, on all threads.

    The parameters are as in `conjugate_gradients`; ``vectors.z`` is M⁻¹ r, and `old` is rᵀz of
    the iteration before, or −1 in the first one. Return rᵀz before the iteration, and CONVERGED,
    NOT_FINITE, INDEFINITE or OUT_OF_ITERATIONS. x, r, p and q are overwritten.
    """
    r, z, p, q = vectors
    begin, end = part_of(member, 0, sums.shape[1])
    for block in range(begin, end):
        first, last = nodes_of(block, len(x))
        sums[1, block] = _dot(first, last, r, z)
    wait(member)
    rz = total(sums[1])
    beta = rz / old if old > 0.0 else 0.0
    pq = _search(begin, end, A, z, beta, p, q, sums, member)
    status = _check(pq, rz, 0.0)
    if status == OUT_OF_ITERATIONS:
        for block in range(begin, end):
            first, last = nodes_of(block, len(x))
            sums[2, block] = _move(first, last, rz / pq, p, q, x, r)
        wait(member)
        if total(sums[2]) <= threshold:
            status = CONVERGED
    return rz, status


@inner
def residual_of(
    begin: int, end: int, A: BlockRows, b: Array, x: Array, vectors: Vectors, sums: Array,
    member: Member,
) -> float:  # fmt: skip
    """r = b − A x in blocks begin … end − 1; returns ‖r‖² of all threads. p becomes x."""
    r, _, p, q = vectors
    for i in range(begin * BLOCK, nodes_of(end - 1, len(x))[1]):
        for c in range(3):
            p[i, c] = x[i, c]
    wait(member)
    for block in range(begin, end):
        first, last = nodes_of(block, len(x))
        multiply(first, last, A, p, q)
        sums[0, block] = 0.0
        for i in range(first, last):
            for c in range(3):
                r[i, c] = b[i, c] - q[i, c]
                sums[0, block] += r[i, c] * r[i, c]
    wait(member)
    return total(sums[0])


@inner
def _search(
    begin: int, end: int, A: BlockRows, z: Array, beta: float, p: Array, q: Array, sums: Array,
    member: Member,
) -> float:  # fmt: skip
    """p = z + β p and q = A p in blocks begin … end − 1; returns pᵀq of all threads."""
    _turn(begin * BLOCK, nodes_of(end - 1, len(p))[1], z, p.dtype.type(beta), p)
    wait(member)
    for block in range(begin, end):
        first, last = nodes_of(block, len(p))
        multiply(first, last, A, p, q)
        sums[0, block] = _dot(first, last, p, q)
    wait(member)
    return total(sums[0])


@inner
def _check(pq: float, rz: float, least: float) -> int:
    """NOT_FINITE or INDEFINITE if pᵀq or rᵀz shows it, else OUT_OF_ITERATIONS."""
    if not np.isfinite(pq) or not np.isfinite(rz):
        return NOT_FINITE
    if pq <= least or rz <= 0.0:
        return INDEFINITE
    return OUT_OF_ITERATIONS


@inner
def _dot(begin: int, end: int, a: Array, b: Array) -> float:
    """Σ a_i · b_i of nodes begin … end − 1."""
    ab = 0.0
    for node in range(begin, end):
        i = np.uintp(node)
        ab += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
    return ab


@inner
def _turn(begin: int, end: int, z: Array, beta: float, p: Array) -> None:
    """p = z + β p of nodes begin … end − 1; with β = 0 the old p may be not finite."""
    for node in range(begin, end):
        i = np.uintp(node)  # not negative: the compiler need not look
        for c in range(3):
            p[i, c] = z[i, c] + beta * p[i, c] if beta != 0.0 else z[i, c]


@inner
def _move(begin: int, end: int, alpha: float, p: Array, q: Array, x: Array, r: Array) -> float:
    """x += α p, r −= α q of nodes begin … end − 1; returns rᵀ r."""
    rr = 0.0
    for node in range(begin, end):
        rr += _advance_node(np.uintp(node), alpha, p, q, x, r)
    return rr


@inner
def _advance(
    begin: int, end: int, alpha: float, inverse: Array, x: Array, vectors: Vectors, sums: Array,
    member: Member,
) -> tuple[float, float]:  # fmt: skip
    """x += α p, r −= α q and z = M⁻¹ r in blocks begin … end − 1; return rᵀz and rᵀr of all."""
    for block in range(begin, end):
        first, last = nodes_of(block, len(x))
        step_length = x.dtype.type(alpha)
        sums[1, block], sums[2, block] = _advance_nodes(
            first, last, step_length, inverse, x, vectors
        )
    wait(member)
    return total(sums[1]), total(sums[2])


@inner
def _advance_nodes(
    begin: int, end: int, alpha: Any, inverse: Array, x: Array, vectors: Vectors
) -> tuple[float, float]:
    """`_advance` for nodes begin … end − 1; returns rᵀ z and rᵀ r of these.

    `inverse` (n, 6) has the entries 11, 22, 33, 23, 13, 12 of the symmetric blocks of M⁻¹.
    """
    r, z, p, q = vectors
    rz = rr = 0.0
    for node in range(begin, end):
        i = np.uintp(node)
        rr += _advance_node(i, alpha, p, q, x, r)
        r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
        m = inverse[i]
        z1 = m[0] * r1 + m[5] * r2 + m[4] * r3
        z2 = m[5] * r1 + m[1] * r2 + m[3] * r3
        z3 = m[4] * r1 + m[3] * r2 + m[2] * r3
        z[i, 0] = z1
        z[i, 1] = z2
        z[i, 2] = z3
        rz += r1 * z1 + r2 * z2 + r3 * z3
    return rz, rr


@inner
def _advance_node(i: Any, alpha: float, p: Array, q: Array, x: Array, r: Array) -> float:
    """Node i of `_move`; with α = 0 the old p and q are not used, as they may be not finite."""
    if alpha != 0.0:
        for c in range(3):
            x[i, c] += alpha * p[i, c]
            r[i, c] -= alpha * q[i, c]
    r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
    rr: float = r1 * r1 + r2 * r2 + r3 * r3
    return rr
