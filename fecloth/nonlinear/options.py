"""The options of Newton's iteration."""

from dataclasses import dataclass
from typing import Literal

from fecloth import validation
from fecloth.errors import InputError, flag, is_number
from fecloth.quantities.arguments import checks_arguments

# Of the forces: the residual of "auto" where the error is not estimated.
RESIDUAL_OF_AUTO = 1e-6
DEFINITENESS = ("none", "clamp", "on_failure")


@checks_arguments
@dataclass(frozen=True)
class Newton:
    """How the stage equation of an implicit step is solved.

    The residual of a step is ‖M a − f‖ in the free directions, divided by the forces of the
    step. These forces are ‖M a‖ plus the sum over the terms of ‖f_term‖ at the first iterate,
    with the reactions of the pins. One and the same residual is harmless on one fabric and as
    large as the error in time on another. So the tolerance "auto" compares errors: it ends the
    iteration when the error left in x and dt v is estimated at less than a tenth of the step's
    own error in time. `fecloth.nonlinear.error_left.ErrorLeft` estimates the first error,
    `fecloth.simulation.step_history.StepHistory` the second. The first steps, and all steps of
    energy–momentum, end at the residual 1e-6. `LinearlyImplicitEuler` has no iteration: its
    linear equation is solved to the relative residual 1e-4.

    If round-off keeps the residual above the tolerance, the step is accepted. It then counts as
    `limited`, and the run warns, unless the forces themselves are round-off.

    Where the tangent is not positive definite, as in compression, or its direction leads
    nowhere, "on_failure" tries three remedies in turn:

    1. clamped tangents, in at most four iterations of a step, if every force has a potential
       (damping has one in `BackwardEuler` and `BDF2` only);
    2. the exact tangent plus 1/4, 1, 4, … times the mass, and less again in the next iterations
       (after Nocedal and Wright 2006, algorithm 3.3);
    3. clamped tangents, where no multiple of the mass helps, as in very long steps.

    Clamping comes first, as it relieves the compression that a first guess leaves in one
    iteration. In a cloth that stays in compression a clamped tangent lacks what the solution
    has.

    Parameters
    ----------
    tolerance
        "auto": the iteration ends when its error is a tenth of the step's error in time, where
        contacts push not before the residual is 1 % of their forces, and at the latest at the
        residual 1e-6. A number: it ends at this residual, relative to the forces of
        the step. `fecloth/integrators/README.md` says when to give a number.
    max_iterations
        A step that needs more iterations fails.
    forcing
        Relative residual at which an iterative linear solver stops in each iteration.
    definiteness
        What replaces a tangent that is not positive definite, as in compression. "on_failure":
        remedies, one after the other, where the exact tangent fails. "clamp": always a clamped
        tangent, so that conjugate gradients always apply. "none": nothing, and the step fails.
    reuse
        Whether a direct solver takes a factor again in further iterations and steps, while
        that is cheaper than a new factor.
    """

    tolerance: float | Literal["auto"] = "auto"
    max_iterations: int = 200
    forcing: float = 1e-2
    definiteness: str = "on_failure"
    reuse: bool = True

    def __post_init__(self):
        tolerance = self.tolerance
        if tolerance != "auto" and not (is_number(tolerance) and 1e-13 <= tolerance < 1):
            allowed = 'must lie in [1e-13, 1), or be "auto"'
            raise InputError(f"tolerance = {tolerance!r}", allowed, "Newton")
        if not (is_number(self.forcing) and 0 < self.forcing < 1):
            raise InputError(f"forcing = {self.forcing!r}", "must lie in (0, 1)", "Newton")
        validation.whole("max_iterations", self.max_iterations, 1, "Newton")
        validation.one_of("definiteness", self.definiteness, DEFINITENESS, "Newton")
        flag("reuse", self.reuse, "Newton")

    @property
    def residual(self) -> float:
        """The relative residual at which the iteration ends in any case."""
        if self.tolerance == "auto":
            return RESIDUAL_OF_AUTO
        return self.tolerance
