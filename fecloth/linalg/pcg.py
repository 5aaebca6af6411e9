"""Conjugate gradients with a 3×3 block-Jacobi preconditioner, in compiled code.

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, algorithm 9.1 (PCG)
and section 4.1.1 (block Jacobi). Matrices are given as the block rows of a `BlockMatrix`.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.jit import Array, inner, kernel
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import SolveInfo, block_rows, check_arguments, relative_residual
from fecloth.team import ALONE, Team, meet

BLOCK = 256  # nodes whose sums are added up first, for the same bits on any number of threads
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
            self._sums, self._carry = np.empty((3, -(-n // BLOCK))), np.empty(3)
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
            try:
                self._check(status, iterations, before, reached, rtol)
            except IndefiniteMatrix as failure:
                failure.so_far = x if iterations else None
                raise
        seconds = time.perf_counter() - begin
        return x, SolveInfo(self.name, iterations, reached, self._seconds, seconds)

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Nothing to do: every step is solved alike."""

    def drop(self) -> None:
        """Nothing to do: a solve depends on the prepared matrix only."""

    def _iterate(
        self, A: BlockMatrix, x: np.ndarray, threshold: float, limit: int
    ) -> tuple[int, int]:
        """Iterate in portions, of which the team times each; also returns the status."""
        team = A.team if A.team.shares(len(x)) else ALONE
        self._carry[0] = -1.0
        done, status = 0, OUT_OF_ITERATIONS
        while status == OUT_OF_ITERATIONS and done < limit:
            most = team.portion("pcg", limit - done)
            count, status = self._share(team, A, x, threshold, most)
            done += count
        return done, status

    def _share(
        self, team: Team, A: BlockMatrix, x: np.ndarray, threshold: float, limit: int
    ) -> tuple[int, int]:
        data = *block_rows(A), self._inverse, x, *self._work, self._sums, self._carry
        meeting = np.zeros(1, np.int64)

        def part(thread: int, threads: int = team.count) -> tuple[int, int]:
            return conjugate_gradients(*data, threshold, limit, meeting, thread, threads)

        both = lambda: part(0, 1), lambda: team.run(part, meeting)
        return team.do("pcg", *both, limit, lambda result: result[0])

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
