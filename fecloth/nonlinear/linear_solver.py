"""The linear solver of a system, with the matrix that it solves."""

from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import LinearSolver
from fecloth.system.system import System


def make_linear_solver(
    system: System, choice: str, symmetric: bool
) -> tuple[LinearSolver, BlockMatrix, str]:
    """Create a linear solver and its matrix; also return a text that says why it was chosen.

    Parameters
    ----------
    system
        What moves. If it is shared by several processes, it brings its own solver.
    choice
        "auto" or one of `select.NAMES`.
    symmetric
        Whether the matrices are symmetric.
    """
    shared = system.shared_solver(choice, symmetric)
    if shared is not None:
        return shared
    solver: LinearSolver
    if choice == "auto":
        solver, why = select.choose(system.pattern, symmetric)
    else:
        solver = select.create(choice, symmetric)
        why = "requested"
    return solver, BlockMatrix.zeros(system.pattern, system.team), why
