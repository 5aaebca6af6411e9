"""The coarser and coarser matrices of algebraic multigrid, and a cycle over them.

A level consists of a matrix, its aggregates and its prolongator P; the next one has Pᵀ A P. A
cycle sweeps forward over the nodes of a level, corrects by the next level, and sweeps backward:

    M⁻¹ = (D + U)⁻¹ D (D + L)⁻¹ + (I − (D + U)⁻¹ A) P C Pᵀ (I − A (D + L)⁻¹)

with A = L + D + U. The correction C consists of two cycles of the next level (a W-cycle), since
these cost a tenth of the sweeps and save a third of the iterations. M⁻¹ is symmetric for every
symmetric A, and positive definite where C and D are. This needs no bound of eigenvalues, and it
remains true if the coarse levels are those of another matrix. (Chebyshev smoothing needs a bound:
with 1.1 times the estimate of 15 power iterations the cycle of a sheet of 8,000 triangles was
indefinite, and with Gershgorin's bound it took half as many iterations again.) C is definite
because the eigenvalues of M⁻¹ Pᵀ A P are between 0 and 1 on all levels that belong together.

Source: Vaněk, Mandel and Brezina (1996), Algebraic multigrid by smoothed aggregation for second
and fourth order elliptic problems; Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd
edition, section 13.4 (cycles).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fecloth.linalg.aggregation import Aggregates, orthonormalise
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.coarse_matrix import Transfer, add_prolonged, clear_uncoupled, restrict
from fecloth.linalg.diagonal_blocks import invert_diagonal
from fecloth.linalg.gauss_seidel import SweepOrder
from fecloth.linalg.protocol import block_rows, residual

NONE = np.zeros((0, 3, 6))  # no prolongator
DAMPING = 0.6  # of the Jacobi step that smooths a prolongator: about 4/3 over eigenvalues of 2.3


@dataclass(frozen=True)
class Grid:
    """What a level owes to the pattern of its matrix alone; `transfer` is None for the coarsest."""

    pattern: BlockPattern
    order: SweepOrder
    transfer: Transfer | None


@dataclass(frozen=True)
class Level:
    """A matrix and what a cycle needs of it.

    Attributes
    ----------
    A
        The matrix.
    values
        (b − n, 3, 3) its blocks beside the diagonal, by colours. Those of the finest level are in
        single precision, as are P and `columns`: reading them from memory takes most of the time.
    inverse
        (n, 6) inverses of the diagonal blocks, by colours.
    P, columns
        (p, 3, 6) the blocks of the prolongator by rows and, once more, by columns.
    work
        (5, n, 3) work arrays.
    """

    grid: Grid
    A: BlockMatrix
    values: np.ndarray
    inverse: np.ndarray
    P: np.ndarray
    columns: np.ndarray
    work: np.ndarray

    def refill(self, A: BlockMatrix, inverse: np.ndarray) -> None:
        """Take the blocks of a matrix of this pattern, and the inverses (n, 6) of its diagonal."""
        self.grid.order.gather(A, self.values)
        self.grid.order.permute(inverse, self.inverse)


def make_grids(pattern: BlockPattern) -> list[Grid]:
    """Coarsen a pattern until its aggregates are no fewer than half of its nodes."""
    aggregates = Aggregates.of(pattern)
    order = SweepOrder.of(pattern)
    if 2 * len(aggregates) >= len(pattern):
        return [Grid(pattern, order, None)]
    transfer = Transfer.of(pattern, aggregates)
    return [Grid(pattern, order, transfer), *make_grids(transfer.coarse)]


def make_levels(
    grids: list[Grid], A: BlockMatrix, inverse: np.ndarray, motions: np.ndarray, kind: type
) -> list[Level]:
    """Compute the prolongators and the coarse matrices of A.

    Parameters
    ----------
    inverse
        (n, 6) inverses of the diagonal blocks of A.
    motions
        (n, 3, 6) motions with little energy that all levels can represent.
    kind
        Precision of the finest level.

    Raises
    ------
    IndefiniteMatrix, SolveFailed
        If a coarse diagonal block is not positive definite, and so A is not; or not finite.
    """
    grid, *coarser = grids
    n = len(A.pattern)
    values: np.ndarray = np.empty((len(grid.order.slots), 3, 3), kind)
    level = Level(grid, A, values, np.empty((n, 6)), NONE, NONE, np.zeros((5, n, 3)))
    level.refill(A, inverse)
    if grid.transfer is None:
        return [level]
    aggregates, rows = grid.transfer.aggregates, block_rows(A)
    T, coarse_motions = motions.copy(), np.zeros((len(aggregates), 6, 6))
    clear_uncoupled(*rows, T)
    orthonormalise(aggregates.starts, aggregates.members, T, coarse_motions)
    P = grid.transfer.prolongator(rows, inverse, DAMPING, T)
    coarse = grid.transfer.coarse_matrix(rows, P)
    coarse_inverse = np.empty((len(coarse.pattern), 6))
    invert_diagonal(coarse, coarse_inverse, "multigrid, coarse matrix")
    below = coarse_motions.reshape(-1, 3, 6)
    levels = make_levels(coarser, coarse, coarse_inverse, below, np.float64)
    P = P.astype(kind)
    return [replace(level, P=P, columns=P[grid.transfer.entries]), *levels]


def cycle(levels: list[Level], b: np.ndarray) -> np.ndarray:
    """One cycle for A x = b, from 0: x (n, 3), valid until the next call."""
    level, *coarser = levels
    order, values, inverse = level.grid.order, level.values, level.inverse
    x, sorted_b = level.work[0], level.work[2]
    r: np.ndarray = level.work[1]
    order.permute(b, sorted_b)
    order.forward(values, inverse, sorted_b, x)
    if level.grid.transfer is not None:
        transfer, coarse = level.grid.transfer, coarser[0].work[3]
        order.residual(values, x, r)
        own = transfer.starts, transfer.rows, order.places
        restrict(*own, level.columns, r, coarse.reshape(-1, 6))
        correction = _two_cycles(coarser, coarse).reshape(-1, 6)
        add_prolonged(transfer.indptr, transfer.indices, order.places, level.P, correction, x)
    order.backward(values, inverse, sorted_b, x)
    order.permute_back(x, r)
    return r


def _two_cycles(levels: list[Level], b: np.ndarray) -> np.ndarray:
    """Two cycles for A x = b, from 0; b is overwritten by the residual after the first one."""
    level = levels[0]
    if level.grid.transfer is None:
        return cycle(levels, b)
    x: np.ndarray = level.work[4]
    x[:] = cycle(levels, b)
    residual(*block_rows(level.A), b, x, b)
    x += cycle(levels, b)
    return x
