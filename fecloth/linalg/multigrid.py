"""Conjugate gradients preconditioned by smoothed-aggregation multigrid, shared by threads.

A cycle sweeps forward over the nodes of a level, corrects by the next level, and sweeps
backward:

    M⁻¹ = (D + U)⁻¹ D (D + L)⁻¹ + (I − (D + U)⁻¹ A) P C Pᵀ (I − A (D + L)⁻¹)

with A = L + D + U. The correction C consists of two cycles of the next level (a W-cycle),
since these cost little and save a third of the iterations; on a small level it is one. M⁻¹
is symmetric for every symmetric A, and positive definite where C and D are. This needs no bound
of eigenvalues, as Chebyshev smoothing does, and it remains true if the coarse levels belong to
another matrix. C is definite because the eigenvalues of M⁻¹ Pᵀ A P are between 0 and 1 on all
levels that belong together.

All threads call the functions of a cycle. The nodes of a colour, the rows and the aggregates
are divided among them. Each number is computed by one thread, and it does not matter by which.
The small levels are left to the first thread.

Source: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd edition, section 13.4.
"""

import math
import time
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import Array, kernel
from fecloth.compiled.team import SMALLEST_SHARED_LOOP
from fecloth.compiled.threads import ONLY, Member, part_of, wait
from fecloth.linalg import aggregation
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.conjugate_gradients import CONVERGED, OUT_OF_ITERATIONS, START, step
from fecloth.linalg.gauss_seidel import (
    SweepOrder,
    permute,
    permute_back,
    sweep_backward,
    sweep_forward,
    sweep_residual,
)
from fecloth.linalg.mixed_precision import BEGIN, Progress, status_of_round
from fecloth.linalg.pcg import PCG, invert_diagonal
from fecloth.linalg.protocol import (
    BlockRows,
    SolveInfo,
    block_rows,
    relative_residual,
    subtract_product,
)
from fecloth.linalg.reductions import squared_norm


@dataclass(frozen=True)
class Grid:
    """The part of a level that depends on the pattern of its matrix alone.

    Attributes
    ----------
    pattern
        The pattern.
    order
        Its nodes by colours.
    of_node
        (n,) int32 aggregate of each node.
    """

    pattern: BlockPattern
    order: SweepOrder
    of_node: np.ndarray


class Sweeps(NamedTuple):
    """The arrays of a level in the order of its colours, for kernels: see `SweepOrder`.

    Attributes
    ----------
    nodes, starts, indptr, indices
        As in `SweepOrder`.
    values
        (b − n, 3, 3) blocks beside the diagonal.
    inverse
        (n, 6) inverses of the diagonal blocks.
    """

    nodes: np.ndarray
    starts: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    values: np.ndarray
    inverse: np.ndarray


class Work(NamedTuple):
    """Vectors (n, 3) of a level that its cycles overwrite.

    Attributes
    ----------
    x, r, b
        The unknown, the residual and the right side of a cycle, by colours. At the end of a
        cycle r holds the result, by nodes.
    load
        The right side by nodes, from the finer level.
    first
        The result of the first of two cycles.
    """

    x: np.ndarray
    r: np.ndarray
    b: np.ndarray
    load: np.ndarray
    first: np.ndarray

    @property
    def result(self) -> np.ndarray:
        """The result of a cycle, by nodes."""
        return self.r


