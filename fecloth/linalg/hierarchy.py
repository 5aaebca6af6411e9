"""The coarser and coarser matrices of algebraic multigrid, and one V-cycle over them.

A level consists of a matrix, its aggregates and its prolongator P; the next one has Pᵀ A P. A
V-cycle sweeps forward over the nodes of a level, corrects by the V-cycle of the next level, and
sweeps backward:

    M⁻¹ = (D + U)⁻¹ D (D + L)⁻¹ + (I − (D + U)⁻¹ A) P M_c⁻¹ Pᵀ (I − A (D + L)⁻¹)

with A = L + D + U. This is symmetric for every symmetric A, and positive definite as soon as the
diagonal blocks D of all levels are. It needs no bound of eigenvalues, and remains definite if the
coarse levels are those of another matrix.

Source: Vaněk, Mandel and Brezina (1996), Algebraic multigrid by smoothed aggregation for second
and fourth order elliptic problems.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.linalg.aggregation import Aggregates, orthonormalise
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.linalg.coarse_matrix import Transfer, add_prolonged, clear_uncoupled, restrict
from fecloth.linalg.gauss_seidel import SweepOrder
from fecloth.linalg.pcg import invert_diagonal
from fecloth.linalg.protocol import block_rows

DAMPING = 0.5  # of the Jacobi step that smooths a prolongator; 4/3 over the eigenvalues 2.3 to 3


@dataclass(frozen=True)
class Grid:
    """What a level owes to the pattern of its matrix alone; `transfer` is None for the coarsest."""

    pattern: BlockPattern
    order: SweepOrder
    transfer: Transfer | None


@dataclass(frozen=True)
class Level:
    """A matrix without its diagonal, D⁻¹ (n, 6), its prolongator, and work arrays (3, n, 3).

    The matrix and the prolongator are in single precision: a V-cycle takes as long as they take
    to be read from memory, and it is symmetric and definite for any matrix.
    """

    grid: Grid
    values: np.ndarray
    inverse: np.ndarray
    P: np.ndarray
    work: np.ndarray


def make_grids(pattern: BlockPattern) -> list[Grid]:
    """Coarsen a pattern until its aggregates are no fewer than half of its nodes."""
    aggregates = Aggregates.of(pattern)
    order = SweepOrder.of(pattern)
    if 2 * len(aggregates) >= len(pattern):
        return [Grid(pattern, order, None)]
    transfer = Transfer.of(pattern, aggregates)
    return [Grid(pattern, order, transfer), *make_grids(transfer.coarse)]


def make_levels(
    grids: list[Grid], A: BlockMatrix, inverse: np.ndarray, motions: np.ndarray
) -> list[Level]:
    """Compute the prolongators and the coarse matrices of A.

    Parameters
    ----------
    inverse
        (n, 6) inverses of the diagonal blocks of A.
    motions
        (n, 3, 6) motions with little energy that all levels can represent.

    Raises
    ------
    IndefiniteMatrix, SolveFailed
        If a coarse diagonal block is not positive definite, and so A is not; or not finite.
    """
    grid, *coarser = grids
    values, work = grid.order.gather(A), np.zeros((3, len(A.pattern), 3))
    if grid.transfer is None:
        return [Level(grid, values, inverse, np.zeros((0, 3, 6), np.float32), work)]
    aggregates, rows = grid.transfer.aggregates, block_rows(A)
    T, coarse_motions = motions.copy(), np.zeros((len(aggregates), 6, 6))
    clear_uncoupled(*rows, T)
    orthonormalise(aggregates.starts, aggregates.members, T, coarse_motions)
    P = grid.transfer.prolongator(rows, inverse, DAMPING, T)
    coarse = grid.transfer.coarse_matrix(rows, P)
    coarse_inverse = np.empty((len(coarse.pattern), 6))
    invert_diagonal(coarse, coarse_inverse, "multigrid, coarse matrix")
    below = make_levels(coarser, coarse, coarse_inverse, coarse_motions.reshape(-1, 3, 6))
    return [Level(grid, values, inverse, P.astype(np.float32), work), *below]


def cycle(levels: list[Level], b: np.ndarray) -> np.ndarray:
    """One V-cycle for A x = b, from 0: x (n, 3), valid until the next call."""
    level, *coarser = levels
    order, values, inverse = level.grid.order, level.values, level.inverse
    x, r, _ = level.work
    order.forward(values, inverse, b, x)
    if level.grid.transfer is not None:
        transfer, coarse = level.grid.transfer, coarser[0].work[2]
        order.residual(values, x, r)
        restrict(*transfer.columns, level.P, r, coarse.reshape(-1, 6))
        correction = cycle(coarser, coarse).reshape(-1, 6)
        add_prolonged(transfer.indptr, transfer.indices, level.P, correction, x)
    order.backward(values, inverse, b, x)
    return x
