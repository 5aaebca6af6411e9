"""Conjugate gradients in float32, and then in float64 where that was not enough.

A direction of Newton's iteration is needed to a relative residual of about 1e-2. Iterations in
float32 reach it in less than half the time, as they read half as many bytes. The residual
b − A x that ends a solve is always in float64, and what float32 cannot decide is done again in
float64: so a matrix is found to be indefinite in float64 only.
"""

from typing import NamedTuple, Self

import numpy as np

from fecloth.compiled.jit import Array, inner, kernel
from fecloth.compiled.threads import Member, part_of
from fecloth.linalg.conjugate_gradients import (
    CONVERGED,
    OUT_OF_ITERATIONS,
    STANDS_STILL,
    START,
    Carry,
    Vectors,
    conjugate_gradients,
    residual_of,
)
from fecloth.linalg.protocol import BlockRows
from fecloth.linalg.reductions import BLOCK, nodes_of

# The smallest tolerance for which float32 is used. It leaves room for its round-off, which
# grows with the condition number.
SINGLE_RTOL = 1e-3
# The least pᵀAp / pᵀMp in float32. With M the blocks on the diagonal, the round-off of pᵀAp is
# some 1e-7 of pᵀMp: below this bound its sign is not certain.
SINGLE_LEAST = 1e-5


class Work(NamedTuple):
    """The work space of `solve_by_cg` for n nodes.

    Attributes
    ----------
    double
        The vectors in float64.
    single
        The vectors in float32.
    values, inverse
        The blocks of A, and M⁻¹ (n, 6), in float32.
    x
        (n, 3) x in float32.
    sums
        (4, blocks of nodes) sums over the nodes of each block.
    """

    double: Vectors
    single: Vectors
    values: np.ndarray
    inverse: np.ndarray
    x: np.ndarray
    sums: np.ndarray

    @classmethod
    def allocate(cls, n: int, blocks: int) -> Self:
        """Work space for n nodes and a number of 3×3 blocks."""
        return cls(
            double=Vectors.zeros(n),
            single=Vectors.zeros(n, np.float32),
            values=np.empty((blocks, 3, 3), np.float32),
            inverse=np.empty((n, 6), np.float32),
            x=np.empty((n, 3), np.float32),
            sums=np.empty((4, -(-n // BLOCK))),  # the number of blocks of nodes, rounded up
        )


class Progress(NamedTuple):
    """What a call of `solve_by_cg` returns.

    Attributes
    ----------
    iterations
        The number of iterations of all calls of this solve.
    status
        CONVERGED, NOT_FINITE, INDEFINITE, STANDS_STILL, or OUT_OF_ITERATIONS.
    reached
        ‖b − A x‖ / ‖b‖; out of iterations it is taken from the recurrence.
    bb
        ‖b‖².
    is_single
        Whether the iterations are in float32.
    carry
        What the next iteration takes from the last one.
    """

    iterations: int
    status: int
    reached: float
    bb: float
    is_single: bool
    carry: Carry


BEGIN = Progress(0, OUT_OF_ITERATIONS, -1.0, 0.0, False, START)
"""The progress of a solve that has not begun."""


@kernel
def solve_by_cg(
    A: BlockRows, inverse: Array, b: Array, x: Array, work: Work, rtol: float, limit: int,
    progress: Progress, member: Member,
) -> Progress:  # fmt: skip
    """Solve A x = b until ‖b − A x‖ <= rtol ‖b‖, with at most `limit` iterations in all.

    Each thread calls it as its `member`. A solve may take several calls, each with a larger
    limit and with the progress that the call before returned.

    Round-off makes the recurrence of the residual drift away from the true residual. The
    iterations begin again from the true residual as long as each round halves it.

    Parameters
    ----------
    A
        The matrix.
    inverse
        (n, 6) the inverses of its diagonal blocks, see `invert_blocks`.
    b
        (n, 3) the right-hand side.
    x
        (n, 3) the first guess, which becomes the solution; it is kept if b is 0.
    work
        The work space.
    rtol, limit
        The relative residual, and the largest number of iterations.
    progress
        `BEGIN`, or what the call before returned.
    member
        The thread, or `ONLY`.
    """
    begin, end = part_of(member, 0, work.sums.shape[1])
    done, _, reached, bb, is_single, carry = progress
    is_begun = reached >= 0.0
    is_residual_known = is_begun
    status = CONVERGED
    while True:
        if not is_residual_known:
            before = reached
            rr, bb = residual_of(begin, end, A, b, x, work.double, work.sums, member)
            reached = np.sqrt(rr / bb) if bb > 0.0 else 0.0
            if is_begun and not is_single and status == CONVERGED:
                status = status_of_round(before, reached, rtol)
            # float32 comes first, and once
            is_single = not is_begun and rtol >= SINGLE_RTOL
            is_begun = True
            carry = START
        if status != CONVERGED or reached <= rtol:
            break
        is_residual_known = False
        limit_of_round = limit - done
        if is_single:
            if carry.rz < 0.0:
                _convert(begin, end, A, inverse, np.sqrt(bb), work)
            in_single = BlockRows(A.indptr, A.indices, work.values)
            count, status, carry = conjugate_gradients(
                in_single, work.inverse, work.x, work.single, work.sums, carry, rtol * rtol,
                SINGLE_LEAST, limit_of_round, member,
            )  # fmt: skip
            if status == CONVERGED:
                _add_correction(begin, end, np.sqrt(bb), work.x, x)
        else:
            count, status, carry = conjugate_gradients(
                A, inverse, x, work.double, work.sums, carry, rtol * rtol * bb,
                0.0, limit_of_round, member,
            )  # fmt: skip
        done += count
        if status == OUT_OF_ITERATIONS:
            reached = np.sqrt(carry.rr if is_single else carry.rr / bb)
            break
        if is_single:
            status = CONVERGED  # or x is as before: once more in float64
    return Progress(done, status, reached, bb, is_single, carry)


@inner
def status_of_round(before: float, reached: float, rtol: float) -> int:
    """STANDS_STILL if a round in float64 has not halved the relative residual, else CONVERGED.

    `before` and `reached` are the relative residuals before and after the round.
    """
    return STANDS_STILL if reached > max(rtol, 0.5 * before) else CONVERGED


@inner
def _convert(begin: int, end: int, A: BlockRows, inverse: Array, size: float, work: Work) -> None:
    """Write A d = r / ‖b‖, the equation of the correction ‖b‖ d, to the arrays in float32.

    The right-hand side is divided by `size` = ‖b‖, so that no number is too small for float32.
    Only the rows of blocks begin … end − 1 are written.
    """
    first = begin * BLOCK
    last = nodes_of(end - 1, len(inverse))[1]
    values = A.values[A.indptr[first] : A.indptr[last]]
    in_single = work.values[A.indptr[first] : A.indptr[last]]
    numbers = values.reshape(values.size)
    out = in_single.reshape(values.size)
    for k in range(len(out)):  # one long loop, which the compiler makes quick
        out[k] = numbers[k]
    for i in range(first, last):
        for k in range(6):
            work.inverse[i, k] = inverse[i, k]
        for c in range(3):
            work.single.r[i, c] = work.double.r[i, c] / size
            work.x[i, c] = 0.0


@inner
def _add_correction(begin: int, end: int, size: float, d: Array, x: Array) -> None:
    """x += `size` d in blocks begin … end − 1."""
    for i in range(begin * BLOCK, nodes_of(end - 1, len(x))[1]):
        for c in range(3):
            x[i, c] += size * d[i, c]
