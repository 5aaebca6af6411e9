"""Conjugate gradients preconditioned by smoothed-aggregation multigrid."""

from __future__ import annotations

import math
import time

import numpy as np

from fecloth.compiled.threads import Member
from fecloth.linalg.aggregation import rigid_motions
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.conjugate_gradients import CONVERGED, OUT_OF_ITERATIONS, step
from fecloth.linalg.cycle import cycle
from fecloth.linalg.hierarchy import Grid, Level, make_grids, make_levels
from fecloth.linalg.pcg import PCG
from fecloth.linalg.protocol import SolveInfo, block_rows

NEW = 8  # iterations that cost as much as new coarse matrices


class Multigrid(PCG):
    """Conjugate gradients preconditioned by a cycle of multigrid.

    The aggregates are made once for each pattern. The coarse matrices are kept, also for other
    matrices, until the additional iterations have cost as much as new ones: then at most twice the
    best cost is paid. See `hierarchy` why the cycle remains definite.

    Parameters
    ----------
    max_iterations
        A solve fails after this number of iterations.
    """

    name, symmetric, keeps_state = "multigrid", True, True

    def __init__(self, max_iterations: int = 10_000):
        super().__init__(max_iterations)
        self._grids: list[Grid] = []
        self.drop()

    def drop(self) -> None:
        """Forget the coarse matrices and the positions."""
        self._levels: list[Level] = []
        self._rate = 0.0  # iterations of the first solve with these coarse matrices, by ln(1/rtol)
        self._extra = 0.0  # iterations that later solves took beyond that
        self._x: np.ndarray | None = None

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Note the positions x (n, 3), about which the next coarse matrices represent rotations.

        Without a call they represent translations only.
        """
        self._x = x

    def prepare(self, A: BlockMatrix) -> None:
        """Invert the diagonal blocks of A, and make coarse matrices if there are none.

        Raises `IndefiniteMatrix` if a diagonal block of A or of a coarse matrix is not positive
        definite.
        """
        super().prepare(A)
        begin, self._A = time.perf_counter(), None
        if not self._grids or not A.pattern.same_as(self._grids[0].pattern):
            self._levels, self._grids = [], make_grids(A.pattern)
        if self._levels and self._extra < NEW:
            self._levels[0].refill(A, self._inverse)
        else:
            self._levels, self._rate, self._extra = [], 0.0, 0.0
            motions = self._motions(len(A.pattern))
            self._levels = make_levels(self._grids, A, self._inverse, motions, np.float32)
        self._A = A
        self._seconds += time.perf_counter() - begin

    def _motions(self, n: int) -> np.ndarray:
        """(n, 3, 6) the rigid motions about the positions of the step."""
        at_one_point = np.zeros((n, 3))
        return rigid_motions(at_one_point if self._x is None else self._x)

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b (n, 3), starting from `guess` (n, 3) or 0: x (n, 3) and `SolveInfo`."""
        x, info = super().solve(b, rtol, guess)
        goal = math.log(1 / rtol)
        self._rate = self._rate or info.iterations / goal
        self._extra += max(0.0, info.iterations - self._rate * goal)
        return x, info

    def _loop(
        self, A: BlockMatrix, x: np.ndarray, threshold: float, limit: int, member: Member
    ) -> tuple[int, int]:
        r, _, p, q = self._work
        rz, status, j = self._carry[0], OUT_OF_ITERATIONS, 0
        while j < limit and status == OUT_OF_ITERATIONS:
            z = cycle(self._levels, r, member)
            rz, status = step(*block_rows(A), x, r, z, p, q, self._sums, rz, threshold, member)
            j += status in (CONVERGED, OUT_OF_ITERATIONS)
        if member.thread == 0:
            self._carry[0] = rz
        return j, status
