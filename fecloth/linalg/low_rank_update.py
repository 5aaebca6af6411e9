"""Solution of a linear system whose matrix is a sparse one plus a matrix of low rank."""

from __future__ import annotations

import numpy as np

from fecloth.linalg.protocol import LinearSolver, SolveInfo


def solve_updated(
    solver: LinearSolver,
    updates: list[tuple[float, np.ndarray]],
    b: np.ndarray,
    rtol: float,
    guess: np.ndarray | None = None,
) -> tuple[np.ndarray, list[SolveInfo]]:
    """Solve (A + Σ c u uᵀ) x = b, where A is the matrix that `solver` has prepared.

    Sherman–Morrison–Woodbury formula: with y = A⁻¹ b and Z = A⁻¹ U,
    x = y − Z (1/c + Uᵀ Z)⁻¹ Uᵀ y.
    Source: Hager (1989), Updating the Inverse of a Matrix, eq. 2.

    Parameters
    ----------
    updates
        (c, u) of each update, u of shape (n, 3).
    b
        (n, 3) right-hand side.
    rtol
        Relative residual of each solve with A.
    guess
        (n, 3) initial y, or None.

    Returns
    -------
    x (n, 3), and the `SolveInfo` of each solve with A.
    """
    x, info = solver.solve(b, rtol=rtol, guess=guess)
    if not updates:
        return x, [info]
    columns = [solver.solve(u, rtol=rtol) for _, u in updates]
    Z = np.stack([z.ravel() for z, _ in columns], axis=1)
    U = np.stack([u.ravel() for _, u in updates], axis=1)
    small = np.diag([1 / c for c, _ in updates]) + U.T @ Z
    x = x - (Z @ np.linalg.solve(small, U.T @ x.ravel())).reshape(x.shape)
    return x, [info, *(other for _, other in columns)]
