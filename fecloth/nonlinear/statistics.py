"""Statistics of the equation solves of one or many steps."""

from dataclasses import dataclass, field, replace
from typing import Self

SUMMED = (
    "newton",
    "linear",
    "modified",
    "factorisations",
    "rejected",
    "limited",
    "estimated",
    "newton_error",
    "step_error",
)


@dataclass(frozen=True)
class Counts:
    """Counts and times of one solve, or of many.

    Attributes
    ----------
    newton
        Newton iterations.
    linear
        Iterations of the linear solver.
    modified
        Tangents that were clamped or had mass added.
    residual
        The residual, relative to the forces of the step.
    seconds
        Times of assembly, factorisation and solution [s].
    factorisations
        New factors or preconditioners; fewer than `newton` where a factor was reused.
    rejected
        Steps rejected before because they were too long.
    limited
        Steps whose residual stayed above Newton's tolerance because it was round-off.
    estimated
        Steps that ended because Newton's error was small against their error in time.
    newton_error
        Sum over these steps: estimate of the error that Newton's iteration left [m].
    step_error
        Sum over these steps: estimate of the error in time [m].
    """

    newton: int = 0
    linear: int = 0
    modified: int = 0
    residual: float = 0.0
    seconds: dict = field(default_factory=dict)
    factorisations: int = 0
    rejected: int = 0
    limited: int = 0
    estimated: int = 0
    newton_error: float = 0.0
    step_error: float = 0.0

    def plus(self, other: Self) -> Self:
        """The sums, with the residual of `other`."""
        sums = {name: getattr(self, name) + getattr(other, name) for name in SUMMED}
        seconds = {
            name: self.seconds.get(name, 0.0) + other.seconds.get(name, 0.0)
            for name in {**self.seconds, **other.seconds}
        }
        return replace(self, **sums, residual=other.residual, seconds=seconds)


def describe_newton_error(
    steps: int, estimated: int, newton_error: float, step_error: float
) -> str:
    """A sentence about steps that ended by `ErrorLeft`, from sums of errors; "" for none."""
    if not estimated:
        return ""
    percent = f"{100 * newton_error / step_error:.2g} %"
    where = f"in {estimated} of {steps} steps"
    return f"error of Newton's iteration about {percent} of the error in time {where}"
