"""How a problem is changed: other values, an edit of its tables, or a level of refinement."""

import copy
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from fecloth import validation
from fecloth.errors import InputError, did_you_mean
from fecloth.scene.toml_text import override

Edit = Callable[[dict], dict]
REFINED = ("h", "dt", "both")


@dataclass(frozen=True)
class Change:
    """What is different in a changed problem.

    Attributes
    ----------
    name
        The change in words, for messages; "" if they need no words.
    values
        Values by key. The keys of a scene are written as for --set; the keys of a function are
        its arguments.
    edits
        Functions for what values cannot say, as another term in place of one. Each takes a copy
        of the tables and returns them, changed.
    """

    name: str = ""
    values: Mapping[str, object] = field(default_factory=dict)
    edits: tuple[Edit, ...] = ()

    @classmethod
    def of(cls, values: Mapping[str, object]) -> "Change":
        """Return the change of some values, named "key = value, key = value"."""
        return cls(describe_values(values), values)

    def apply(self, tables: dict) -> dict:
        """Return changed tables; `tables` stays as it is."""
        tables = copy.deepcopy(tables)
        for edit in self.edits:
            tables = edit(tables)
        return override(tables, [f"{key}={_toml(value)}" for key, value in self.values.items()])


def _toml(value: object) -> str:
    """Return a value as TOML; a text stands for itself, as after --set."""
    if isinstance(value, str):
        return value
    return _inline(value)


def _inline(value: object) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, Mapping):
        items = ", ".join(f"{key} = {_inline(item)}" for key, item in value.items())
        return f"{{{items}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    return json.dumps(value, ensure_ascii=False)


def describe_values(values: Mapping[str, object]) -> str:
    """Return "key = value, key = value"."""
    return ", ".join(f"{key} = {value}" for key, value in values.items())


@dataclass(frozen=True)
class Level:
    """A level of refinement: by what sizes and tolerances are divided; the first level by 1.

    Attributes
    ----------
    h
        Divides the edge length.
    dt
        Divides a fixed step.
    sharper
        Divides the tolerance of the solver; None leaves the solver as it is.
    rtol
        Divides the tolerance of steps that their error chooses.
    gap
        Divides the gaps of contact.
    """

    h: float = 1.0
    dt: float = 1.0
    sharper: float | None = 1.0
    rtol: float = 1.0
    gap: float = 1.0

    def __str__(self) -> str:
        sizes = {"h": self.h, "dt": self.dt, "rtol": self.rtol, "gap": self.gap}
        parts = [f"{name} / {divisor:.3g}" for name, divisor in sizes.items() if divisor != 1]
        if self.sharper not in (None, 1.0):
            parts.append("a sharper tolerance")
        return " and ".join(parts) or "the first level"

    @property
    def edits(self) -> tuple[Edit, ...]:
        """What the level changes in the terms: their gaps."""
        if self.gap == 1:
            return ()
        return (self._divide_gaps,)

    def _divide_gaps(self, tables: dict) -> dict:
        """Return the tables with smaller gaps of their terms."""
        for term in tables.get("terms", ()):
            if "gap" in term:
                term["gap"] /= self.gap
        return tables


FIRST_LEVEL = Level()
AS_IS = Level(sharper=None)  # with the solver of the problem


def make_levels(
    refine: str, levels: int, ratio: float, space_order: float = 1.0, time_order: float = 1.0
) -> list[Level]:
    """Return the levels, coarse to fine; the first one divides nothing.

    With "both", dt ∝ h^(p/q) for the orders p in space and q in time: then the errors of both
    keep their share. Raises `InputError` for an unknown `refine`, for less than 3 or more than
    10 levels, and for a ratio outside of 1.1 to 10.

    Parameters
    ----------
    refine
        "h", "dt" or "both".
    levels
        Number of levels.
    ratio
        h (with "dt": dt) of a level over h of the next finer one.
    space_order, time_order
        Theoretical orders p and q.
    """
    if refine not in REFINED:
        what = f"refine = {refine!r}"
        remedy = did_you_mean(refine, REFINED)
        raise InputError(what, 'must be "h", "dt" or "both"', "converge", remedy)
    validation.whole("levels", levels, 3, "converge", most=10)
    validation.number("ratio", ratio, 0.0, "converge")
    if not 1.1 <= ratio <= 10:
        raise InputError(f"ratio = {ratio:g}", "must lie between 1.1 and 10", "converge")
    if refine == "h":
        return [Level(h=ratio**k) for k in range(levels)]
    if refine == "dt":
        return [Level(dt=ratio**k) for k in range(levels)]
    ratio_of_steps = ratio ** (space_order / time_order)
    return [Level(h=ratio**k, dt=ratio_of_steps**k) for k in range(levels)]