@dataclass(frozen=True)
class Level:
    """A matrix, and all that a cycle needs for it.

    The blocks of the finest level are in single precision, as are P and Pᵀ: reading them from
    memory takes most of the time.

    Attributes
    ----------
    grid
        The order and the aggregates of its nodes.
    A
        The matrix.
    values
        (b − n, 3, 3) its blocks beside the diagonal, by colours.
    inverse
        (n, 6) inverses of its diagonal blocks, by colours.
    P, transposed
        The prolongator and its transpose, with the nodes of this level by colours. On the
        coarsest level P has no columns.
    work
        Vectors that cycles overwrite.
    """

    grid: Grid
    A: BlockMatrix
    values: np.ndarray
    inverse: np.ndarray
    P: sparse.bsr_matrix
    transposed: sparse.bsr_matrix
    work: Work

    @classmethod
    def allocate(
        cls, grid: Grid, A: BlockMatrix, inverse: np.ndarray, transposed: sparse.bsr_matrix
    ) -> Self:
        """Return the level of a matrix A, from the inverses (n, 6) of its diagonal blocks.

        `transposed` is Pᵀ; its columns, the nodes, are renumbered in place by colours. The blocks
        of the level get its precision.
        """
        n = len(A.pattern)
        transposed.indices = grid.order.places[transposed.indices]
        x, r, b, load, first = np.zeros((5, n, 3))
        level = cls(
            grid=grid,
            A=A,
            values=np.empty((len(grid.order.slots), 3, 3), transposed.dtype),
            inverse=np.empty((n, 6)),
            P=transposed.T,
            transposed=transposed,
            work=Work(x=x, r=r, b=b, load=load, first=first),
        )
        level.refill(A, inverse)
        return level

    def refill(self, A: BlockMatrix, inverse: np.ndarray) -> None:
        """Copy the blocks of a matrix of this pattern, and the inverses (n, 6) of its diagonal."""
        self.grid.order.gather(A, self.values)
        np.take(inverse, self.grid.order.nodes, axis=0, out=self.inverse)

    @cached_property
    def sweeps(self) -> Sweeps:
        """The arrays of the level by colours, as kernels take them."""
        order = self.grid.order
        return Sweeps(
            nodes=order.nodes,
            starts=order.starts,
            indptr=order.indptr,
            indices=order.indices,
            values=self.values,
            inverse=self.inverse,
        )


def make_grids(pattern: BlockPattern) -> list[Grid]:
    """Coarsen a pattern until its aggregates are no fewer than half of its nodes."""
    of_node = aggregation.aggregate(pattern.indptr, pattern.indices)
    grid = Grid(pattern, SweepOrder.from_pattern(pattern), of_node)
    if 2 * (of_node.max() + 1) >= len(pattern):
        return [grid]
    return [grid, *make_grids(aggregation.coarse_pattern(pattern, of_node))]


def make_levels(
    grids: list[Grid], A: BlockMatrix, inverse: np.ndarray, motions: np.ndarray, precision: type
) -> list[Level]:
    """Return the levels of A, the finest first, with their prolongators and coarse matrices.

    Raises `IndefiniteMatrix` or `SolveFailed` if a diagonal block of a coarse matrix is not
    positive definite or not finite.

    Parameters
    ----------
    grids
        A grid for each level, from `make_grids`.
    A
        The matrix of the finest level.
    inverse
        (n, 6) the inverses of its diagonal blocks.
    motions
        (6, n, 3) the motions with little energy, which all levels represent; overwritten.
    precision
        The type of the numbers of the finest level; the coarser ones have double precision.
    """
    grid, *coarser = grids
    if not coarser:
        shape = 0, 3 * len(A.pattern)
        no_columns = sparse.bsr_matrix(shape, blocksize=(3, 3), dtype=precision)
        return [Level.allocate(grid, A, inverse, transposed=no_columns)]
    # a pinned component is coupled to no other node: the coarse levels shall not move it
    motions *= aggregation.is_coupled(A)
    coarse_motions = aggregation.orthonormalise(grid.of_node, motions)
    P = aggregation.prolongator(A, inverse, grid.of_node, motions)
    coarse_A = aggregation.coarse_matrix(A, P, coarser[0].pattern)
    level = Level.allocate(grid, A, inverse, P.T.astype(precision).tobsr((3, 3)))
    del P  # the coarser levels need its memory
    coarse_inverse = np.empty((len(coarse_A.pattern), 6))
    invert_diagonal(coarse_A, coarse_inverse, "multigrid, coarse matrix")
    # the coarser levels are small: single precision would save little
    coarser_levels = make_levels(
        coarser, coarse_A, coarse_inverse, coarse_motions, precision=np.float64
    )
    return [level, *coarser_levels]


# Iterations that take as long as new coarse matrices.
ITERATIONS_PER_REBUILD = 16


