"""Statistics of the equation solves of one or many steps."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Counts:
    """Counts and times of one solve.

    Attributes
    ----------
    newton, linear
        Iterations.
    modified
        Tangents that were clamped or had mass added.
    residual
        Relative to the forces of the step.
    seconds
        Of assembly, factorisation and solution.
    factorisations
        Or preconditioners: fewer than Newton iterations where a factor was reused.
    rejected
        Steps rejected before because they were too long.
    limited
        Steps whose residual stayed above Newton's tolerance as it is round-off.
    """

    newton: int = 0
    linear: int = 0
    modified: int = 0
    residual: float = 0.0
    seconds: dict = field(default_factory=dict)
    factorisations: int = 0
    rejected: int = 0
    limited: int = 0

    def plus(self, other: Counts) -> Counts:
        """Return the sums, with the residual of `other`."""
        names = ("newton", "linear", "modified", "factorisations", "rejected", "limited")
        sums = {name: getattr(self, name) + getattr(other, name) for name in names}
        keys = {**self.seconds, **other.seconds}
        seconds = {k: self.seconds.get(k, 0.0) + other.seconds.get(k, 0.0) for k in keys}
        return Counts(**sums, residual=other.residual, seconds=seconds)


def warn_of_round_off(steps: int) -> str:
    """Return a sentence about this number of steps that round-off limited; "" for none."""
    if not steps:
        return ""
    many = f"{steps} steps were" if steps > 1 else "1 step was"
    return (
        f"{many} solved to round-off only, which is above Newton's tolerance: ask for a greater "
        "tolerance, or take away what is stiff and small, such as slivers"
    )
