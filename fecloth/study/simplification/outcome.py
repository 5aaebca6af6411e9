"""What the runs of simpler scenes gave: their changes, the errors of the scene, the verdicts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from fecloth.study.result import in_percent
from fecloth.study.simplification.variants import Variant
from fecloth.study.status import OK

# Differences of seconds are noise below this part of the seconds of a scene, and below so many
# seconds.
NOISE_PART = 0.05
NOISE_SECONDS = 0.02
SIZES = {  # words, name and unit of what a check refines, by its kind
    "mesh": ("mesh", "h", " m"),
    "dt": ("time step", "dt", " s"),
    "rtol": ("tolerance of the steps", "rtol", " 1/s"),
}


@dataclass(frozen=True)
class Outcome:
    """The run of a simpler scene beside the run of the scene.

    Attributes
    ----------
    name
        Name of the variant.
    status
        How the run ended; see `fecloth.study.status`.
    cause
        Cause of a failure.
    changes
        Relative change of each quantity, by its text.
    seconds
        CPU time of the run [s].
    saved
        Part of the scene's seconds that it saves.
    triangles, steps
        Size of the run.
    """

    name: str
    status: str
    cause: str = ""
    changes: Mapping[str, float] = field(default_factory=dict)
    seconds: float = math.nan
    saved: float = math.nan
    triangles: int | None = None
    steps: int | None = None

    @property
    def is_ok(self) -> bool:
        """Whether the run reached its end."""
        return self.status == OK

    @property
    def change(self) -> float:
        """The largest change; infinite for a failure."""
        if self.is_ok:
            return max(self.changes.values())
        return math.inf

    @property
    def whole(self) -> float:
        """CPU seconds of the scene."""
        return self.seconds / (1 - self.saved)

    @property
    def is_slower(self) -> bool:
        """Whether it takes longer than the scene, by more than noise."""
        return self.seconds > (1 + NOISE_PART) * self.whole + NOISE_SECONDS

    @property
    def of(self) -> str:
        """The quantity that changes most."""
        return max(self.changes, key=lambda name: self.changes[name], default="")

    @property
    def saving_per_change(self) -> float:
        """The saving per change, by which variants are sorted; without saving it is ≤ 0."""
        if self.saved > 0:
            return self.saved / max(self.change, np.finfo(float).eps)
        return self.saved


Trial = tuple[Variant, Outcome]


@dataclass(frozen=True)
class Resolution:
    """The error of a scene by one of its sizes, from half of h, half of dt or less rtol.

    Attributes
    ----------
    kind
        "mesh", "dt" or "rtol".
    error
        Estimated relative error.
    quantity
        The quantity whose error needs the smallest size.
    size
        h [m], dt [s] or rtol [1/s] of the scene.
    needed
        The size at which the error would be within the tolerance.
    failure
        Why the error is unknown, or "".
    """

    kind: str
    error: float
    quantity: str
    size: float
    needed: float
    failure: str = ""

    @property
    def is_resolved(self) -> bool:
        """Whether the error is known and within the tolerance."""
        return self.needed >= self.size

    def __str__(self) -> str:
        """Return in words the error, and the size that would be fine enough if it is too large.

        If the error is not known, say why.
        """
        what, name, unit = SIZES[self.kind]
        if self.failure:
            return f"whether the {what} is resolved is not known: {self.failure}"
        text = f"the error of the {what} is about {in_percent(self.error)} ({self.quantity})"
        if self.is_resolved:
            return text
        needed = f"{name} of about {round_down(self.needed):g}{unit}"
        return f"{text}; {needed} in place of {self.size:g}{unit} would do"


def find_resolutions(
    checks: Sequence[Trial], orders: Mapping[str, Mapping[str, float]], tolerance: float
) -> list[Resolution]:
    """Return the error by each size that was refined.

    A refinement by r that changes a quantity by c shows the error c/(1 − r^−p) for the order p
    (Richardson 1911); the size for the tolerance t is the present size times (t/error)^(1/p).
    `orders` are the orders of each quantity, by its text and the kind of the size.
    """
    return [_find_resolution(variant, run, orders, tolerance) for variant, run in checks]


def _find_resolution(
    variant: Variant,
    run: Outcome,
    orders: Mapping[str, Mapping[str, float]],
    tolerance: float,
) -> Resolution:
    """Return the error by one size of the scene, of the quantity that needs the smallest size.

    `variant` is the refinement of this size, and `run` what it gave. If the run failed, the
    error is NaN and the needed size 0, and `failure` says why. See `find_resolutions`.
    """
    kind = variant.kind
    size = variant.size
    if not run.is_ok:
        first_line = (run.cause.splitlines() or [run.status])[0]
        failure = f"{variant.name}: {first_line}"
        return Resolution(kind, math.nan, quantity="", size=size, needed=0.0, failure=failure)
    resolutions = []
    for text, change in run.changes.items():
        order = orders[text][kind]
        error = change / (1 - variant.by**order)  # the size was multiplied by `by` = 1/r
        needed = math.inf  # without an error any size is small enough
        if error:
            needed = size * (tolerance / error) ** (1 / order)
        resolutions.append(Resolution(kind, error, text, size, needed))
    return min(resolutions, key=attrgetter("needed"))


def round_down(value: float) -> float:
    """Return a number with two digits that is not larger."""
    if not 0 < value < math.inf:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)  # of the second digit
    return float(f"{math.floor(value / unit + 1e-9) * unit:.2g}")  # 1e-9 is round-off


@dataclass(frozen=True)
class Findings:
    """All variants with their outcomes, and the errors of the scene itself."""

    trials: Sequence[Trial]
    tolerance: float
    resolutions: Sequence[Resolution] = ()

    @property
    def unresolved(self) -> set[str]:
        """The kinds of sizes whose error is above the tolerance."""
        return {size.kind for size in self.resolutions if not size.is_resolved}

    @property
    def ranked(self) -> list[Trial]:
        """The variants, the smallest change first."""
        return sorted(self.trials, key=lambda trial: trial[1].change)

    def judge(self, variant: Variant, outcome: Outcome) -> str:
        """Return the verdict on a variant, as the table shows it.

        A refinement says whether its size is resolved. Another variant is "needed" if the scene
        needs what the variant changes: it fails without, or its quantities change by more than
        the tolerance. A small change that is not reliable is small "by chance".
        """
        if variant.is_check:
            if variant.kind in self.unresolved:
                return "not resolved"
            return "resolved"
        if not outcome.is_ok or outcome.change > self.tolerance:
            return "needed"
        if self.reliable_change(variant, outcome) > self.tolerance:
            return "by chance"
        if outcome.is_slower:
            return "not needed, saves nothing"
        return "not needed"

    def reliable_change(self, variant: Variant, outcome: Outcome) -> float:
        """Return the change by a variant that is not smaller by chance.

        If a mesh of 2 h changes the quantities less than a mesh of 1.5 h, it does so by chance.
        Therefore the largest change by this variant and by all that change the same size by a
        smaller factor is returned. If the scene itself is not resolved in this size, no change
        is reliable, and infinity is returned.
        """
        if variant.kind in self.unresolved:
            return math.inf
        changes = [outcome.change]
        if variant.size:  # only sizes have factors that can be compared
            for other, outcome_of_other in self.trials:
                if other.kind == variant.kind and other.by <= variant.by:
                    changes.append(outcome_of_other.change)
        return max(changes)

    def candidates(self) -> list[Variant]:
        """Return the variants within the tolerance, the greatest saving per change first.

        A replacement must save time; a dropped term need not. Larger triangles and steps are
        candidates only if the scene itself is resolved.
        """

        candidates = [
            (variant, outcome)
            for variant, outcome in self.trials
            if not variant.is_check and self._is_worth(variant, outcome)
        ]
        candidates.sort(key=lambda trial: -trial[1].saving_per_change)
        return [variant for variant, _ in candidates]

    def _is_worth(self, variant: Variant, outcome: Outcome) -> bool:
        """Whether a variant saves time, or makes the scene simpler, and changes little."""
        if not outcome.is_ok:
            return False
        is_dropped = variant.kind == "without" and not outcome.is_slower
        if not is_dropped and outcome.saved <= NOISE_PART:
            return False
        return self.reliable_change(variant, outcome) <= self.tolerance
