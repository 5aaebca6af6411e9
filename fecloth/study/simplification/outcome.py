"""What the runs of simpler scenes gave: their changes, the errors of the scene, the verdicts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter

from fecloth.study.result import in_percent
from fecloth.study.simplification.variants import Variant
from fecloth.study.status import OK

LOST, NOISE = 0.05, 0.02  # fraction of the seconds, and seconds: smaller differences are noise
SIZES = {  # words, name and unit of what a check refines, by its kind
    "mesh": ("mesh", "h", " m"),
    "dt": ("time step", "dt", " s"),
    "rtol": ("tolerance of the steps", "rtol", " 1/s"),
}


@dataclass(frozen=True)
class Outcome:
    """The run of a simpler scene beside the run of the scene."""

    name: str  # of the variant
    status: str
    cause: str = ""  # of a failure
    changes: Mapping[str, float] = field(default_factory=dict)  # relative, of each quantity
    seconds: float = math.nan  # CPU time of the run
    saved: float = math.nan  # part of the scene's seconds
    triangles: int | None = None
    steps: int | None = None

    @property
    def is_ok(self) -> bool:
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
        return self.seconds > (1 + LOST) * self.whole + NOISE

    @property
    def of(self) -> str:
        """The quantity that changes most."""
        return max(self.changes, key=lambda name: self.changes[name], default="")

    @property
    def saving_per_change(self) -> float:
        """The saving per change, by which variants are sorted; without saving it is ≤ 0."""
        if self.saved > 0:
            return self.saved / max(self.change, 1e-12)
        return self.saved


Trial = tuple[Variant, Outcome]


@dataclass(frozen=True)
class Resolution:
    """The error of a scene by one of its sizes, from half of h, half of dt or less rtol."""

    kind: str  # "mesh", "dt" or "rtol"
    error: float  # estimated, relative
    quantity: str  # whose error needs the smallest size
    size: float  # h [m], dt [s] or rtol of the scene
    needed: float  # the size at which the error would be within the tolerance
    failure: str = ""  # why the error is unknown, or ""

    @property
    def is_resolved(self) -> bool:
        return self.needed >= self.size

    def __str__(self) -> str:
        """Return the error in words, and which size would do."""
        what, name, unit = SIZES[self.kind]
        if self.failure:
            return f"whether the {what} is resolved is not known: {self.failure}"
        text = f"the error of the {what} is about {in_percent(self.error)} ({self.quantity})"
        if self.is_resolved:
            return text
        needed = f"{name} of about {round_down(self.needed):g}{unit}"
        return f"{text}; {needed} in place of {self.size:g}{unit} would do"


def find_resolutions(
    checks: Sequence[Trial],
    orders: Mapping[str, Mapping[str, float]],  # of each quantity, by text and kind
    tolerance: float,
) -> list[Resolution]:
    """Return the error by each size that was refined.

    A refinement by r that changes a quantity by c shows the error c/(1 − r^−p) for the order p
    (Richardson 1911); the size for the tolerance t is the present size times (t/error)^(1/p).
    """

    def resolution(variant: Variant, outcome: Outcome) -> Resolution:
        kind = variant.kind
        size = variant.size
        if not outcome.is_ok:
            cause = (outcome.cause.splitlines() or [outcome.status])[0]
            return Resolution(kind, math.nan, "", size, 0.0, f"{variant.name}: {cause}")
        found = []
        for text, change in outcome.changes.items():
            order = orders[text][kind]
            error = change / (1 - variant.by**order)
            if error:
                needed = size * (tolerance / error) ** (1 / order)
            else:
                needed = math.inf
            found.append(Resolution(kind, error, text, size, needed))
        return min(found, key=attrgetter("needed"))

    return [resolution(*check) for check in checks]


def round_down(value: float) -> float:
    """Return a number with two digits that is not larger."""
    if not 0 < value < math.inf:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit + 1e-9) * unit:.2g}")


@dataclass(frozen=True)
class Findings:
    """All variants with their outcomes, and the errors of the scene itself."""

    trials: Sequence[Trial]
    tolerance: float
    resolutions: Sequence[Resolution] = ()

    @property
    def unresolved(self) -> set[str]:
        """The kinds of sizes whose error is above the tolerance."""
        return {each.kind for each in self.resolutions if not each.is_resolved}

    @property
    def ranked(self) -> list[Trial]:
        """The variants, the smallest change first."""
        return sorted(self.trials, key=lambda trial: trial[1].change)

    def judge(self, variant: Variant, outcome: Outcome) -> str:
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
        """Return the largest change by a variant and by the smaller changes of the same size.

        A mesh of 2 h that changes less than one of 1.5 h does so by chance, and so does any
        other mesh if the scene itself is not resolved.
        """
        if variant.kind in self.unresolved:
            return math.inf
        same = [pair for pair in self.trials if variant.size and pair[0].kind == variant.kind]
        return max([outcome.change, *(o.change for v, o in same if v.by <= variant.by)])

    def candidates(self) -> list[Variant]:
        """Return the variants within the tolerance, the greatest saving per change first.

        A replacement must save time; a dropped term need not. Larger triangles and steps are
        candidates only if the scene itself is resolved.
        """

        def is_worth(variant: Variant, outcome: Outcome) -> bool:
            saves = outcome.saved > LOST or (variant.kind == "without" and not outcome.is_slower)
            return saves and self.reliable_change(variant, outcome) <= self.tolerance

        able = [(v, o) for v, o in self.trials if o.is_ok and not v.is_check and is_worth(v, o)]
        return [variant for variant, _ in sorted(able, key=lambda t: -t[1].saving_per_change)]
