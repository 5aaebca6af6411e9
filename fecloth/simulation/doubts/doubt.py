"""What may be wrong with a run: an object, so that no code has to read sentences."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Self

from fecloth.terms.records import remembered


class DoubtKind(Enum):
    """What a `Doubt` is about, and whether it spoils a run as evidence.

    The value of a member is its name in summary.json. A study counts a run with a doubt whose
    kind `spoils` as failed.

    Attributes
    ----------
    spoils
        Whether the motion of such a run is wrong, so that no number of it is evidence.
    """

    # before the first step
    UNITS = "units"  # a number was probably meant in another unit
    TERMS = "terms"  # terms are missing, counted twice, or do not fit each other or the fabric
    NO_EFFECT = "no_effect"  # a constant that was given has no effect
    PINS = "pins"  # a pin holds or moves less than was probably meant, or nothing is held
    START = "start"  # the start does not fit the pins, or leaves the cloth in its plane
    MESH = "mesh"  # triangles are far from equilateral
    EDGES = "edges"  # an obstacle can cut into triangles between the points on which it acts
    WEIGHT = "weight"  # the cloth is drawn out by its own weight
    STEP = "step"  # the size of the steps does not fit the run
    MISSED = "missed"  # a motion or a load acts between the steps
    JUMP = "jump"  # a pin or an obstacle jumps
    DAMPING = "damping"  # the method will damp the motion, or has damped it
    GAIN = "gain"  # the method can make energy, or has made it
    # at the end of a run
    MOTION = "motion", True  # the energy balance is off: the motion is wrong
    TIME = "time"  # the error in time is large
    ROUND_OFF = "round_off"  # round-off limited Newton's iteration
    BOUNCE = "bounce"  # the steps do not resolve a bounce
    CURVE = "curve"  # strains are beyond the last point of a measured curve
    INTERSECTION = "intersection"  # the cloth passes through itself
    WRINKLES = "wrinkles"  # the cloth is folded as finely as its mesh
    INSTABILITY = "instability"  # the equilibrium is unstable, or has a motion without stiffness
    BALANCE = "balance"  # the forces of the state do not balance
    OTHER = "other"  # of an account of your own

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
        What it is about: a member of `DoubtKind`. A run reports each kind once.
    words
        What was noticed, with its numbers; a sentence without the full stop.
    remedy
        What to do, or "".

    Examples
    --------
    >>> doubt = Doubt(DoubtKind.STEP, "dt = 2 s is longer than the run", "make dt shorter")
    >>> print(doubt)
    dt = 2 s is longer than the run; make dt shorter
    >>> doubt.kind.spoils
    False
    """

    kind: DoubtKind
    words: str
    remedy: str = ""

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
