"""Solution of a linear system whose matrix is a sparse one plus a matrix of low rank."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.errors import IndefiniteMatrix
from fecloth.linalg.protocol import LinearSolver, SolveInfo

Updates = list[tuple[float, np.ndarray]]
"""(c, u) of each update c u uᵀ, with u (n, 3)."""


@dataclass(frozen=True, eq=False)
class LowRankUpdate:
    """The update of A⁻¹ b to (A + Σ c u uᵀ)⁻¹ b, for any b.

    Sherman–Morrison–Woodbury formula, with y = A⁻¹ b and Z = A⁻¹ U:

        x = y − Z (1/c + Uᵀ Z)⁻¹ Uᵀ y

    Source: Hager (1989), Updating the Inverse of a Matrix, eq. 2.

    Attributes
    ----------
    U, Z
        (3n, k) the vectors u, and the solutions of A z = u.
    small
        (k, k) the matrix 1/c + Uᵀ Z.
    infos
        The `SolveInfo` of each solve for Z.
    """

    U: np.ndarray
    Z: np.ndarray
    small: np.ndarray
    infos: tuple[SolveInfo, ...]

    @classmethod
    def prepare(cls, solver: LinearSolver, updates: Updates, rtol: float) -> Self:
        """Solve for Z with the matrix A that `solver` has prepared; `updates` are not empty."""
        solutions = [solver.solve(u, rtol=rtol) for _, u in updates]
        Z = np.stack([z.ravel() for z, _ in solutions], axis=1)
        U = np.stack([u.ravel() for _, u in updates], axis=1)
        small = np.diag([1 / c for c, _ in updates]) + U.T @ Z
        return cls(U, Z, small, infos=tuple(info for _, info in solutions))

    def apply(self, y: np.ndarray) -> np.ndarray:
        """Return x (n, 3) for y = A⁻¹ b (n, 3)."""
        x: np.ndarray = y.ravel() - self.Z @ np.linalg.solve(self.small, self.U.T @ y.ravel())
        return x.reshape(y.shape)

    def require_definite(self, updates: Updates) -> None:
        """Raise `IndefiniteMatrix` if A + Σ c u uᵀ is not positive definite, where A is.

        1/c + Uᵀ Z and the sum are, up to signs, the two Schur complements of one matrix. So the
        sum is definite if 1/c + Uᵀ Z has as many negative eigenvalues as 1/c. Source: Haynsworth
        (1968), Determination of the inertia of a partitioned Hermitian matrix.
        """
        negative = sum(c < 0 for c, _ in updates)
        eigenvalues = np.linalg.eigvalsh(0.5 * (self.small + self.small.T))
        if (eigenvalues <= 0).sum() != negative:
            raise IndefiniteMatrix("a part of low rank makes A indefinite")


def solve_updated(
    solver: LinearSolver,
    updates: Updates,
    b: np.ndarray,
    rtol: float,
    guess: np.ndarray | None = None,
) -> tuple[np.ndarray, list[SolveInfo]]:
    """Solve (A + Σ c u uᵀ) x = b, where A is the matrix that `solver` has prepared.

    Parameters
    ----------
    solver
        The solver with A.
    updates
        (c, u) of each update, with u (n, 3).
    b
        (n, 3) the right side.
    rtol
        Relative residual of each solve with A.
    guess
        (n, 3) an initial y = A⁻¹ b.

    Returns
    -------
    tuple
        x (n, 3), and the `SolveInfo` of each solve with A.
    """
    y, info = solver.solve(b, rtol=rtol, guess=guess)
    if not updates:
        return y, [info]
    update = LowRankUpdate.prepare(solver, updates, rtol)
    return update.apply(y), [info, *update.infos]
