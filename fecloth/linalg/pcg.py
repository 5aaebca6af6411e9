"""Conjugate gradients with a 3×3 block-Jacobi preconditioner."""

import time
from collections.abc import Callable
from functools import partial

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
    STANDS_STILL,
)
from fecloth.linalg.mixed_precision import BEGIN, Progress, Work, solve_by_cg
from fecloth.linalg.protocol import SolveInfo, block_rows, check_arguments


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
    takes_single = True  # it iterates in float32 where the tolerance allows it

    def __init__(self, max_iterations: int = 10_000):
        self.max_iterations = max_iterations
        self.prepared = 0  # number of calls of `prepare`
        self._A: BlockMatrix | None = None
        self._inverse = np.empty((0, 6))
        self._work = Work.allocate(0, 0)

    def prepare(self, A: BlockMatrix) -> None:
        """Take a new matrix A, and invert its diagonal blocks.

        Raises `IndefiniteMatrix` if one is not positive definite, and `SolveFailed` if one is
        not finite. After an error there is no matrix.
        """
        begin = time.perf_counter()
        self._A = None
        self.prepared += 1
        n = len(A.pattern)
        blocks_in_single = len(A.values) if self.takes_single else 0
        if len(self._inverse) != n or len(self._work.values) != blocks_in_single:
            self._inverse = np.empty((n, 6))
            self._work = Work.allocate(n, blocks_in_single)
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
        start = np.zeros_like(b) if guess is None or bb == 0.0 else guess
        x = start.copy()
        progress = self._solve(A, b, x, rtol)
        try:
            self._check(progress, rtol)
        except IndefiniteMatrix as failure:
            failure.so_far = None if np.array_equal(x, start) else x
            raise
        seconds = time.perf_counter() - begin
        cost = progress.iterations, progress.reached, self._seconds, seconds
        return x, SolveInfo(self.name, *cost)

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Nothing to do: every step is solved alike."""

    def drop(self) -> None:
        """Nothing to do: a solve depends on the prepared matrix only."""

    def _solve(self, A: BlockMatrix, b: np.ndarray, x: np.ndarray, rtol: float) -> Progress:
        """Solve A x = b from x, which becomes the solution; return how it ended."""

        def loop(limit: int, progress: Progress, member: Member) -> Progress:
            rows = block_rows(A)
            return solve_by_cg(rows, self._inverse, b, x, self._work, rtol, limit, progress, member)

        return self._iterate(A, loop, BEGIN)

    def _iterate(
        self, A: BlockMatrix, loop: Callable[[int, Progress, Member], Progress], progress: Progress
    ) -> Progress:
        """Call loop(limit, progress, member), on one thread or on all, until it is done.

        It is called in portions of `max_iterations`, which the team times; each goes on from the
        progress of the one before.
        """
        team = A.team if A.team.shares(len(A.pattern)) else ALONE
        while progress.status == OUT_OF_ITERATIONS and progress.iterations < self.max_iterations:
            left = self.max_iterations - progress.iterations
            limit = progress.iterations + team.portion(self.name, left)
            progress = self._share(team, partial(loop, limit, progress), progress.iterations)
        return progress

    def _share(self, team: Team, portion: Callable[[Member], Progress], done: int) -> Progress:
        """Do a portion after `done` iterations, on one thread or on all, as the team decides."""

        def together() -> Progress:
            sharing = members(team.count)
            return team.run(lambda p: portion(sharing[p]), sharing[0].meeting)

        def count(after: Progress) -> int:
            return after.iterations - done

        return team.do(self.name, lambda: portion(ONLY), together, count)

    def _check(self, progress: Progress, rtol: float) -> None:
        """Raise the error of a solve that has not converged.

        Raises `IndefiniteMatrix` if A is not positive definite, and `SolveFailed` otherwise.
        """
        name = self.name
        iterations, status, reached, *_ = progress
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
        if status == STANDS_STILL:
            reason = f"{name} stands still at round-off after {done}; use a direct solver"
            raise SolveFailed(reason, reached, rtol)
