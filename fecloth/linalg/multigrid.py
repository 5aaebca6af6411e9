"""Conjugate gradients preconditioned by smoothed-aggregation multigrid, shared by threads.

A cycle sweeps forward over the nodes of a level, corrects by the next level, and sweeps
backward:

    M⁻¹ = (D + U)⁻¹ D (D + L)⁻¹ + (I − (D + U)⁻¹ A) P C Pᵀ (I − A (D + L)⁻¹)

with A = L + D + U. The correction C consists of two cycles of the next level (a W-cycle),
since these cost little and save a third of the iterations; of small levels it is one. M⁻¹ is
symmetric for every symmetric A, and positive definite where C and D are. This needs no bound
of eigenvalues, as Chebyshev smoothing does, and it remains true if the coarse levels belong to
another matrix. C is definite because the eigenvalues of M⁻¹ Pᵀ A P are between 0 and 1 on all
levels that belong together.

All threads call the functions of a cycle. The nodes of a colour, the rows and the aggregates
are divided among them, and each number is computed by one thread as by any other. The small
levels are left to the first thread.

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, section 13.4.
"""

import math
import time
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import Array, kernel
from fecloth.compiled.team import SMALL
from fecloth.compiled.threads import ONLY, Member, part_of, wait
from fecloth.linalg import aggregation
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.conjugate_gradients import CONVERGED, OUT_OF_ITERATIONS, step
from fecloth.linalg.gauss_seidel import (
    SweepOrder,
    permute,
    permute_back,
    sweep_backward,
    sweep_forward,
    sweep_residual,
)
from fecloth.linalg.pcg import PCG, invert_diagonal
from fecloth.linalg.protocol import SolveInfo, block_rows, subtract_product


@dataclass(frozen=True)
class Grid:
    """What a level owes to the pattern of its matrix alone."""

    pattern: BlockPattern
    order: SweepOrder
    of_node: np.ndarray  # (n,) int32 aggregate of each node


@dataclass(frozen=True)
class Level:
    """A matrix and what a cycle needs of it."""

    grid: Grid
    A: BlockMatrix  # the matrix
    # (b − n, 3, 3) its blocks beside the diagonal, by colours. The blocks of the finest level
    # are in single precision, as are P and Pᵀ: reading them from memory takes most of the
    # time.
    values: np.ndarray
    inverse: np.ndarray  # (n, 6) inverses of the diagonal blocks, by colours
    # The prolongator and its transpose: nodes of this level by colours. The coarsest has 0
    # columns.
    P: sparse.bsr_matrix
    transposed: sparse.bsr_matrix
    work: np.ndarray  # (5, n, 3) work arrays

    @classmethod
    def allocate(
        cls, grid: Grid, A: BlockMatrix, inverse: np.ndarray, transposed: sparse.bsr_matrix
    ) -> Self:
        """The level of a matrix; its blocks have the precision of Pᵀ, whose columns are nodes."""
        n = len(A.pattern)
        b = len(grid.order.slots)
        transposed.indices = grid.order.places[transposed.indices]
        values = np.empty((b, 3, 3), transposed.dtype)
        work = np.zeros((5, n, 3))
        level = cls(grid, A, values, np.empty((n, 6)), transposed.T, transposed, work)
        level.refill(A, inverse)
        return level

    def refill(self, A: BlockMatrix, inverse: np.ndarray) -> None:
        """Take the blocks of a matrix of this pattern, and the inverses (n, 6) of its diagonal."""
        self.grid.order.gather(A, self.values)
        np.take(inverse, self.grid.order.nodes, axis=0, out=self.inverse)


def make_grids(pattern: BlockPattern) -> list[Grid]:
    """Coarsen a pattern until its aggregates are no fewer than half of its nodes."""
    of_node = aggregation.aggregate(pattern.indptr, pattern.indices)
    grid = Grid(pattern, SweepOrder.from_pattern(pattern), of_node)
    if 2 * (of_node.max() + 1) >= len(pattern):
        return [grid]
    return [grid, *make_grids(aggregation.coarse_pattern(pattern, of_node))]


def make_levels(
    grids: list[Grid], A: BlockMatrix, inverse: np.ndarray, motions: np.ndarray, kind: type
) -> list[Level]:
    """Compute the prolongators and the coarse matrices of A.

    `inverse` (n, 6) are the inverses of the diagonal blocks of A, `motions` (6, n, 3) the
    motions with little energy that all levels can represent, which are overwritten, and `kind`
    is the precision of the finest level.
    """
    grid, *coarser = grids
    if not coarser:
        empty = sparse.bsr_matrix((0, 3 * len(A.pattern)), blocksize=(3, 3), dtype=kind)
        return [Level.allocate(grid, A, inverse, empty)]
    motions *= aggregation.is_coupled(A)
    coarse_motions = aggregation.orthonormalise(grid.of_node, motions)
    P = aggregation.prolongator(A, inverse, grid.of_node, motions)
    coarse = aggregation.coarse_matrix(A, P, coarser[0].pattern)
    level = Level.allocate(grid, A, inverse, P.T.astype(kind).tobsr((3, 3)))
    del P  # what comes needs memory, too
    coarse_inverse = np.empty((len(coarse.pattern), 6))
    invert_diagonal(coarse, coarse_inverse, "multigrid, coarse matrix")
    return [level, *make_levels(coarser, coarse, coarse_inverse, coarse_motions, np.float64)]


NEW = 16  # iterations that cost as much as new coarse matrices


