"""The linear solver, its matrix and Newton's options, shared by all steps of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import LinearSolver
from fecloth.nonlinear.error_left import StepError
from fecloth.nonlinear.factor_reuse import PRICES, FactorReuse
from fecloth.nonlinear.options import Newton


@dataclass(eq=False)
class SolverContext:
    """The solvers that steps share; every step changes their state."""

    # The linear solver, and the matrix that each iteration fills; None for explicit methods.
    linear: LinearSolver | None
    matrix: BlockMatrix | None
    options: Newton  # newton's
    # The record of the factor that the linear solver holds from an earlier iteration.
    factor_reuse: FactorReuse = field(default_factory=FactorReuse)
    # The error in time of the next step, for the tolerance "auto"; None where it is not known.
    step_error: StepError | None = None

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Begin a step near x with these weights of K and M; "auto" may change its solver here."""
        self.matrix_solver()[0].begin(wx, wa, x)

    def matrix_solver(self) -> tuple[LinearSolver, BlockMatrix]:
        """The linear solver and its matrix; raise `InputError` if there is none."""
        if self.linear is None or self.matrix is None:
            raise InputError("SolverContext.linear = None", "serves explicit methods only", "step")
        return self.linear, self.matrix

    @property
    def keeps_state(self) -> bool:
        """Whether a step may depend on the work of earlier steps."""
        if self.linear is None:
            return False
        return self.linear.keeps_state or (self.linear.name in PRICES and self.options.reuse)

    def drop(self) -> None:
        """Forget earlier steps, so that later ones do not depend on them."""
        self.factor_reuse.drop()
        if self.linear is not None:
            self.linear.drop()
