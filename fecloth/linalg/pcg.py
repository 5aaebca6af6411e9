"""Conjugate gradients with a 3×3 block-Jacobi preconditioner."""

import time

import numpy as np

from fecloth.compiled.jit import Array, kernel
from fecloth.compiled.team import ALONE, Team
from fecloth.compiled.threads import ONLY, Member, members
from fecloth.errors import IndefiniteMatrix, SolveFailed, amount
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.conjugate_gradients import (
    INDEFINITE,
    NOT_FINITE,
    OUT_OF_ITERATIONS,
    Vectors,
    conjugate_gradients,
)
from fecloth.linalg.protocol import SolveInfo, block_rows, check_arguments, relative_residual
from fecloth.linalg.reductions import BLOCK


def invert_diagonal(A: BlockMatrix, inverse: np.ndarray, name: str) -> None:
    """Write the inverses of the diagonal blocks of A to `inverse` (n, 6), see `invert_blocks`.

    Raises `SolveFailed` if a block is not finite, and `IndefiniteMatrix` if it is not positive
    definite; the message begins with `name`, the name of the solver.
    """
    node = invert_blocks(A.pattern.diagonal, A.values, inverse)
    if node < 0:  # all blocks are positive definite
        return
    block = A.values[A.pattern.diagonal[node]]
    where = f"the diagonal block of node {node}"
    if not np.isfinite(block).all():
        raise SolveFailed(f"{name}: A is not finite: {where} is {block.tolist()}")
    eigenvalues = np.linalg.eigvalsh(block)
    raise IndefiniteMatrix(
        f"{name}: {where} is not positive definite, its eigenvalues are {eigenvalues}"
    )


@kernel
def invert_blocks(diagonal: Array, values: Array, inverse: Array) -> int:
    """Invert the symmetric diagonal blocks of a matrix by their cofactors.

    `diagonal` (n,) are the numbers of the blocks in `values` (b, 3, 3). The entries 11, 22, 33,
    23, 13, 12 of their inverses are written to `inverse` (n, 6). Return the first node whose
    block is not positive definite (Sylvester's criterion), or −1; the blocks after it are not
    inverted.
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


class PCG:
    """Conjugate gradients with a 3×3 block-Jacobi preconditioner (Saad 2003, algorithm 9.1).

    A solve fails after `max_iterations`.
    """

    name = "pcg"
    symmetric = True
    keeps_state = False

    def __init__(self, max_iterations: int = 10_000):
        self.max_iterations = max_iterations
        self.prepared = 0  # number of calls of `prepare`
        self._A: BlockMatrix | None = None
        self._inverse = np.empty((0, 6))

    def prepare(self, A: BlockMatrix) -> None:
        """Take a new matrix A, and invert its diagonal blocks.

        Raises `IndefiniteMatrix` if one is not positive definite, and `SolveFailed` if one is
        not finite. After an error there is no matrix.
        """
        begin = time.perf_counter()
        self._A = None
        self.prepared += 1
        n = len(A.pattern)
        if len(self._inverse) != n:
            self._inverse = np.empty((n, 6))
            r, z, p, q = np.zeros((4, n, 3))
            self._vectors = Vectors(r, z, p, q)
            self._sums = np.empty((3, -(-n // BLOCK)))  # the number of blocks, rounded up
            self._carry = np.empty(3)
        invert_diagonal(A, self._inverse, self.name)
        self._A = A
        self._seconds = time.perf_counter() - begin

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b (n, 3), starting from `guess` (n, 3) or 0; return x and `SolveInfo`.

        It ends when ‖b − A x‖ <= rtol ‖b‖. Raises `IndefiniteMatrix`, whose `so_far` is x of the
        last iteration or None; `SolveFailed` if b or a product is not finite, after
        `max_iterations`, or at round-off; and `InputError` for wrong arguments.
        """
        begin = time.perf_counter()
        A, b, bb = check_arguments(self._A, b, rtol)
        x = np.zeros_like(b)
        r = self._vectors.r
        threshold = rtol * rtol * bb
        iterations = 0
        if guess is None or bb == 0.0:
            r[:] = b
            reached = float(bb > 0.0)
        else:
            x[:] = guess
            reached = relative_residual(A, b, bb, x, r)
        while not reached <= rtol:
            iterations_left = self.max_iterations - iterations
            count, status = self._iterate(A, x, threshold, limit=iterations_left)
            iterations += count
            # Round-off makes the recurrence of r drift away from the true residual. Restart from
            # the true residual as long as this reduces it.
            reached_before = reached
            reached = relative_residual(A, b, bb, x, r)
            try:
                self._check(status, iterations, reached_before, reached, rtol)
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
        """Iterate from x until ‖r‖² <= `threshold`, at most `limit` times; x is overwritten.

        Return the number of iterations, and the status as `conjugate_gradients` does. The
        iterations are done in portions, which the team times.
        """
        team = A.team if A.team.shares(len(x)) else ALONE
        self._carry[0] = -1.0  # a start
        done = 0
        status = OUT_OF_ITERATIONS
        while status == OUT_OF_ITERATIONS and done < limit:
            most = team.portion(self.name, limit - done)
            count, status = self._share(team, A, x, threshold, most)
            done += count
        return done, status

    def _share(
        self, team: Team, A: BlockMatrix, x: np.ndarray, threshold: float, limit: int
    ) -> tuple[int, int]:
        """Do the iterations of a portion, on one thread or on all, as the team decides."""

        def loop(member: Member) -> tuple[int, int]:
            return self._loop(A, x, threshold, limit, member)

        def together() -> tuple[int, int]:
            sharing = members(team.count)
            return team.run(lambda p: loop(sharing[p]), sharing[0].meeting)

        return team.do(self.name, lambda: loop(ONLY), together, count=lambda result: result[0])

    def _loop(
        self, A: BlockMatrix, x: np.ndarray, threshold: float, limit: int, member: Member
    ) -> tuple[int, int]:
        """Iterate as one of the threads; return the number of iterations and the status.

        The parameters are as in `conjugate_gradients`. A subclass may override it.
        """
        return conjugate_gradients(
            block_rows(A),
            self._inverse,
            x,
            self._vectors,
            self._sums,
            self._carry,
            threshold,
            limit,
            member,
        )

    def _check(
        self, status: int, iterations: int, before: float, reached: float, rtol: float
    ) -> None:
        """Raise the error of a status, or of a residual that a restart no longer halves.

        `before` and `reached` are the relative residuals at the last restart and now. Raises
        `IndefiniteMatrix` if A is not positive definite, and `SolveFailed` otherwise.
        """
        name = self.name
        done = amount(iterations, "iteration")
        if status == NOT_FINITE:
            raise SolveFailed(f"{name} found a number that is not finite in {done}")
        if status == INDEFINITE:
            where = f"pᵀAp <= 0 in iteration {iterations + 1}"
            reason = f"{name} found {where}: A is not positive definite"
            raise IndefiniteMatrix(reason, reached, rtol)
        if status == OUT_OF_ITERATIONS:
            reason = f"{name} spent max_iterations = {self.max_iterations}; use a direct solver"
            raise SolveFailed(reason, reached, rtol)
        if reached > max(rtol, 0.5 * before):
            reason = f"{name} stands still at round-off after {done}; use a direct solver"
            raise SolveFailed(reason, reached, rtol)
