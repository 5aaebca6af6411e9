"""Quantities of interest: one grammar for scenes, the command line and Python."""

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

from fecloth.errors import InputError, did_you_mean
from fecloth.quantities import units
from fecloth.quantities.columns import dimension_of
from fecloth.quantities.units import is_quantity

FIELDS = ("displacement", "velocity")
SHAPES = ("sag", "area", "volume", "largest_stretch", "least_stretch")
NORMS = {"L2": "l2", "H1": "h1"}
HOW = {  # words before the name: what is taken of its values over the run
    "max": "max",
    "min": "min",
    "path of": "path",
    "period of": "period",
    "frequency of": "frequency",
}
UNITS = {"sag": "m", "area": "m²", "volume": "m³", "largest_stretch": "", "least_stretch": ""}
UNITS |= {"displacement": "m²", "velocity": "m²/s", "reaction": "N", "energy": "J"}
UNITS |= {"drape_coefficient": "", "folds": "", "line_force": "N/m", "stress": "N/m"}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
EXAMPLES = (
    "tip.z, tip.z at 0.3 s, reaction.grip.x at grip.x = 10 mm, max sag, path of tip, "
    "period of tip.z, energy.StVK, reaction.left.z, displacement in H1, frequency(2), "
    "distance of a and b, drape_coefficient, folds, line_force.left.x, stress.xx at (0.1, 0.2)"
)
NAME_A_POINT = "To follow a point, name it in [[probes]] of the scene, or in probes= of the call."
_MODE = re.compile(r"frequency\s*\(\s*(\d+)\s*\)")
STRESS = re.compile(
    r"stress\.(?P<part>xx|yy|xy)(?: of (?P<region>.+?))? at \((?P<X>[^,()]+), ?(?P<Y>[^,()]+)\)"
)
_NUMBER = r"[-+.\deE]+\s*(?!to\b|after\b)[^\s\d]*"  # with its unit
_PLACE = r"(?P<place>[^\s=]+)\s*=\s*"
_TEXT = re.compile(
    rf"(?:(?P<how>{'|'.join(HOW)})\s+)?(?P<name>{STRESS.pattern}|.+?)(?:\s+in\s+(?P<norm>\w+))?"
    r"(?:\s+at\s+(?:(?P<end>the end)|(?P<at>[-+.\deE]+)\s*(?P<unit>\w*)|"
    rf"{_PLACE}(?P<reached>{_NUMBER})))?"
    rf"(?:\s+gained from\s+{_PLACE.replace('place', 'gained')}"
    rf"(?P<begin>{_NUMBER})\s+to\s+(?P<to>{_NUMBER}))?"
    rf"(?:\s+after\s+(?P<slack>{_NUMBER}))?"
)


@dataclass(frozen=True)
class Quantity:
    """A quantity of interest, as `parse_quantity` reads it from a text.

    The grammar of the text is one of::

        [max | min | path of | period of | frequency of] NAME [in L2 | in H1] [at TIME]
        NAME at COLUMN = CHANGE [after SLACK]
        NAME gained from COLUMN = CHANGE to CHANGE [after SLACK]
        frequency(k)

    Attributes
    ----------
    text
        The text; it names the quantity in tables.
    name
        A column ("tip.z", "sag", "energy.StVK", "stress.xx at (0.1, 0.2)"), a vector ("tip",
        "reaction.left"), a field ("displacement"), or "" for the frequency of a mode and for a
        function.
    how
        "value" (at a time), "max", "min", "path", "period", "frequency", "mode" or "function".
    at
        Time of the value [s], or the change of `place` from its start; None for the end.
    norm
        "l2" or "h1" of a field, else "".
    mode
        Number k of the mode, from 1.
    function
        The user's function of the result of a run, which returns a number.
    place
        The column whose change tells when the value is taken, as "grip.x"; "" for a time.
    begin
        The change of `place` from which on a value is gained, up to `at`; None for a value.
    slack
        The change of `place` up to which a measured specimen was slack; the run has none.
    """

    text: str
    name: str = ""
    how: str = "value"
    at: float | None = None
    norm: str = ""
    mode: int = 0
    function: Callable[..., float] | None = None
    place: str = ""
    begin: float | None = None
    slack: float = 0.0

    def __str__(self) -> str:
        return self.text

    @property
    def is_field(self) -> bool:
        """Whether it is a field over the cloth, not a column of a table."""
        return self.name in FIELDS

    @cached_property
    def column(self) -> str:
        """Name of the column in energies.csv or observed.csv, or of its vector."""
        return _column_of(self.name)

    def unit(self, names: Iterable[str] = ()) -> str:
        """Return the SI unit; `names` are names of energies, which need no prefix."""
        if self.how in ("mode", "frequency"):
            return "Hz"
        if self.how == "period":
            return "s"
        if self.how == "function":
            return ""
        if self.norm == "h1":
            if self.name == "displacement":
                return "m"
            return "m/s"
        kind = self.name.replace(":", ".").split(".")[0]
        if self.name in names or kind in ("dissipated", "work"):
            return "J"
        return UNITS.get(kind, "m")

    def require_known(self, names: Iterable[str], where: str = "quantity") -> None:
        """Raise `InputError` if the run has no such column, among the `names` of its columns."""
        if self.how in ("mode", "function"):
            return
        columns = {*names, *SHAPES}
        vectors = {name[:-2] for name in columns if name.endswith(".x")}
        if self.how in ("period", "frequency", "max", "min"):
            known = columns
        else:
            known = columns | vectors
        if self.place and self.place not in columns:
            allowed = f"must be a column of this run: {', '.join(sorted(columns))}"
            raise InputError(
                f"{where}: {self.text}", allowed, "", did_you_mean(self.place, columns)
            )
        if self.is_field or self.column in known:
            return
        shown = sorted(known | set(FIELDS)) if self.how == "value" else sorted(known)
        if self.column in vectors:
            remedy = f"Take a component, as {self.name}.z."
        else:
            remedy = did_you_mean(self.column, shown) or NAME_A_POINT
        allowed = f"unknown quantity; this run has {', '.join(shown)}"
        raise InputError(f"{where}: {self.name}", allowed, "", remedy)


