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
    """What is different in a changed problem."""

    name: str = ""  # in words, for messages; "" if these need no words
    # Values by key: the keys of a scene are written as for --set; a function's are its
    # arguments.
    values: Mapping[str, object] = field(default_factory=dict)
    # What values cannot say, as another term in place of one: returns the tables that it gets,
    # which are a copy, changed.
    edits: tuple[Edit, ...] = ()

    @classmethod
    def of(cls, values: Mapping[str, object]) -> "Change":
        """Return the change of some values, named "key = value, key = value"."""
        return cls(describe_values(values), values)

    def apply(self, tables: dict) -> dict:
        """Return changed tables; the ones given stay as they are."""
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
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key} = {_inline(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    return json.dumps(value, ensure_ascii=False)


def describe_values(values: Mapping[str, object]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in values.items())


@dataclass(frozen=True)
class Level:
    """One level: h, dt, two tolerances and gaps of contact are divided by these; at first by 1."""

    h: float = 1.0
    dt: float = 1.0
    sharper: float | None = 1.0  # of a fixed tolerance of the solver; None leaves it as it is
    rtol: float = 1.0  # of the tolerance of chosen steps
    gap: float = 1.0

    def __str__(self) -> str:
        sizes = {"h": self.h, "dt": self.dt, "rtol": self.rtol, "gap": self.gap}.items()
        parts = [f"{name} / {by:.3g}" for name, by in sizes if by != 1]
        parts += ["a sharper tolerance"] if self.sharper not in (None, 1.0) else []
        return " and ".join(parts) or "the first level"

    @property
    def edits(self) -> tuple[Edit, ...]:
        """What the level changes in the terms: their gaps."""
        return () if self.gap == 1 else (self._divide_gaps,)

    def _divide_gaps(self, tables: dict) -> dict:
        for term in tables.get("terms", ()):
            if "gap" in term:
                term["gap"] /= self.gap
        return tables


FIRST = Level()
AS_IS = Level(sharper=None)  # with the solver of the problem


def make_levels(
    refine: str, levels: int, ratio: float, space_order: float = 1.0, time_order: float = 1.0
) -> list[Level]:
    """Return the levels, coarse to fine.

    With "both", dt ∝ h^(p/q) for the orders p in space and q in time: then the errors of both
    keep their share.
    """
    if refine not in REFINED:
        remedy = did_you_mean(refine, REFINED)
        raise InputError(f"refine = {refine!r}", 'must be "h", "dt" or "both"', "converge", remedy)
    validation.whole("levels", levels, 3, "converge", most=10)
    validation.number("ratio", ratio, 0.0, "converge")
    if not 1.1 <= ratio <= 10:
        raise InputError(f"ratio = {ratio:g}", "must lie between 1.1 and 10", "converge")
    in_h = ratio if refine != "dt" else 1.0
    in_dt = ratio if refine == "dt" else 1.0
    if refine == "both":
        in_dt = ratio ** (space_order / time_order)
    return [Level(in_h**k, in_dt**k) for k in range(levels)]
