"""What the run of a simpler scene gave, and the verdict on it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from fecloth.study.simplification.variants import Variant
from fecloth.study.status import OK

LOST, NOISE = 0.05, 0.02  # fraction of the seconds, and seconds: smaller differences are noise


@dataclass(frozen=True)
class Outcome:
    """The run of a simpler scene beside that of the scene.

    Attributes
    ----------
    name, status, cause
        Of the variant, of its run, and of the failure.
    changes
        Relative change of each quantity, by its text.
    seconds, saved
        CPU seconds of the run, and the part of the scene's seconds that it saves.
    triangles, steps
        Numbers of both.
    predicted
        The change that its dimensionless numbers predict; None if they do not.
    """

    name: str
    status: str
    cause: str = ""
    changes: Mapping[str, float] = field(default_factory=dict)
    seconds: float = math.nan
    saved: float = math.nan
    triangles: int | None = None
    steps: int | None = None
    predicted: float | None = None

    @property
    def is_ok(self) -> bool:
        """Whether it ran to its end and has all quantities."""
        return self.status == OK

    @property
    def change(self) -> float:
        """The largest change; infinite for a failure."""
        return max(self.changes.values()) if self.is_ok else math.inf

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


Trial = tuple[Variant, Outcome]


def judge(
    variant: Variant, found: Sequence[Trial], tolerance: float, unresolved: Collection[str]
) -> str:
    """Return the verdict on a variant; `unresolved` are the kinds of sizes with a large error."""
    (outcome,) = [one for other, one in found if other is variant]
    if variant.is_check:
        return "not resolved" if variant.kind in unresolved else "resolved"
    if not outcome.is_ok or outcome.change > tolerance:
        return "needed"
    if reliable_change(variant, found, unresolved) > tolerance:
        return "by chance"
    return "not needed, saves nothing" if outcome.is_slower else "not needed"


def reliable_change(variant: Variant, found: Sequence[Trial], unresolved: Collection[str]) -> float:
    """Return the largest change by a variant and by the smaller changes of the same size.

    A mesh of 2 h that changes less than one of 1.5 h does so by chance, and so does any other
    mesh if the scene itself is not resolved.
    """
    if variant.kind in unresolved:
        return math.inf
    same = [
        outcome.change
        for other, outcome in found
        if other is variant
        or (other.is_size and other.kind == variant.kind and other.by <= variant.by)
    ]
    return max(same)