def _column_of(name: str) -> str:
    """Return the name of the column in energies.csv or observed.csv, or of its vector."""
    kind, _, rest = name.partition(".")
    if kind in ("reaction", "least_distance", "line_force") and rest:
        return f"{kind}:{rest}"
    if kind == "energy" and rest:
        return rest
    return name


def parse_quantity(text: str | Quantity | Callable[..., float]) -> Quantity:
    """Return the quantity of a text, or of a function of the result of a run.

    Raises `InputError` for a text that is not in the grammar of `Quantity`.
    """
    if isinstance(text, Quantity):
        return text
    if callable(text):
        name = getattr(text, "__name__", "<lambda>")
        if name == "<lambda>":
            name = "a function"
        return Quantity(name, how="function", function=text)
    if not (isinstance(text, str) and text.strip()):
        raise InputError(f"quantity = {text!r}", "must be a text such as " + EXAMPLES)
    words = " ".join(text.split())
    if mode := _MODE.fullmatch(words):
        if not int(mode[1]):
            raise InputError(f"quantity {text!r}", "the first mode is frequency(1)")
        return Quantity(words, how="mode", mode=int(mode[1]))
    match = _TEXT.fullmatch(words)
    if match is None or (
        not match["part"] and {"at", "in", "gained", "after"} & set(match["name"].split())
    ):
        raise _refusal(text, "is not in the grammar of quantities")
    how = "value"
    if match["how"]:
        how = HOW[match["how"]]
    at = None
    if match["at"] is not None:
        at = _seconds(text, match["at"], match["unit"])
    place = _column_of(match["place"] or match["gained"] or "")
    if match["slack"] and not place:
        raise _refusal(text, "'after' needs a place, as at grip.x = 10 mm")
    if place:
        at = _change(text, place, match["reached"] or match["to"])
    norm = _norm(text, match["name"], match["norm"])
    begin = _change(text, place, match["begin"]) if match["begin"] else None
    slack = _change(text, place, match["slack"]) if match["slack"] else 0.0
    quantity = Quantity(words, match["name"], how, at, norm, place=place, begin=begin, slack=slack)
    if quantity.how != "value" and (at is not None or match["end"]):
        raise _refusal(text, f"'{match['how']}' is over the whole run: it takes no time")
    if quantity.is_field and (quantity.how != "value" or at is not None):
        raise _refusal(text, "a field is taken at the end only")
    return quantity


def _change(text: str, place: str, change: str) -> float:
    """Return a change of the column `place`, in SI; a bare number is in SI."""
    if is_quantity(change):
        dimension = dimension_of(Quantity(place, place).unit())
        return units.quantity(f"quantity {text!r}", change, dimension)
    return _seconds(text, change, "", least=-math.inf)


def _seconds(text: str, number: str, unit: str, least: float = 0.0) -> float:
    """Return a time [s] from its number and its unit; without a unit it is in seconds.

    Raises `InputError` for another unit, and for a number below the `least` one.
    """
    try:
        value = float(number) * SECONDS[unit or "s"]
    except (ValueError, KeyError):
        remedy = did_you_mean(unit, SECONDS) if unit else ""
        allowed = f"a time such as 0.3 s or 30 ms; units: {', '.join(SECONDS)}"
        raise InputError(f"quantity {text!r}", f"needs {allowed}", "", remedy) from None
    if not (math.isfinite(value) and value >= least):
        raise InputError(f"quantity {text!r}", "needs a time >= 0 s")
    return value


def _norm(text: str, name: str, norm: str | None) -> str:
    """Return the norm of a field, by default L2, and "" of anything else."""
    if name not in FIELDS:
        if norm:
            raise _refusal(text, f"'in {norm}' is for the fields {', '.join(FIELDS)}")
        return ""
    if norm and norm.upper() not in NORMS:
        raise InputError(f"quantity {text!r}", "the norm must be L2 or H1")
    return NORMS[(norm or "L2").upper()]


def _refusal(text: str, why: str) -> InputError:
    return InputError(f"quantity {text!r}", why, "", f"Examples: {EXAMPLES}.")
