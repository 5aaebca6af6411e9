"""The options of Newton's iteration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from fecloth.errors import InputError, is_number

RESIDUAL = 1e-6  # where the tolerance is "auto" and there is no estimate
DEFINITENESS = ("none", "clamp", "on_failure")


@dataclass(frozen=True)
class Newton:
    """How the stage equation is solved.

    `fecloth.nonlinear.error_left.ErrorLeft` says how the error that is left is estimated, and
    `fecloth.simulation.step_history.StepHistory` the error in time of a step.

    Parameters
    ----------
    tolerance
        A number, or "auto".
        A number is the residual ‖M a − f‖ of the free directions at which a step is solved,
        relative to the forces of the step: ‖M a‖ plus the sum over the terms of ‖f_term‖ at the
        first iterate, with the reactions of the pins. The same residual is harmless on one fabric
        and as large as the error in time on another.
        "auto" ends the iteration as soon as the error that it leaves in x and dt v is estimated at
        less than a tenth of the step's own error in time; at the latest it ends at a residual of
        1e-6. The first steps, and all steps of energy–momentum, end at that residual. Give a
        number where runs are compared that differ by less than their error in time, or for an
        exact balance of momentum.
        A step whose residual is round-off is solved, also above the tolerance; if its forces are
        more than round-off, it counts as `limited`, and the run warns.
    max_iterations
        A step that needs more iterations fails.
    forcing
        Relative residual at which an iterative linear solver stops in each iteration.
    definiteness
        "none": the exact tangent; "clamp": every term's tangent made positive semi-definite,
        and symmetric, so that conjugate gradients serve where exact tangents are not symmetric;
        "on_failure": exact, and where that is not positive definite or its direction leads
        nowhere, clamped, in at most four iterations of a step, if every force has a potential (as
        damping has in `BackwardEuler` and `BDF2` only); then with a multiple of the mass
        added: 1/4, 1, 4, … times, and less again in the next iterations (after Nocedal and Wright
        2006, algorithm 3.3); where no multiple will do, as in steps so long that the mass hardly
        counts, clamped tangents. Clamping relieves in one iteration the compression that a first
        guess leaves in the plane, for which the added mass takes six. A cloth in compression is
        unstable for good; there clamping alone converges slowly, as it takes away what the
        solution has: on a flag at dt = 10 ms in up to 129 iterations a step, with added mass 23.
    reuse
        Whether a direct solver's factor serves further iterations, and steps of the same size,
        while that is cheaper than a new one; see `context.FactorReuse`.
    """

    tolerance: float | Literal["auto"] = "auto"
    max_iterations: int = 200
    forcing: float = 1e-2
    definiteness: str = "on_failure"
    reuse: bool = True

    def __post_init__(self):
        if self.tolerance != "auto" and not (
            is_number(self.tolerance) and 1e-13 <= self.tolerance < 1
        ):
            allowed = 'must lie in [1e-13, 1), or be "auto"'
            raise InputError(f"tolerance = {self.tolerance!r}", allowed, "Newton")
        if not (is_number(self.forcing) and 0 < self.forcing < 1):
            raise InputError(f"forcing = {self.forcing!r}", "must lie in (0, 1)", "Newton")
        most = self.max_iterations
        if not (isinstance(most, int) and not isinstance(most, bool) and most >= 1):
            raise InputError(f"max_iterations = {most!r}", "must be an integer >= 1", "Newton")
        if self.definiteness not in DEFINITENESS:
            allowed = f"must be one of {', '.join(DEFINITENESS)}"
            raise InputError(f"definiteness = {self.definiteness!r}", allowed, "Newton")
        if not isinstance(self.reuse, bool):
            raise InputError(f"reuse = {self.reuse!r}", "must be True or False", "Newton")

    @property
    def residual(self) -> float:
        """The relative residual at which the iteration ends in any case."""
        return RESIDUAL if self.tolerance == "auto" else self.tolerance
