"""What the steps of a run share: the linear solver, the factor that it holds, and the options.

With the factor of an earlier tangent Newton's iteration converges linearly. That pays while
the additional solves cost less than a new factor. The decisions use counts of solves and no
clock, so that a run repeats bit for bit. (Kelley 1995, Iterative Methods for Linear and
Nonlinear Equations, algorithm 5.3.2, the chord method.)
"""

import math
from dataclasses import dataclass, field

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.protocol import LinearSolver
from fecloth.nonlinear.error_left import StepError
from fecloth.nonlinear.options import Newton

# A tangent and its factor in solves and residuals with it, one thread. (PCG has no factor to
# keep.)
PRICES = {"pardiso": 5.0, "superlu": 20.0}
LONGEST_WAIT = 64


@dataclass
class FactorReuse:
    """The record of a factor for reuse; the linear solver holds the factor itself."""

    # The system, the weights and the definiteness of the factor's matrix; None without a factor.
    key: tuple | None = None
    # `prepared` of the linear solver when it made the factor; a later one replaces it.
    number: int = 0
    # Steps since then, and iterations in them.
    steps: int = 0
    solves: int = 0
    # Consecutive failures of reuse, and the number of new factors before the next attempt.
    failures: int = 0
    wait: int = 0

    def is_usable(self, key: tuple, linear) -> bool:
        """Return whether the linear solver's factor has this key and reuse is not suspended."""
        if self.wait or self.key is None or self.number != linear.prepared:
            return False
        return self.key[0] is key[0] and self.key[1:] == key[1:]

    def record_factor(self, key: tuple, linear) -> None:
        """Record a new factor; solvers without a price have none to reuse."""
        self.key = key if linear.name in PRICES else None
        self.number = linear.prepared
        self.steps = self.solves = 0
        self.wait = max(0, self.wait - 1)

    def record_iteration(self, contraction: float, to_go: float, linear) -> None:
        """Record an iteration, and drop the factor if the remaining ones cost more than a new one.

        `contraction` is the new residual over the old one, and `to_go` the goal over the new
        residual: ln(to_go)/ln(contraction) iterations remain. After each consecutive failure
        reuse is suspended for 1, 2, 4, … new factors.
        """
        self.solves += 1
        cheap = contraction == 0.0 or to_go >= 1.0
        if not cheap and contraction < 1.0:
            cheap = math.log(to_go) / math.log(contraction) < PRICES[linear.name]
        if cheap:
            self.failures = 0
        else:
            self.failures += 1
            self.key, self.wait = None, min(2 ** (self.failures - 1), LONGEST_WAIT)

    def end_step(self, solves: int, linear) -> None:
        """Record the solves of a step; drop the factor if they exceed its average cost per step."""
        if self.key is None:
            return
        average = (PRICES[linear.name] + self.solves - solves) / max(self.steps, 1)
        if self.steps and solves > average:
            self.key = None
        self.steps += 1

    def drop(self) -> None:
        """Forget all steps, so that later ones do not depend on them."""
        self.key = None
        self.number = self.steps = self.solves = self.failures = self.wait = 0


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
        self.factor_reuse.drop()
        if self.linear is not None:
            self.linear.drop()
