"""Selection of a solver of A x = b for a `BlockMatrix`.

`linalg.protocol.LinearSolver` says what they offer. The residual of every x that is returned has
been computed with A and found small enough.
"""

from __future__ import annotations

from fecloth.errors import InputError
from fecloth.linalg.auto_solver import AutoSolver
from fecloth.linalg.block_matrix import BlockPattern
from fecloth.linalg.direct import Pardiso, SuperLU
from fecloth.linalg.multigrid import Multigrid
from fecloth.linalg.pcg import PCG
from fecloth.linalg.protocol import SolveInfo

NAMES = ("direct", "pardiso", "superlu", "pcg", "multigrid")

__all__ = [
    "NAMES",
    "PCG",
    "AutoSolver",
    "Multigrid",
    "Pardiso",
    "SolveInfo",
    "SuperLU",
    "choose",
    "create",
    "direct",
]


def direct(symmetric: bool = True) -> Pardiso | SuperLU:
    """Create PARDISO if the MKL can be loaded, else SuperLU."""
    try:
        return Pardiso(symmetric)
    except (ImportError, OSError):
        return SuperLU(symmetric)


def choose(pattern: BlockPattern, symmetric: bool) -> tuple[Pardiso | SuperLU | AutoSolver, str]:
    """Create the solver "auto" for matrices of a pattern, and a text with what it compares.

    If they are not symmetric, it is a direct solver.
    """
    if not symmetric:
        return direct(symmetric=False), "the matrix is not symmetric"
    solver = AutoSolver(pattern, direct)
    price = solver.guess("direct")
    return solver, f"at first; a factor and a solve cost about as much as {price:.0f} iterations"


def create(name: str, symmetric: bool = True) -> Pardiso | SuperLU | PCG | Multigrid:
    """Create the solver with one of the `NAMES`; "direct" is PARDISO if available, else SuperLU."""
    what, where = f"solver {name!r}", "linalg.select.create"
    if name not in NAMES:
        raise InputError(what, f"must be one of {', '.join(NAMES)}", where)
    if name in ("pcg", "multigrid"):
        if not symmetric:
            remedy = 'Use "auto" or "direct"; or EnergyMomentum with tangent = "symmetric".'
            raise InputError(what, "supports symmetric matrices only", where, remedy)
        return PCG() if name == "pcg" else Multigrid()
    if name == "pardiso":
        try:
            return Pardiso(symmetric)
        except (ImportError, OSError) as error:
            remedy = 'Install pypardiso (x86-64 only: "pip install pypardiso") or use "superlu".'
            raise InputError(what, f"cannot be loaded ({error})", where, remedy) from error
    return SuperLU(symmetric) if name == "superlu" else direct(symmetric)
