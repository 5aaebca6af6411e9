"""Conjugate gradients with a 3×3 block-Jacobi preconditioner, compiled.

Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition: algorithm 9.1 (PCG) and
section 4.1.1 (block Jacobi). Matrices are the block rows of `blocks.BlockMatrix`.
"""

from __future__ import annotations

import numpy as np

from .compiled import inner, kernel

CONVERGED, NOT_FINITE, INDEFINITE, OUT_OF_ITERATIONS = range(4)


@kernel
def conjugate_gradients(indptr, indices, values, inverse, x, r, z, p, q, threshold, limit):
    """Improve x until ‖r‖² <= threshold, by the recurrence of r, or `limit` iterations are spent.

    Parameters
    ----------
    inverse
        (n, 6), M⁻¹: inverses of the diagonal blocks, see `invert_blocks`.
    x, r
        (n, 3), a start and its residual b − A x; overwritten.
    z, p, q
        (n, 3), work space for M⁻¹ r, the search direction, and A p.

    Returns
    -------
    The number of iterations and one of CONVERGED, NOT_FINITE, INDEFINITE, OUT_OF_ITERATIONS.
    """
    rz, rr = _advance(0.0, p, q, inverse, x, r, z)
    beta = 0.0
    for j in range(limit):
        if rr <= threshold:
            return j, CONVERGED
        _turn(z, beta, p)
        pq = _multiply(indptr, indices, values, p, q)
        if not np.isfinite(pq) or not np.isfinite(rz):
            return j, NOT_FINITE
        if pq <= 0.0 or rz <= 0.0:
            return j, INDEFINITE
        old = rz
        rz, rr = _advance(old / pq, p, q, inverse, x, r, z)
        beta = rz / old
    return limit, CONVERGED if rr <= threshold else OUT_OF_ITERATIONS


@inner
def _turn(z, beta, p):
    """p = z + β p."""
    for i in range(len(p)):
        for c in range(3):
            # With β = 0 whatever p held before is dropped, even if it was not finite.
            p[i, c] = z[i, c] + beta * p[i, c] if beta != 0.0 else z[i, c]


@inner
def _multiply(indptr, indices, values, p, q):
    """q = A p; returns pᵀ q."""
    pq = 0.0
    for i in range(len(p)):
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
def _advance(alpha, p, q, inverse, x, r, z):
    """x += α p, r −= α q (unless α = 0), z = M⁻¹ r; returns rᵀ z and rᵀ r."""
    rz = rr = 0.0
    for i in range(len(x)):
        if alpha != 0.0:
            for c in range(3):
                x[i, c] += alpha * p[i, c]
                r[i, c] -= alpha * q[i, c]
        r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
        m = inverse[i]
        z1 = m[0] * r1 + m[5] * r2 + m[4] * r3
        z2 = m[5] * r1 + m[1] * r2 + m[3] * r3
        z3 = m[4] * r1 + m[3] * r2 + m[2] * r3
        z[i, 0], z[i, 1], z[i, 2] = z1, z2, z3
        rz += r1 * z1 + r2 * z2 + r3 * z3
        rr += r1 * r1 + r2 * r2 + r3 * r3
    return rz, rr


@kernel
def invert_blocks(diagonal, values, inverse):
    """Invert the symmetric diagonal blocks by their cofactors.

    Parameters
    ----------
    diagonal
        (n,) the blocks of `values` (b, 3, 3) that lie on the diagonal.
    inverse
        (n, 6), out: entries 11, 22, 33, 23, 13, 12 of the inverses.

    Returns
    -------
    The first node whose block is not positive definite (Sylvester's criterion), or −1.
    """
    for i in range(len(diagonal)):
        a = values[diagonal[i]]
        c11 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
        c12 = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
        c13 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
        c33 = a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]
        det = a[0, 0] * c11 + a[0, 1] * c12 + a[0, 2] * c13
        if not (a[0, 0] > 0.0 and c33 > 0.0 and det > 0.0):  # also true of NaN
            return i
        inverse[i, 0] = c11 / det
        inverse[i, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2]) / det
        inverse[i, 2] = c33 / det
        inverse[i, 3] = (a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]) / det
        inverse[i, 4] = c13 / det
        inverse[i, 5] = c12 / det
    return -1


@kernel
def residual(indptr, indices, values, b, x, r):
    """r = b − A x; returns ‖r‖²."""
    rr = 0.0
    for i in range(len(b)):
        r1, r2, r3 = b[i, 0], b[i, 1], b[i, 2]
        for s in range(indptr[i], indptr[i + 1]):
            j = indices[s]
            x1, x2, x3 = x[j, 0], x[j, 1], x[j, 2]
            r1 -= values[s, 0, 0] * x1 + values[s, 0, 1] * x2 + values[s, 0, 2] * x3
            r2 -= values[s, 1, 0] * x1 + values[s, 1, 1] * x2 + values[s, 1, 2] * x3
            r3 -= values[s, 2, 0] * x1 + values[s, 2, 1] * x2 + values[s, 2, 2] * x3
        r[i, 0], r[i, 1], r[i, 2] = r1, r2, r3
        rr += r1 * r1 + r2 * r2 + r3 * r3
    return rr


@kernel
def squared(b):
    """‖b‖² of (n, 3), on the calling thread (BLAS would wake its own for a sum this short)."""
    total = 0.0
    for i in range(len(b)):
        total += b[i, 0] * b[i, 0] + b[i, 1] * b[i, 1] + b[i, 2] * b[i, 2]
    return total


@kernel
def rounding(indptr, indices, values, b, x):
    """‖ |b| + |A| |x| ‖²: times eps², the square of what round-off alone leaves of b − A x."""
    total = 0.0
    for i in range(len(b)):
        for c in range(3):
            row = abs(b[i, c])
            for s in range(indptr[i], indptr[i + 1]):
                for d in range(3):
                    row += abs(values[s, c, d] * x[indices[s], d])
            total += row * row
    return total
