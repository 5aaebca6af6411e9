"""What may be wrong with a run: an object, so that no code has to read sentences."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Self

from fecloth import validation
from fecloth.terms.records import remembered


class DoubtKind(Enum):
    """What a `Doubt` is about, and whether it spoils a run as evidence.

    The value of a member is its name in summary.json. A study counts a run with a doubt whose
    kind `spoils` as failed. The kinds from UNITS to GAIN can be noticed before the first step;
    all others, and DAMPING and GAIN too, in a run, at its end, or in an equilibrium.

    Attributes
    ----------
    spoils
        Whether the motion of such a run is wrong, so that no number of it is evidence.
    UNITS
        A number was probably meant in another unit.
    TERMS
        Terms are missing, counted twice, or do not fit each other or the fabric.
    NO_EFFECT
        A constant that was given has no effect.
    PINS
        A pin holds or moves less than was probably meant, or nothing is held.
    START
        The start does not fit the pins, or leaves the cloth in its plane.
    MESH
        Triangles are far from equilateral.
    EDGES
        An obstacle can cut into triangles between the points on which it acts.
    WEIGHT
        The cloth is drawn out by its own weight.
    STEP
        The size of the steps does not fit the run.
    MISSED
        A motion or a load acts between the steps.
    JUMP
        A pin or an obstacle jumps.
    DAMPING
        The method will damp the motion, or has damped it.
    GAIN
        The method can make energy, or has made it.
    MOTION
        The energy balance is off: the motion is wrong. It spoils the run.
    TIME
        The error in time is large.
    ROUND_OFF
        Round-off limited Newton's iteration.
    BOUNCE
        The steps do not resolve a bounce.
    CURVE
        Strains are beyond the last point of a measured curve.
    INTERSECTION
        The cloth passes through itself.
    WRINKLES
        The cloth is folded as finely as its mesh.
    INSTABILITY
        The equilibrium is unstable, or has a motion without stiffness.
    BRANCH
        An equilibrium jumped to another branch while its loads grew.
    BALANCE
        The forces of the state do not balance.
    OTHER
        Of an account of your own.
    """

    UNITS = "units"
    TERMS = "terms"
    NO_EFFECT = "no_effect"
    PINS = "pins"
    START = "start"
    MESH = "mesh"
    EDGES = "edges"
    WEIGHT = "weight"
    STEP = "step"
    MISSED = "missed"
    JUMP = "jump"
    DAMPING = "damping"
    GAIN = "gain"
    MOTION = "motion", True
    TIME = "time"
    ROUND_OFF = "round_off"
    BOUNCE = "bounce"
    CURVE = "curve"
    INTERSECTION = "intersection"
    WRINKLES = "wrinkles"
    INSTABILITY = "instability"
    BRANCH = "branch"
    BALANCE = "balance"
    OTHER = "other"

    spoils: bool

    def __new__(cls, value: str, spoils: bool = False) -> Self:
        member = object.__new__(cls)
        member._value_ = value
        member.spoils = spoils
        return member


@remembered
@dataclass(frozen=True)
class Doubt:
    """A reason to doubt a run, an equilibrium or the set-up of a study.

    Attributes
    ----------
    kind
        What it is about: a member of `DoubtKind`. After the first step a run reports each kind
        once.
    words
        What was noticed, with its numbers; a sentence without the full stop.
    remedy
        What to do, or "".

    Examples
    --------
    >>> doubt = Doubt(DoubtKind.MESH, "slivers limit explicit steps", "improve the mesh")
    >>> print(doubt)
    slivers limit explicit steps; improve the mesh
    >>> doubt.kind.spoils
    False
    """

    kind: DoubtKind
    words: str
    remedy: str = ""

    def __post_init__(self):
        validation.instance("kind", self.kind, DoubtKind, "DoubtKind.OTHER", "Doubt")

    def __str__(self) -> str:
        if not self.remedy:
            return self.words
        joint = ". " if self.remedy[0].isupper() else "; "
        return f"{self.words}{joint}{self.remedy}"

    def entry(self) -> dict[str, str]:
        """Return the doubt as summary.json has it: kind, words and remedy."""
        return {"kind": self.kind.value, "words": self.words, "remedy": self.remedy}

    @classmethod
    def of_entry(cls, entry: Mapping[str, str]) -> Self:
        """Return the doubt of an `entry`."""
        return cls(DoubtKind(entry["kind"]), entry["words"], entry["remedy"])


def in_words(doubts: Iterable[Doubt]) -> tuple[str, ...]:
    """Return the sentence of each doubt, with its remedy."""
    return tuple(map(str, doubts))
