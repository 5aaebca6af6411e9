"""Conjugate gradients with a 3×3 block-Jacobi preconditioner, in compiled code.

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, algorithm 9.1 (PCG)
and section 4.1.1 (block Jacobi). Matrices are given as the block rows of a `BlockMatrix`.
"""

from __future__ import annotations

import time

import numpy as np

from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.jit import Array, inner, kernel
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import SolveInfo, block_rows, check_arguments, relative_residual

CONVERGED, NOT_FINITE, INDEFINITE, OUT_OF_ITERATIONS = range(4)


class PCG:
    """Conjugate gradients with a 3×3 block-Jacobi preconditioner (Saad 2003, algorithm 9.1).

    Parameters
    ----------
    max_iterations
        A solve fails after this number of iterations.
    """

    name, symmetric, keeps_state = "pcg", True, False

    def __init__(self, max_iterations: int = 10_000):
        self.max_iterations = max_iterations
        self.prepared = 0  # number of calls of `prepare`
        self._A: BlockMatrix | None = None
        self._inverse = np.empty((0, 6))

    def prepare(self, A: BlockMatrix) -> None:
        """Invert the diagonal blocks of A; raise `IndefiniteMatrix` if one is not definite."""
        begin, self._A = time.perf_counter(), None
        self.prepared += 1
        n = len(A.pattern)
        if len(self._inverse) != n:
            self._inverse, self._work = np.empty((n, 6)), np.zeros((4, n, 3))
        invert_diagonal(A, self._inverse, self.name)
        self._A, self._seconds = A, time.perf_counter() - begin

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b (n, 3), starting from `guess` (n, 3) or 0: x (n, 3) and `SolveInfo`."""
        begin = time.perf_counter()
        A, b, bb = check_arguments(self._A, b, rtol)
        x, r, iterations = np.zeros_like(b), self._work[0], 0
        if guess is None or bb == 0.0:
            r[:] = b
            reached = float(bb > 0.0)
        else:
            x[:] = guess
            reached = relative_residual(A, b, bb, x, r)
        while not reached <= rtol:
            limit = self.max_iterations - iterations
            count, status = self._iterate(A, x, rtol * rtol * bb, limit)
            iterations += count
            # Round-off makes the recurrence of r drift away from the true residual. Restart from
            # the true residual as long as this reduces it.
            before, reached = reached, relative_residual(A, b, bb, x, r)
            self._check(status, iterations, before, reached, rtol)
        seconds = time.perf_counter() - begin
        return x, SolveInfo(self.name, iterations, reached, self._seconds, seconds)

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Nothing to do: every step is solved alike."""

    def drop(self) -> None:
        """Nothing to do: a solve depends on the prepared matrix only."""

    def _iterate(
        self, A: BlockMatrix, x: np.ndarray, threshold: float, limit: int
    ) -> tuple[int, int]:
        r, z, p, q = self._work
        rows = block_rows(A)
        return conjugate_gradients(*rows, self._inverse, x, r, z, p, q, threshold, limit)

    def _check(
        self, status: int, iterations: int, before: float, reached: float, rtol: float
    ) -> None:
        name = self.name
        if status == NOT_FINITE:
            raise SolveFailed(
                f"{name} found a number that is not finite in {iterations} iterations"
            )
        if status == INDEFINITE:
            raise IndefiniteMatrix(
                f"{name} found pᵀAp <= 0 in iteration {iterations + 1}: A is not positive definite",
                *(reached, rtol),
            )
        if status == OUT_OF_ITERATIONS:
            raise SolveFailed(
                f"{name} spent max_iterations = {self.max_iterations}; use a direct solver",
                *(reached, rtol),
            )
        if reached > max(rtol, 0.5 * before):
            raise SolveFailed(
                f"{name} stands still at round-off after {iterations} iterations; "
                "use a direct solver",
                *(reached, rtol),
            )


