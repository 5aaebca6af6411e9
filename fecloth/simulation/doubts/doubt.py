"""What may be wrong with a run: an object, so that no code has to read sentences."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Self

from fecloth import validation
from fecloth.terms.records import remembered

WARNING = "warning"  # an answer of this run may be wrong
CHECK = "check"  # the set-up may have a mistake; it is said before the run, and the run goes on
NOTE = "note"


class DoubtKind(Enum):
    """What a `Doubt` is about, and how it is said.

    The value of a member is its name in summary.json.

    Attributes
    ----------
    label
        "warning", "check" or "note": the first word of its line. A warning is a doubt that
        spoils an answer of this run. What is to be checked is said before the first step, on a
        line of its own. Notes are in the log, and on the terminal with -v only.
    UNITS
        A number was probably meant in another unit.
    TERMS
        Terms are missing, counted twice, or do not fit each other or the fabric.
    NO_EFFECT
        A constant that was given has no effect.
    PINS
        A pin holds or moves less than was probably meant, or nothing is held.
    SPEED
        The run takes longer than it would with a package that can be installed.
    START
        The start does not fit the pins, or leaves the cloth in its plane.
    MESH
        Triangles are far from equilateral.
    EDGES
        An obstacle can cut into triangles between the points on which it acts.
    WEIGHT
        The cloth is drawn out by its own weight.
    STEP
        The size of the steps does not fit the run: a mistake in a unit.
    MISSED
        A motion or a load acts between the steps.
    JUMP
        A pin or an obstacle jumps. At the end of a run: and the motion depends on it.
    DAMPING
        The method has damped the motion; before the first step: it will.
    GAIN
        The method has made energy; before the first step: it can.
    MOTION
        The energy balance is off: the motion is wrong. A study counts such a run as failed.
    TIME
        The error in time is large.
    ROUND_OFF
        Round-off limited Newton's iteration.
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

    UNITS = "units", CHECK
    TERMS = "terms", CHECK
    NO_EFFECT = "no_effect", CHECK
    PINS = "pins", CHECK
    STEP = "step", CHECK
    SPEED = "speed", CHECK
    START = "start", NOTE
    MESH = "mesh", NOTE
    EDGES = "edges", NOTE
    WEIGHT = "weight", NOTE
    ROUND_OFF = "round_off", NOTE
    WRINKLES = "wrinkles", NOTE
    MISSED = "missed", WARNING
    JUMP = "jump", WARNING
    DAMPING = "damping", WARNING
    GAIN = "gain", WARNING
    MOTION = "motion", WARNING
    TIME = "time", WARNING
    CURVE = "curve", WARNING
    INTERSECTION = "intersection", WARNING
    INSTABILITY = "instability", WARNING
    BRANCH = "branch", WARNING
    BALANCE = "balance", WARNING
    OTHER = "other", WARNING

    label: str

    def __new__(cls, value: str, label: str = NOTE) -> Self:
        member = object.__new__(cls)
        member._value_ = value
        member.label = label
        return member

    @property
    def spoils(self) -> bool:
        """Whether it spoils an answer of the run."""
        return self.label == WARNING


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

    @property
    def line(self) -> str:
        """The doubt as a line of a log or a terminal, which begins with its label."""
        return f"{self.kind.label}: {self}"

    def entry(self) -> dict[str, str]:
        """Return the doubt as summary.json has it: kind, words and remedy."""
        return {"kind": self.kind.value, "words": self.words, "remedy": self.remedy}

    @classmethod
    def of_entry(cls, entry: Mapping[str, str]) -> Self:
        """Return the doubt of an `entry`."""
        return cls(DoubtKind(entry["kind"]), entry["words"], entry["remedy"])


def warnings_of(doubts: Iterable[Doubt]) -> tuple[str, ...]:
    """Return the sentence of each doubt that spoils an answer, with its remedy."""
    return tuple(str(doubt) for doubt in doubts if doubt.kind.spoils)
