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
from fecloth.nonlinear.last_stage import LastStage
from fecloth.nonlinear.options import Newton

# By solver: what a tangent and its factor cost, in solves and residuals with it, on one thread.
# PCG has no factor to keep.
PRICES = {"pardiso": 5.0, "rslab": 7.0, "superlu": 20.0}
# After failures in a row reuse is tried again after so many new factors at the latest. It may pay
# again later in a run, and a failed attempt costs less than a factor.
LONGEST_WAIT = 64


@dataclass
class FactorReuse:
    """The record of a factor for reuse; the linear solver holds the factor itself.

    Attributes
    ----------
    key
        The system, the weights and the definiteness of its matrix; None without a factor.
    number
        The count `prepared` of the linear solver when it made the factor. A later factor
        replaces it, and then the count is another one.
    steps
        Steps since then.
    solves
        Iterations in these steps.
    failures
        Failures of reuse in a row.
    wait
        Number of new factors before the next attempt.
    """

    key: tuple | None = None
    number: int = 0
    steps: int = 0
    solves: int = 0
    failures: int = 0
    wait: int = 0

    def is_usable(self, key: tuple, linear) -> bool:
        """Whether the factor of the linear solver has this key, and reuse is not suspended."""
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
        """Record an iteration with the old factor; drop it if the next ones cost too much.

        They cost too much if a new factor costs less. `contraction` is the new residual over the
        old one, and `to_go` the goal over the new residual: ln(to_go)/ln(contraction) iterations
        remain. After each failure in a row reuse is suspended for 1, 2, 4, … new factors.
        """
        self.solves += 1
        is_reuse_cheaper = contraction == 0.0 or to_go >= 1.0  # the goal is reached
        if not is_reuse_cheaper and contraction < 1.0:
            iterations_left = math.log(to_go) / math.log(contraction)
            is_reuse_cheaper = iterations_left < PRICES[linear.name]
        if is_reuse_cheaper:
            self.failures = 0
            return
        self.failures += 1
        self.key = None
        self.wait = min(2 ** (self.failures - 1), LONGEST_WAIT)

    def end_step(self, solves: int, linear) -> None:
        """Record the solves of a step; drop the factor if they are more than its mean cost."""
        if self.key is None:
            return
        cost_before = PRICES[linear.name] + self.solves - solves
        if self.steps and solves > cost_before / max(self.steps, 1):
            self.key = None
        self.steps += 1

    def drop(self) -> None:
        """Forget all steps, so that later ones do not depend on them."""
        self.key = None
        self.number = self.steps = self.solves = self.failures = self.wait = 0


@dataclass(eq=False)
class SolverContext:
    """The solvers that steps share; every step changes their state.

    Attributes
    ----------
    linear
        The linear solver; None for explicit methods.
    matrix
        The matrix that each iteration fills; None for explicit methods.
    options
        How Newton's iteration solves a step.
    factor_reuse
        The record of the factor that the linear solver holds from an earlier iteration.
    step_error
        The error in time of the next step, for the tolerance "auto"; None where it is not known.
    last_stage
        The joined calls of the last stage.
    """

    linear: LinearSolver | None
    matrix: BlockMatrix | None
    options: Newton
    factor_reuse: FactorReuse = field(default_factory=FactorReuse)
    step_error: StepError | None = None
    last_stage: LastStage = field(default_factory=LastStage)

    def begin(self, wx: float, wa: float, x: np.ndarray) -> None:
        """Begin a step near x (n, 3) with these weights of K and M.

        Here the linear solver "auto" may change its method.
        """
        self.matrix_solver()[0].begin(wx, wa, x)

    def matrix_solver(self) -> tuple[LinearSolver, BlockMatrix]:
        """The linear solver and its matrix; raise `InputError` if there is none."""
        if self.linear is None or self.matrix is None:
            allowed = "serves explicit methods only"
            raise InputError("SolverContext.linear = None", allowed, "step")
        return self.linear, self.matrix

    @property
    def keeps_state(self) -> bool:
        """Whether a step may depend on the work of earlier steps."""
        if self.linear is None:
            return False
        return self.linear.keeps_state or (self.linear.name in PRICES and self.options.reuse)

    def drop(self) -> None:
        """Forget the work of earlier steps, so that later ones do not depend on it."""
        self.factor_reuse.drop()
        if self.linear is not None:
            self.linear.drop()
