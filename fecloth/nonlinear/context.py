"""What a step solves its equations with: a linear solver, its matrix, Newton's options."""

from __future__ import annotations

from dataclasses import dataclass, field

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import LinearSolver
from fecloth.nonlinear.factor_reuse import PRICES, Kept
from fecloth.nonlinear.options import Newton


@dataclass(eq=False)
class SolverContext:
    """What steps share to solve their equations; every step changes it.

    Attributes
    ----------
    linear, matrix
        The linear solver, and the matrix that each iteration fills; None for explicit methods.
    options
        Newton's.
    kept
        What is known of the factor that the linear solver holds from an earlier iteration.
    """

    linear: LinearSolver | None
    matrix: BlockMatrix | None
    options: Newton
    kept: Kept = field(default_factory=Kept)

    def begin(self, wx: float, wa: float) -> None:
        """Begin a step with these weights of K and M; "auto" may change its linear solver."""
        self.matrix_solver()[0].begin(wx, wa)

    def matrix_solver(self) -> tuple[LinearSolver, BlockMatrix]:
        """The linear solver and its matrix; raise `InputError` if there is none."""
        if self.linear is None or self.matrix is None:
            raise InputError("SolverContext.linear = None", "serves explicit methods only", "step")
        return self.linear, self.matrix

    @property
    def keeps_state(self) -> bool:
        """Whether a step may depend on what the steps before have left in the solver."""
        if self.linear is None:
            return False
        return self.linear.keeps_state or (self.linear.name in PRICES and self.options.reuse)

    def drop(self) -> None:
        """Forget the steps before: those that follow do not depend on them."""
        self.kept.drop()
        if self.linear is not None:
            self.linear.drop()