class Multigrid(PCG):
    """Conjugate gradients preconditioned by a cycle of multigrid.

    The aggregates are made once for each pattern. The coarse matrices are kept, also for other
    matrices, until the additional iterations have cost as much as new coarse matrices. So at
    most twice the least cost is paid. The text of this module says why the cycle remains
    definite. A solve fails after `max_iterations`.
    """

    name = "multigrid"
    symmetric = True
    keeps_state = True
    takes_single = False

    def __init__(self, max_iterations: int = 10_000):
        super().__init__(max_iterations)
        self._grids: list[Grid] = []
        self.drop()

    def drop(self) -> None:
        """Forget the coarse matrices and the positions."""
        self._levels: list[Level] = []
        # Iterations per ln(1/rtol) of the first solve with these coarse matrices, and the
        # iterations that later solves took beyond this rate.
        self._first_rate = 0.0
        self._extra_iterations = 0.0
        self._x: np.ndarray | None = None

    @property
    def wear(self) -> float:
        """The additional iterations over the number at which new coarse matrices are made."""
        return self._extra_iterations / ITERATIONS_PER_REBUILD

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Note the positions x (n, 3): the next coarse matrices represent rotations about them.

        Without a call they represent translations only.
        """
        self._x = x

    def prepare(self, A: BlockMatrix) -> None:
        """Take a new matrix A: invert its diagonal blocks, and make coarse matrices if needed.

        The coarse matrices of an earlier A are kept, if the pattern is the same, until the
        additional iterations with them have cost as much as new ones. Raises `IndefiniteMatrix`
        or `SolveFailed` as `invert_diagonal` does.
        """
        super().prepare(A)
        begin = time.perf_counter()
        self._A = None
        if not self._grids or not A.pattern.same_as(self._grids[0].pattern):
            self._levels = []
            self._grids = make_grids(A.pattern)
        if self._levels and self.wear < 1.0:
            self._levels[0].refill(A, self._inverse)  # the coarser levels stay
        else:
            self._levels = []  # the new levels need its memory
            self._first_rate = 0.0
            self._extra_iterations = 0.0
            x = self._x
            if x is None:
                x = np.zeros((len(A.pattern), 3))
            motions = aggregation.rigid_motions(x)
            self._levels = make_levels(self._grids, A, self._inverse, motions, precision=np.float32)
        self._A = A
        self._seconds += time.perf_counter() - begin

    def solve(
        self, b: np.ndarray, rtol: float = 1e-10, guess: np.ndarray | None = None
    ) -> tuple[np.ndarray, SolveInfo]:
        """Solve A x = b (n, 3), starting from `guess` (n, 3) or 0: x (n, 3) and `SolveInfo`."""
        x, info = super().solve(b, rtol, guess)
        goal = math.log(1 / rtol)
        self._first_rate = self._first_rate or info.iterations / goal
        self._extra_iterations += max(0.0, info.iterations - self._first_rate * goal)
        return x, info

    def _solve(self, A: BlockMatrix, b: np.ndarray, x: np.ndarray, rtol: float) -> Progress:
        """Solve A x = b from x, which becomes the solution; return how it ended.

        The iterations are in float64. They begin again from the true residual as in
        `solve_by_cg`.
        """
        r = self._work.double.r
        bb = squared_norm(b)
        r[:] = b
        reached = float(bb > 0.0)
        if x.any():
            reached = relative_residual(A, b, bb, x, r)
        progress = BEGIN._replace(status=CONVERGED, reached=reached, bb=bb)
        loop = partial(self._loop, A, x, rtol * rtol * bb)
        while not progress.reached <= rtol and progress.status == CONVERGED:
            start = progress._replace(status=OUT_OF_ITERATIONS, carry=START)
            progress = self._iterate(A, loop, start)
            reached = relative_residual(A, b, bb, x, r)
            if progress.status == CONVERGED:
                status = status_of_round(start.reached, reached, rtol)
                progress = progress._replace(status=status)
            progress = progress._replace(reached=reached)
        return progress

    def _loop(
        self, A: BlockMatrix, x: np.ndarray, threshold: float, limit: int, progress: Progress,
        member: Member,
    ) -> Progress:  # fmt: skip
        """Iterate as one of the threads until ‖r‖² <= `threshold`, up to iteration `limit`.

        M⁻¹ r of an iteration is a cycle of multigrid. `progress` is what the call before
        returned.
        """
        rows = block_rows(A)
        rz = progress.carry.rz  # of the iteration before; −1 for a start
        status = progress.status
        j = progress.iterations
        while j < limit and status == OUT_OF_ITERATIONS:
            z = cycle(self._levels, self._work.double.r, member)
            vectors = self._work.double._replace(z=z)
            rz, status = step(rows, x, vectors, self._work.sums, rz, threshold, member)
            j += status in (CONVERGED, OUT_OF_ITERATIONS)
        carry = START._replace(rz=rz)
        return progress._replace(iterations=j, status=status, carry=carry)


# The load and the correction of a level that does not exist: below the coarsest one.
NOTHING = np.zeros((0, 3))
# Nodes of a level from which on two cycles are worth their time: below, a second cycle saves no
# iteration.
FEWEST_NODES_OF_TWO_CYCLES = 60


def cycle(levels: list[Level], b: np.ndarray, member: Member = ONLY) -> np.ndarray:
    """One cycle for A x = b, from x = 0; the result x (n, 3) is valid until the next call."""
    level, *coarser = levels
    load = coarser[0].work.load if coarser else NOTHING
    descend(level.sweeps, level.work, b, _rows_of(level.transposed), load, member)
    correction = correct(coarser, load, member) if coarser else load
    ascend(level.sweeps, level.work, _rows_of(level.P), correction, member)
    return level.work.result


def _rows_of(matrix: sparse.bsr_matrix) -> BlockRows:
    """The arrays of a SciPy matrix of 3×3 blocks."""
    return BlockRows(matrix.indptr, matrix.indices, matrix.data)


def correct(levels: list[Level], b: np.ndarray, member: Member) -> np.ndarray:
    """Return the correction C b, by two cycles or on a small or the coarsest level by one.

    b is overwritten, and the result is valid until the next call. All threads call this function
    and share a large level; a small one is left to the first thread, while the others wait.
    """
    level = levels[0]
    is_single = len(levels) == 1 or len(b) < FEWEST_NODES_OF_TWO_CYCLES
    x = level.work.result if is_single else level.work.first
    if member.threads > 1 and len(b) < SMALLEST_SHARED_LOOP:
        if member.thread == 0:
            correct(levels, b, ONLY)
        wait(member)
    elif is_single:
        cycle(levels, b, member)
    else:
        first = cycle(levels, b, member)
        subtract(block_rows(level.A), b, first, x, member)  # b becomes the residual, x = first
        second = cycle(levels, b, member)
        add(second, x, member)
    return x


@kernel
def descend(
    sweeps: Sweeps, work: Work, b: Array, transposed: BlockRows, load: Array, member: Member
) -> None:
    """Sweep forward from x = 0, and write −Pᵀ (b − A x) to `load` (2m, 3).

    So the correction has the opposite sign, and `ascend` subtracts it. `transposed` is Pᵀ; x by
    colours is left in ``work.x``.
    """
    nodes, starts, indptr, indices, values, inverse = sweeps
    permute(nodes, b, work.b, member)
    wait(member)
    sweep_forward(starts, indptr, indices, values, inverse, work.b, work.x, member)
    sweep_residual(starts, indptr, indices, values, work.x, work.r, member)
    begin, end = part_of(member, 0, len(load))
    load[begin:end] = 0.0
    subtract_product(begin, end, transposed, load, work.r, load)
    wait(member)


@kernel
def ascend(sweeps: Sweeps, work: Work, P: BlockRows, correction: Array, member: Member) -> None:
    """x −= P times the correction (2m, 3), sweep backward, and write x by nodes to `work.r`."""
    nodes, starts, indptr, indices, values, inverse = sweeps
    begin, end = part_of(member, 0, len(work.x))
    subtract_product(begin, end, P, work.x, correction, work.x)
    wait(member)
    sweep_backward(starts, indptr, indices, values, inverse, work.b, work.x, member)
    permute_back(nodes, work.x, work.r, member)
    wait(member)


@kernel
def subtract(A: BlockRows, b: Array, y: Array, x: Array, member: Member) -> None:
    """b −= A y; x = y."""
    begin, end = part_of(member, 0, len(x))
    subtract_product(begin, end, A, b, y, b)
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