class Multigrid(PCG):
    """Conjugate gradients preconditioned by a cycle of multigrid.

    The aggregates are made once for each pattern. The coarse matrices are kept, also for other
    matrices, until the additional iterations have cost as much as new ones: then at most twice
    the best cost is paid. The text above says why the cycle remains definite. A solve fails
    after `max_iterations`.
    """

    name = "multigrid"
    symmetric = True
    keeps_state = True

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
        """Note the positions x (n, 3), about which the next coarse matrices represent rotations."""
        # Without a call they represent translations only.
        self._x = x

    def prepare(self, A: BlockMatrix) -> None:
        """Invert the diagonal blocks of A, and make coarse matrices if there are none."""
        super().prepare(A)
        begin = time.perf_counter()
        self._A = None
        if not self._grids or not A.pattern.same_as(self._grids[0].pattern):
            self._levels, self._grids = [], make_grids(A.pattern)
        if self._levels and self._extra < NEW:
            self._levels[0].refill(A, self._inverse)
        else:
            self._levels = []
            self._rate = 0.0
            self._extra = 0.0
            x = np.zeros((len(A.pattern), 3)) if self._x is None else self._x
            motions = aggregation.rigid_motions(x)
            self._levels = make_levels(self._grids, A, self._inverse, motions, np.float32)
        self._A = A
        self._seconds += time.perf_counter() - begin

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
        rz = self._carry[0]
        status = OUT_OF_ITERATIONS
        j = 0
        while j < limit and status == OUT_OF_ITERATIONS:
            z = cycle(self._levels, r, member)
            rz, status = step(*block_rows(A), x, r, z, p, q, self._sums, rz, threshold, member)
            j += status in (CONVERGED, OUT_OF_ITERATIONS)
        if member.thread == 0:
            self._carry[0] = rz
        return j, status


NOTHING = np.zeros((0, 3))  # below the coarsest level
FEW = 60  # nodes: below, a second cycle of a level saves no iteration


def cycle(levels: list[Level], b: np.ndarray, member: Member = ONLY) -> np.ndarray:
    """One cycle for A x = b, from 0: x (n, 3), valid until the next call."""
    level, *coarser = levels
    result: np.ndarray = level.work[1]
    own = level.grid.order.arrays, level.values, level.inverse
    coarse: np.ndarray = coarser[0].work[3] if coarser else NOTHING
    fine = level.work[0], result, level.work[2]
    descend(*own, b, *fine, *_rows(level.transposed), coarse, member)
    correction = correct(coarser, coarse, member) if coarser else coarse
    ascend(*own, *fine, *_rows(level.P), correction, member)
    return result


def _rows(matrix: sparse.bsr_matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return matrix.indptr, matrix.indices, matrix.data


def correct(levels: list[Level], b: np.ndarray, member: Member) -> np.ndarray:
    """The correction C b; b is overwritten."""
    level = levels[0]
    once = len(levels) == 1 or len(b) < FEW
    x: np.ndarray = level.work[1 if once else 4]
    if member.threads > 1 and len(b) < SMALL:
        if member.thread == 0:
            correct(levels, b, ONLY)
        wait(member)
    elif once:
        cycle(levels, b, member)
    else:
        subtract(*block_rows(level.A), b, cycle(levels, b, member), x, member)
        add(cycle(levels, b, member), x, member)
    return x


@kernel
def descend(
    order: tuple[Array, Array, Array, Array], values: Array, inverse: Array, b: Array, x: Array,
    r: Array, sorted_b: Array, p_indptr: Array, p_indices: Array, transposed: Array, coarse: Array,
    member: Member,
) -> None:  # fmt: skip
    """Sweep forward from x = 0, and write −Pᵀ (b − A x) to `coarse` (2m, 3)."""
    nodes, starts, indptr, indices = order
    permute(nodes, b, sorted_b, member)
    wait(member)
    sweep_forward(starts, indptr, indices, values, inverse, sorted_b, x, member)
    sweep_residual(starts, indptr, indices, values, x, r, member)
    begin, end = part_of(member, 0, len(coarse))
    coarse[begin:end] = 0.0
    subtract_product(begin, end, p_indptr, p_indices, transposed, coarse, r, coarse)
    wait(member)


@kernel
def ascend(
    order: tuple[Array, Array, Array, Array], values: Array, inverse: Array, x: Array,
    result: Array, sorted_b: Array, p_indptr: Array, p_indices: Array, P: Array, correction: Array,
    member: Member,
) -> None:  # fmt: skip
    """Take P times the correction (2m, 3) from x, sweep backward, write x by nodes to `result`."""
    nodes, starts, indptr, indices = order
    begin, end = part_of(member, 0, len(x))
    subtract_product(begin, end, p_indptr, p_indices, P, x, correction, x)
    wait(member)
    sweep_backward(starts, indptr, indices, values, inverse, sorted_b, x, member)
    permute_back(nodes, x, result, member)
    wait(member)


@kernel
def subtract(
    indptr: Array, indices: Array, values: Array, b: Array, y: Array, x: Array, member: Member
) -> None:
    """b −= A y; x = y."""
    begin, end = part_of(member, 0, len(x))
    subtract_product(begin, end, indptr, indices, values, b, y, b)
    for i in range(begin, end):
        x[i, 0] = y[i, 0]
        x[i, 1] = y[i, 1]
        x[i, 2] = y[i, 2]
    wait(member)


@kernel
def add(y: Array, x: Array, member: Member) -> None:
    """x += y."""
    begin, end = part_of(member, 0, len(x))
    for i in range(begin, end):
        for c in range(3):
            x[i, c] += y[i, c]
    wait(member)
