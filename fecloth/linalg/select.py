"""Solvers of A x = b for a `BlockMatrix`, and the choice between them.

`linalg.protocol.LinearSolver` says what they offer. The residual of every x that is returned has
been computed with A and found small enough.
"""

from __future__ import annotations

import math

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.auto_solver import Cheapest
from fecloth.linalg.direct import Pardiso, SuperLU
from fecloth.linalg.pcg import PCG
from fecloth.linalg.protocol import LinearSolver, SolveInfo

NAMES = ("direct", "pardiso", "superlu", "pcg")

__all__ = [
    "NAMES",
    "PCG",
    "Cheapest",
    "Pardiso",
    "SolveInfo",
    "SuperLU",
    "choose",
    "direct",
    "named",
    "updated",
]


def direct(symmetric: bool = True) -> Pardiso | SuperLU:
    """PARDISO where the MKL can be loaded, else SuperLU."""
    try:
        return Pardiso(symmetric)
    except (ImportError, OSError):
        return SuperLU(symmetric)


def choose(
    condition: float, nodes: int, symmetric: bool
) -> tuple[Pardiso | SuperLU | Cheapest, str]:
    """The solver of "auto", and what is known of it before the first step.

    Conjugate gradients reduce the residual to ε in at most about ½ √κ ln(2/ε) iterations (Saad
    2003, section 6.11.3). On M + dt² K of stretched sheets with 556 to 101,300 nodes and dt from
    1e-4 to 3e-2 s, ε = 0.01, they took 0.2 to 0.6 of that, 0.45 where both solvers cost alike:
    `condition` bounds the worst triangle, and block Jacobi does better than M. That decides how
    soon a factorisation is tried; `Cheapest` follows what the steps turn out to cost.

    Parameters
    ----------
    condition
        A bound on the condition number of M⁻¹ J: 1 + (wx/wa) ω²max + (wv/wa) d_max.
    nodes
        Number of nodes.
    symmetric
        Whether J is; only direct solvers take one that is not.
    """
    if not symmetric:
        return direct(symmetric=False), "the matrix is not symmetric"
    iterations = 0.45 * 0.5 * math.sqrt(condition) * math.log(2 / 0.01)
    solver = Cheapest(nodes, iterations, lambda name: _price(name, nodes), direct)
    reason = f"to start with; about {iterations:.0f} iterations of it predicted"
    return solver, f"{reason}, a factorisation costs about {solver.price:.0f}"


def _price(name: str, nodes: int) -> float:
    """Time of a factorisation and a solve in iterations of `PCG`, one thread.

    ======== ======= =======
    nodes    PARDISO SuperLU
    ======== ======= =======
    556      57      310
    1,681    65      420
    4,154    64      550
    11,365   75      850
    26,636   105     2,070
    101,300  163
    ======== ======= =======
    """
    root = math.sqrt(nodes)  # a factor of nested dissection takes n^1.5, an iteration n
    return 45 + 0.37 * root if name == "pardiso" else 100 + 10 * root


def updated(
    solver: LinearSolver, updates: list[tuple[float, np.ndarray]], b, rtol: float, guess=None
):
    """x (n, 3) of (A + Σ c u uᵀ) x = b for the A that was prepared, and the `SolveInfo`s.

    Sherman, Morrison and Woodbury: with y = A⁻¹ b and Z = A⁻¹ U,
    x = y − Z (1/c + Uᵀ Z)⁻¹ Uᵀ y (Hager 1989, Updating the Inverse of a Matrix, eq. 2).
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


def named(name: str, symmetric: bool = True) -> Pardiso | SuperLU | PCG:
    """The solver of one of the `NAMES`; "direct" is PARDISO if there is one.

    Raises
    ------
    InputError
        Unknown name, "pcg" for a matrix that is not symmetric, "pardiso" without the MKL.
    """
    what, where = f"solver {name!r}", "linear.named"
    if name not in NAMES:
        raise InputError(what, f"must be one of {', '.join(NAMES)}", where)
    if name == "pcg":
        if not symmetric:
            remedy = 'Use "auto" or "direct"; or EnergyMomentum with tangent = "symmetric".'
            raise InputError(what, "takes symmetric matrices only", where, remedy)
        return PCG()
    if name == "pardiso":
        try:
            return Pardiso(symmetric)
        except (ImportError, OSError) as error:
            remedy = 'Install pypardiso (x86-64 only: "pip install pypardiso"), or use "superlu".'
            raise InputError(what, f"cannot be loaded ({error})", where, remedy) from error
    return SuperLU(symmetric) if name == "superlu" else direct(symmetric)
