"""The tables [[probes]], [expect], [interest] and [measured]; the values expected of a run."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from fecloth.errors import InputError, SceneError, brief, did_you_mean, errors_of, is_number
from fecloth.fabric.uncertainty import part_of
from fecloth.quantities import units
from fecloth.quantities.columns import dimension_of
from fecloth.quantities.units import LENGTH, TIME, is_quantity
from fecloth.scene.field_types import Name
from fecloth.scene.table_model import Table, require_exactly_one
from fecloth.scene.toml_text import flatten_tables
from fecloth.simulation.probes import TAKEN, Probe
from fecloth.simulation.quantity import FIELDS, Quantity, parse_quantity

_TAKEN = (*TAKEN, *FIELDS, "reaction", "energy")  # names in the grammar of quantities


class ProbeTable(Table):
    """A named path: the mean of a node set, or a material point (X, Y) [m]."""

    name: Name
    """Name of the columns."""
    where: str | None = None
    """A node set, whose mean position is recorded."""
    point: Annotated[tuple[float, float] | None, LENGTH] = None
    """In place of `where`: a material point (X, Y) [m]."""

    @model_validator(mode="after")
    def _one_place(self):
        require_exactly_one(self, "where", "point")
        if self.name in _TAKEN:
            raise InputError(f"name = {self.name!r}", "is the name of a column of every run")
        return self

    def probe(self) -> Probe:
        """Return the probe that records the path."""
        return Probe(self.name, self.where, self.point)


class Expectation(Table):
    """A value within a relative or absolute tolerance, at the end or at a time [s]."""

    value: float
    """The expected value, in SI."""
    relative: float | None = Field(None, gt=0)
    """Tolerance relative to the value."""
    absolute: float | None = Field(None, gt=0)
    """In place of `relative`: tolerance in the unit of the value."""
    at: Annotated[float | None, TIME] = Field(None, ge=0)
    """Time [s]; left out: the end."""

    @model_validator(mode="before")
    @classmethod
    def _refuse_unquoted_dots(cls, data: Any) -> Any:
        for key, value in data.items() if isinstance(data, dict) else ():
            if isinstance(value, dict):
                remedy = f'A name with a dot needs quotes, as in "mean_displacement.{key}".'
                raise InputError(f"{key} = {value}", "unknown key", remedy=remedy)
        return data

    @model_validator(mode="after")
    def _one_tolerance(self):
        require_exactly_one(self, "relative", "absolute")
        if self.relative and self.value == 0:
            allowed = "must not be used with value = 0"
            raise InputError("relative is given", allowed, remedy="Use absolute.")
        return self

    @property
    def tolerance(self) -> float:
        """Allowed difference, in the unit of the value."""
        return self.absolute or (self.relative or 0.0) * abs(self.value)


class Interest(Table):
    """The quantities for which a scene is run, and by which studies compare runs.

    With values at the end alone the motion before it does not matter.
    """

    quantities: tuple[str, ...] = ()
    """Quantities in their grammar, see above, as in ["max tip.z"]."""
    end: tuple[str, ...] = ()
    """Short for values at the end: "tip.z"; also displacement, the field."""
    path: tuple[str, ...] = ()
    """Short for "path of NAME": columns whose course over the run matters."""
    period: tuple[str, ...] = ()
    """Short for "period of NAME": columns whose period of swing matters."""

    @model_validator(mode="after")
    def _refuse_empty(self):
        if not (self.quantities or self.end or self.path or self.period):
            allowed = "must name a quantity under quantities, end, path or period"
            raise InputError("interest is empty", allowed)
        _ = self.parsed  # refuses texts outside the grammar
        return self

    @property
    def parsed(self) -> dict[str, tuple[Quantity, ...]]:
        """The quantities by the key that names them."""
        texts = {
            "quantities": self.quantities,
            "end": self.end,
            "path": [f"path of {name}" for name in self.path],
            "period": [f"period of {name}" for name in self.period],
        }
        return {key: tuple(map(parse_quantity, names)) for key, names in texts.items()}

    @property
    def at_end_only(self) -> bool:
        """Whether the motion before the end does not matter."""
        return all(quantity.how == "value" and quantity.at is None for quantity in self.all)

    @property
    def all(self) -> tuple[Quantity, ...]:
        """The quantities under all keys."""
        return tuple(quantity for group in self.parsed.values() for quantity in group)


def names_of_measured(table: Mapping[str, Any]) -> list[str]:
    """Return the names of the quantities of [measured], with single spaces."""
    return [" ".join(name.split()) for name, _ in flatten_tables(table)]


def read_measured(
    table: Mapping[str, Any], energies: Iterable[str]
) -> dict[str, tuple[float, float]]:
    """Return the measured values and their standard uncertainties, both in SI, by quantity.

    Each entry of the table is a pair: the value, and its uncertainty, which may also be "2 %" of
    the value. Both are numbers in SI, or texts with a unit such as "36 mm". Raise `InputError`
    for anything else, and for an uncertainty of 0. `energies` are names of columns in J.
    """
    measured = {}
    for name, entry in flatten_tables(table):
        pair = entry
        if isinstance(entry, list | tuple):
            unit = parse_quantity(name).unit(energies)
            pair = [_in_si(name, value, unit) for value in entry]
        is_pair = isinstance(pair, list | tuple) and len(pair) == 2 and is_number(pair[0])
        u = part_of(pair[0], pair[1], f"measured {name}") if is_pair else 0.0
        if not (is_number(u) and u > 0):
            allowed = (
                'must be a value and its standard uncertainty > 0, as [0.036, 0.0005 or "2 %"]'
            )
            raise InputError(f"measured {name} = {brief(entry)}", allowed)
        measured[" ".join(name.split())] = (float(pair[0]), float(u))
    return measured


def _in_si(name: str, value: Any, unit: str) -> Any:
    """Return a text with a unit as a number in SI, if `unit` is the SI unit; others as they are."""
    if not (isinstance(value, str) and is_quantity(value)):
        return value
    return units.quantity(f"measured {name}", value, dimension_of(unit))


def _as_tuple(value: Any) -> Any:
    if isinstance(value, dict):
        return (value,)
    if not (isinstance(value, tuple) and value):
        raise InputError("", "must be a table { value = ... }, or a list of such tables")
    return value


Expectations = Annotated[tuple[Expectation, ...], BeforeValidator(_as_tuple)]
Expected = Mapping[str, tuple[Expectation, ...]]


def refuse_times(
    expect: Expected,
    start: float,
    end: float,
    source: str,
    unit: str = " s",
) -> None:
    """Raise `SceneError` for a value that is expected at a t outside the run, [start, end].

    `source` is the file of the scene, for the message. `unit` follows a value of t in words:
    " s", or " of the loads" of a static scene.
    """
    for name, expectations in expect.items():
        for expectation in expectations:
            at = expectation.at
            if at is None or start <= at <= end:  # None: the end of the run
                continue
            if at < start:
                allowed = f"must be at least time.t_start = {start} [s]"
            elif unit == " s":
                allowed = f"must be at most time.t_end = {end} [s]"
            else:
                allowed = f"must be at most {end:g}{unit}"
            raise SceneError(f"expect.{name}.at = {at}", allowed, source)


def refuse_unknown(
    expect: Expected,
    interest: Interest | None,
    measured: Iterable[str],
    names: list[str],
    source: str,
) -> None:
    """Raise `SceneError` for a quantity of one of these tables without a column.

    `names` are the columns of the run, and `source` is the file of the scene.
    """
    for name in expect:
        if name not in names:
            allowed = f"unknown quantity; this run has {', '.join(names)}"
            raise SceneError(f"expect.{name}", allowed, source, did_you_mean(name, names))
    asked = {"measured": tuple(map(parse_quantity, measured))}
    if interest:
        asked |= {f"interest.{key}": group for key, group in interest.parsed.items()}
    for key, quantities in asked.items():
        for quantity in quantities:
            with errors_of(source, kind=SceneError):
                quantity.require_known(names, key)


@dataclass(frozen=True)
class Verdict:
    """A line of ``fecloth check``: the value of a column and the expected one.

    Attributes
    ----------
    name
        The column.
    at
        The time [s], or the part of the loads; the end of the run if the scene gives none.
    value
        The value of the run, in the unit of the column.
    expected
        The expected value.
    tolerance
        The allowed difference.
    passed
        Whether ``|value − expected| <= tolerance``.
    unit
        What follows `at` in words: " s", or " of the loads" of a static scene.
    """

    name: str
    at: float
    value: float
    expected: float
    tolerance: float
    passed: bool
    unit: str = " s"

    def __str__(self) -> str:
        return (
            f"{'ok' if self.passed else 'FAILED':<6} {self.name} at {self.at:g}{self.unit}: "
            f"{self.value:.8g}, expected {self.expected:.8g} ± {self.tolerance:.2g}"
        )


def check(
    expect: Expected,
    times: np.ndarray,
    observed: Mapping[str, np.ndarray],
    energies: Mapping[str, np.ndarray],
    unit: str = " s",
) -> list[Verdict]:
    """Return a verdict on each expected value: whether the run has it, within its tolerance.

    Parameters
    ----------
    expect
        The expected values by column.
    times
        The t of each row of the run.
    observed, energies
        The columns of the run, as in `Result`.
    unit
        What follows a value of t in words: " s", or " of the loads" of a static scene.

    Returns
    -------
    list of Verdict
        Values between rows are interpolated linearly. A time outside the run and a value that is
        not a number fail: their `passed` is False.
    """
    columns = {**energies, **observed}
    verdicts = []
    for name, expectations in expect.items():
        for expectation in expectations:
            at = float(times[-1]) if expectation.at is None else expectation.at
            value = float(np.interp(at, times, columns[name], left=np.nan, right=np.nan))
            expected = expectation.value
            tolerance = expectation.tolerance
            passed = abs(value - expected) <= tolerance  # False for NaN
            verdicts.append(Verdict(name, at, value, expected, tolerance, passed, unit))
    return verdicts
