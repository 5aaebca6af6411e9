"""The coarser and coarser matrices of algebraic multigrid.

A level consists of a matrix, its aggregates and its prolongator P; the next one has Pᵀ A P. See
`multigrid` for what is done with them, and `aggregation` for the source.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.linalg.aggregation import Aggregates, orthonormalise
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.coarse_matrix import Transfer, clear_uncoupled
from fecloth.linalg.gauss_seidel import SweepOrder, gather
from fecloth.linalg.pcg import invert_diagonal

NONE, EMPTY = np.zeros((0, 3, 6)), np.zeros(1, np.int32)  # no prolongator
DAMPING = 0.6  # of the Jacobi step that smooths a prolongator: about 4/3 over eigenvalues of 2.3


@dataclass(frozen=True)
class Grid:
    """What a level owes to the pattern of its matrix alone; `transfer` is None for the coarsest."""

    pattern: BlockPattern
    order: SweepOrder
    transfer: Transfer | None

    @property
    def transfer_arrays(self) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """P by columns and by rows: starts and rows; indptr and indices."""
        if self.transfer is None:
            return (EMPTY, EMPTY[:0]), (EMPTY, EMPTY[:0])
        own = self.transfer
        return (own.starts, own.rows), (own.indptr, own.indices)


@dataclass(frozen=True)
class Level:
    """A matrix and what a cycle needs of it."""

    grid: Grid
    A: BlockMatrix  # the matrix
    # (b − n, 3, 3) its blocks beside the diagonal, by colours. The blocks of the finest level are
    # in single precision, as are P and `columns`: reading them from memory takes most of the time.
    values: np.ndarray
    inverse: np.ndarray  # (n, 6) inverses of the diagonal blocks, by colours
    # (p, 3, 6) the blocks of the prolongator by rows and, once more, by columns.
    P: np.ndarray
    columns: np.ndarray
    work: np.ndarray  # (5, n, 3) work arrays

    @classmethod
    def allocate(
        cls, grid: Grid, A: BlockMatrix, inverse: np.ndarray, P: np.ndarray, columns: np.ndarray
    ) -> Self:
        """The level of a matrix; its blocks have the precision of P."""
        n, b = len(A.pattern), len(grid.order.slots)
        values: np.ndarray = np.empty((b, 3, 3), P.dtype)
        level = cls(grid, A, values, np.empty((n, 6)), P, columns, np.zeros((5, n, 3)))
        level.refill(A, inverse)
        return level

    def refill(self, A: BlockMatrix, inverse: np.ndarray) -> None:
        """Take the blocks of a matrix of this pattern, and the inverses (n, 6) of its diagonal."""
        self.grid.order.gather(A, self.values)
        np.take(inverse, self.grid.order.nodes, axis=0, out=self.inverse)


def make_grids(pattern: BlockPattern) -> list[Grid]:
    """Coarsen a pattern until its aggregates are no fewer than half of its nodes."""
    aggregates = Aggregates.from_pattern(pattern)
    order = SweepOrder.from_pattern(pattern)
    if 2 * len(aggregates) >= len(pattern):
        return [Grid(pattern, order, None)]
    transfer = Transfer.from_aggregates(pattern, aggregates)
    return [Grid(pattern, order, transfer), *make_grids(transfer.coarse)]


def make_levels(
    grids: list[Grid], A: BlockMatrix, inverse: np.ndarray, motions: np.ndarray, kind: type
) -> list[Level]:
    """Compute the prolongators and the coarse matrices of A.

    `inverse` (n, 6) are the inverses of the diagonal blocks of A, `motions` (n, 3, 6) the motions
    with little energy that all levels can represent, which are overwritten, and `kind` is the
    precision of the finest level.
    """
    grid, *coarser = grids
    if grid.transfer is None:
        return [Level.allocate(grid, A, inverse, NONE.astype(kind), NONE.astype(kind))]
    clear_uncoupled(A, motions)
    coarse_motions = orthonormalise(grid.transfer.aggregates, motions, A.team)
    exact = grid.transfer.prolongator(A, inverse, DAMPING, motions)
    coarse = grid.transfer.coarse_matrix(A, exact)
    P: np.ndarray = exact.astype(kind, copy=False)
    del exact  # what comes needs memory, too
    columns = np.empty_like(P)
    gather(grid.transfer.entries, P, columns, A.team)
    coarse_inverse = np.empty((len(coarse.pattern), 6))
    invert_diagonal(coarse, coarse_inverse, "multigrid, coarse matrix")
    below = coarse_motions.reshape(-1, 3, 6)
    levels = make_levels(coarser, coarse, coarse_inverse, below, np.float64)
    return [Level.allocate(grid, A, inverse, P, columns), *levels]
