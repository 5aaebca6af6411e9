"""Statistics of the equation solves of one or many steps."""

from dataclasses import dataclass, field, replace
from typing import Self

SUMMED = (
    *("newton", "linear", "modified", "factorisations", "rejected", "limited"),
    *("estimated", "newton_error", "step_error"),
)


@dataclass(frozen=True)
class Counts:
    """Counts and times of one solve."""

    newton: int = 0  # iterations
    linear: int = 0  # iterations
    modified: int = 0  # tangents that were clamped or had mass added
    residual: float = 0.0  # relative to the forces of the step
    seconds: dict = field(default_factory=dict)  # of assembly, factorisation and solution
    factorisations: int = 0  # or preconditioners; fewer than `newton` where a factor was reused
    rejected: int = 0  # steps rejected before because they were too long
    # steps whose residual stayed above Newton's tolerance because it was round-off
    limited: int = 0
    # steps that ended because Newton's error was small against their error in time
    estimated: int = 0
    newton_error: float = 0.0  # of these steps: estimate of what Newton's iteration left [m]
    step_error: float = 0.0  # of these steps: estimate of the error in time [m]

    def plus(self, other: Self) -> Self:
        """Return the sums, with the residual of `other`."""
        sums = {name: getattr(self, name) + getattr(other, name) for name in SUMMED}
        keys = {**self.seconds, **other.seconds}
        seconds = {k: self.seconds.get(k, 0.0) + other.seconds.get(k, 0.0) for k in keys}
        return replace(self, **sums, residual=other.residual, seconds=seconds)


def warn_of_round_off(steps: int) -> str:
    """Return a sentence about this number of steps that round-off limited; "" for none."""
    if not steps:
        return ""
    many = f"{steps} steps were" if steps > 1 else "1 step was"
    return (
        f"{many} solved to round-off only, which is above Newton's tolerance: ask for a greater "
        "tolerance, or take away what is stiff and small, such as slivers"
    )


def describe_newton_error(
    steps: int, estimated: int, newton_error: float, step_error: float
) -> str:
    """Return a sentence about steps that ended by `ErrorLeft`, from sums of errors; "" for none."""
    if not estimated:
        return ""
    percent = f"{100 * newton_error / step_error:.2g} %"
    where = f"in {estimated} of {steps} steps"
    return f"error of Newton's iteration about {percent} of the error in time {where}"
