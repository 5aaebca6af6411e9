"""Selection of a solver of A x = b for a `BlockMatrix`.

`linalg.protocol.LinearSolver` says what they offer. The residual of every x that is returned has
been computed with A and found small enough.
"""

from __future__ import annotations

import math

from fecloth.errors import InputError
from fecloth.linalg.auto_solver import AutoSolver
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


def choose(
    condition: float, nodes: int, symmetric: bool
) -> tuple[Pardiso | SuperLU | AutoSolver, str]:
    """Create the solver "auto", and a text with its predicted cost.

    Conjugate gradients reduce the residual to ε in at most about ½ √κ ln(2/ε) iterations (Saad
    2003, section 6.11.3). This was compared with M + dt² K of stretched sheets with 556 to 101,300
    nodes, dt from 1e-4 to 3e-2 s and ε = 0.01. They took 0.2 to 0.6 of the bound, and 0.45 where
    both solvers cost the same. The bound is not sharp because `condition` bounds the worst
    triangle, and because block Jacobi is a better preconditioner than M. The prediction determines
    when a factorisation is tried first; afterwards `AutoSolver` uses the measured counts.

    Parameters
    ----------
    condition
        Upper bound of the condition number of M⁻¹ J: 1 + (wx/wa) ω²max + (wv/wa) d_max.
    nodes
        Number of nodes.
    symmetric
        Whether J is symmetric. If not, the result is a direct solver.
    """
    if not symmetric:
        return direct(symmetric=False), "the matrix is not symmetric"
    iterations = 0.45 * 0.5 * math.sqrt(condition) * math.log(2 / 0.01)
    solver = AutoSolver(nodes, iterations, lambda name: _price(name, nodes), direct)
    reason = f"at first; about {iterations:.0f} iterations are predicted"
    price = f"a factorisation costs as much as about {solver.price:.0f} iterations"
    return solver, f"{reason}, {price}"


def _price(name: str, nodes: int) -> float:
    """Time of a factorisation and a solve, in iterations of `PCG`, with one thread.

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
    root = math.sqrt(nodes)  # factorisation with nested dissection: n^1.5; an iteration: n
    return 45 + 0.37 * root if name == "pardiso" else 100 + 10 * root


def create(name: str, symmetric: bool = True) -> Pardiso | SuperLU | PCG | Multigrid:
    """Create the solver with one of the `NAMES`; "direct" is PARDISO if available, else SuperLU.

    Raises
    ------
    InputError
        For an unknown name, for "pcg" and "multigrid" with a matrix that is not symmetric, and for
        "pardiso" without the MKL.
    """
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
