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
    begin, end = part_of(member, 0, sums.shape[1])  # this thread's blocks of nodes
    rz, rr, beta, scale = carry
    is_start = rz < 0.0
    j = 0
    while is_start or (j < limit and not rr <= threshold):
        alpha = 0.0  # at the start z = M⁻¹ r, without a step
        if not is_start:
            pq = _search(begin, end, A, vectors.z, beta, vectors, sums, member)
            # r and the last p are orthogonal, so that pᵀMp has no mixed term
            scale = rz + beta * beta * scale
            status = _check(pq, rz, least * scale)
            if status != OUT_OF_ITERATIONS:
                return j, status, Carry(rz, rr, beta, scale)
            alpha = rz / pq
            j += 1
        old_rz = rz
        rz, rr = _advance(begin, end, alpha, inverse, x, vectors, sums, member)
        beta = 0.0 if is_start else rz / old_rz
        is_start = False
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
    pq = _search(begin, end, A, z, beta, vectors, sums, member)
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
) -> tuple[float, float]:  # fmt: skip
    """r = b − A x in blocks begin … end − 1; returns ‖r‖² and ‖b‖² of all threads. p becomes x."""
    r, _, p, q = vectors
    for i in range(begin * BLOCK, nodes_of(end - 1, len(x))[1]):
        for c in range(3):
            p[i, c] = x[i, c]
    wait(member)
    is_zero = not p.any()  # the usual first guess: b is its residual
    for block in range(begin, end):
        first, last = nodes_of(block, len(x))
        rr = bb = 0.0
        if not is_zero:
            multiply(first, last, A, p, q)
        for i in range(first, last):
            for c in range(3):
                r[i, c] = b[i, c] if is_zero else b[i, c] - q[i, c]
                rr += r[i, c] * r[i, c]
                bb += b[i, c] * b[i, c]
        sums[0, block] = rr
        sums[3, block] = bb
    wait(member)
    return total(sums[0]), total(sums[3])


@inner
def _search(
    begin: int, end: int, A: BlockRows, z: Array, beta: float, vectors: Vectors, sums: Array,
    member: Member,
) -> float:  # fmt: skip
    """p = z + β p and q = A p in blocks begin … end − 1; returns pᵀq of all threads.

    With β = 0 the old p may be not finite.
    """
    p = vectors.p
    factor = p.dtype.type(beta)
    for node in range(begin * BLOCK, nodes_of(end - 1, len(p))[1]):
        i = np.uintp(node)  # not negative: the compiler need not look
        for c in range(3):
            p[i, c] = z[i, c] + factor * p[i, c] if beta != 0.0 else z[i, c]
    wait(member)
    for block in range(begin, end):
        first, last = nodes_of(block, len(p))
        sums[0, block] = multiply(first, last, A, p, vectors.q)
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
def _move(begin: int, end: int, alpha: float, p: Array, q: Array, x: Array, r: Array) -> float:
    """x += α p, r −= α q of nodes begin … end − 1; returns rᵀ r."""
    rr = 0.0
    for node in range(begin, end):
        i = np.uintp(node)
        for c in range(3):
            x[i, c] += alpha * p[i, c]
            r[i, c] -= alpha * q[i, c]
            rr += r[i, c] * r[i, c]
    return rr


@inner
def _advance(
    begin: int, end: int, alpha: float, inverse: Array, x: Array, vectors: Vectors, sums: Array,
    member: Member,
) -> tuple[float, float]:  # fmt: skip
    """x += α p, r −= α q and z = M⁻¹ r in blocks begin … end − 1; return rᵀz and rᵀr of all.

    `inverse` (n, 6) has the entries 11, 22, 33, 23, 13, 12 of the symmetric blocks of M⁻¹. With
    α = 0 the old p and q are not used, as they may be not finite.
    """
    r, z, p, q = vectors
    factor = x.dtype.type(alpha)
    for block in range(begin, end):
        first, last = nodes_of(block, len(x))
        rz = rr = 0.0
        for node in range(first, last):
            i = np.uintp(node)
            if alpha != 0.0:
                for c in range(3):
                    x[i, c] += factor * p[i, c]
                    r[i, c] -= factor * q[i, c]
            r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
            m = inverse[i]
            z1 = m[0] * r1 + m[5] * r2 + m[4] * r3
            z2 = m[5] * r1 + m[1] * r2 + m[3] * r3
            z3 = m[4] * r1 + m[3] * r2 + m[2] * r3
            z[i, 0] = z1
            z[i, 1] = z2
            z[i, 2] = z3
            rz += r1 * z1 + r2 * z2 + r3 * z3
            rr += r1 * r1 + r2 * r2 + r3 * r3
        sums[1, block] = rz
        sums[2, block] = rr
    wait(member)
    return total(sums[1]), total(sums[2])