def invert_diagonal(A: BlockMatrix, inverse: np.ndarray, name: str) -> None:
    """Write the inverses of the diagonal blocks (n, 6); see `invert_blocks`.

    Raises
    ------
    IndefiniteMatrix, SolveFailed
        If a block is not positive definite, or not finite; `name` begins the message.
    """
    node = invert_blocks(A.pattern.diagonal, A.values, inverse)
    if node < 0:
        return
    block, where = A.values[A.pattern.diagonal[node]], f"the diagonal block of node {node}"
    if not np.isfinite(block).all():
        raise SolveFailed(f"{name}: A is not finite: {where} is {block.tolist()}")
    eigenvalues = np.linalg.eigvalsh(block)
    raise IndefiniteMatrix(
        f"{name}: {where} is not positive definite, its eigenvalues are {eigenvalues}"
    )


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
    threshold: float,
    limit: int,
) -> tuple[int, int]:
    """Iterate until ‖r‖² <= threshold, with r from its recurrence, or for `limit` iterations.

    Parameters
    ----------
    inverse
        (n, 6) M⁻¹, the inverses of the diagonal blocks; see `invert_blocks`.
    x, r
        (n, 3) initial x and its residual b − A x; both are overwritten.
    z, p, q
        (n, 3) work arrays for M⁻¹ r, the search direction p, and A p.

    Returns
    -------
    The number of iterations and one of CONVERGED, NOT_FINITE, INDEFINITE, OUT_OF_ITERATIONS.
    """
    rz, rr = _advance(0.0, p, q, inverse, x, r, z)
    beta = 0.0
    for j in range(limit):
        if rr <= threshold:
            return j, CONVERGED
        turn(z, beta, p)
        pq = multiply(indptr, indices, values, p, q)
        if not np.isfinite(pq) or not np.isfinite(rz):
            return j, NOT_FINITE
        if pq <= 0.0 or rz <= 0.0:
            return j, INDEFINITE
        old = rz
        rz, rr = _advance(old / pq, p, q, inverse, x, r, z)
        beta = rz / old
    return limit, CONVERGED if rr <= threshold else OUT_OF_ITERATIONS


@kernel
def turn(z: Array, beta: float, p: Array) -> None:
    """p = z + β p; with β = 0 the old p is not used, because it may be not finite."""
    for i in range(len(p)):
        for c in range(3):
            p[i, c] = z[i, c] + beta * p[i, c] if beta != 0.0 else z[i, c]


@kernel
def multiply(indptr: Array, indices: Array, values: Array, p: Array, q: Array) -> float:
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


@kernel
def advance(alpha: float, p: Array, q: Array, x: Array, r: Array) -> float:
    """x += α p, r −= α q; returns rᵀ r."""
    rr = 0.0
    for i in range(len(x)):
        rr += _advance_node(i, alpha, p, q, x, r)
    return rr


@inner
def _advance(
    alpha: float, p: Array, q: Array, inverse: Array, x: Array, r: Array, z: Array
) -> tuple[float, float]:
    """x += α p, r −= α q, z = M⁻¹ r; returns rᵀ z and rᵀ r."""
    rz = rr = 0.0
    for i in range(len(x)):
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
def _advance_node(i: int, alpha: float, p: Array, q: Array, x: Array, r: Array) -> float:
    """Node i of `advance`; with α = 0 the old p and q are not used, as they may be not finite."""
    if alpha != 0.0:
        for c in range(3):
            x[i, c] += alpha * p[i, c]
            r[i, c] -= alpha * q[i, c]
    r1, r2, r3 = r[i, 0], r[i, 1], r[i, 2]
    rr: float = r1 * r1 + r2 * r2 + r3 * r3
    return rr


@kernel
def invert_blocks(diagonal: Array, values: Array, inverse: Array) -> int:
    """Invert the symmetric diagonal blocks by their cofactors.

    Parameters
    ----------
    diagonal
        (n,) numbers of the diagonal blocks in `values` (b, 3, 3).
    inverse
        (n, 6) output: entries 11, 22, 33, 23, 13, 12 of the inverses.

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
