"""The measured points of an experiment, from a CSV file or a mapping, in SI units."""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError, brief, did_you_mean
from fecloth.quantities import units
from fecloth.quantities.units import Dimension
from fecloth.scene.toml_text import file_problem
from fecloth.simulation.quantity import Quantity
from fecloth.study.fitting.experiment import Experiment

_HEAD = re.compile(r"\s*(?P<name>[^\[\]]+?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*")
COMMAS = "write commas between columns, and decimal points"
PLAIN = {"": 1.0, "-": 1.0, "1": 1.0, "%": 1e-2}  # units of numbers without a dimension
_TABLES = [each for each in vars(units).values() if isinstance(each, Dimension)]
DIMENSIONS = {each.si: each for each in reversed(_TABLES)} | {  # the first of one SI unit counts
    "J": Dimension({"J": 1.0, "mJ": 1e-3, "uJ": 1e-6, "N*m": 1.0}),
    "Hz": Dimension({"Hz": 1.0, "kHz": 1e3, "1/s": 1.0}),
    "m^2": Dimension({"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6}),
}


def factor_to_si(name: str, unit: str | None, si: str) -> float:
    """The value of a unit in SI; `InputError` if it is not a unit of a quantity with this SI unit.

    A column without a unit is refused where its quantity has one.
    """
    if not si:
        if (unit or "") not in PLAIN:
            allowed = "its quantity has no unit; write no unit or [%]"
            raise InputError(f"column {name} [{unit}]", allowed)
        return PLAIN[unit or ""]
    dimension = DIMENSIONS.get(si.replace("²", "^2").replace("³", "^3"), Dimension({si: 1.0}))
    if not unit:
        raise InputError(f"column {name!r}", f"has no unit; write it as {name} [{dimension.si}]")
    try:
        return 1.0 if unit == si else units.quantity(name, f"1 {unit}", dimension)
    except InputError:
        allowed = f"its unit must be one of {', '.join(dimension.units)}"
        raise InputError(f"column {name} [{unit}]", allowed) from None


@dataclass(frozen=True, eq=False)
class DataTable:
    """Columns as they are written, with the numbers of their lines."""

    where: str  # the file, for messages
    cells: Mapping[str, tuple[str | None, Sequence[Any]]]  # name → (unit, cells)
    lines: Sequence[int]  # the line of each row, from 1

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def numbers(self, name: str, si: str | None) -> np.ndarray:
        """The values of a column in SI; None for `si` takes them as they are.

        It raises `InputError` for a column that is not there, an unknown unit, and a cell that is
        no finite number.
        """
        if name not in self.cells:
            allowed = f"is not in the file, which has {', '.join(self.cells)}"
            remedy = did_you_mean(name, self.cells)
            raise InputError(f"column {name!r}", allowed, self.where, remedy)
        unit, cells = self.cells[name]
        try:
            factor = 1.0 if si is None else factor_to_si(name, unit, si)
        except InputError as error:
            raise InputError(error.what, error.allowed, self.where, error.remedy) from None
        values = [
            self._number(name, cell, line) for cell, line in zip(cells, self.lines, strict=True)
        ]
        return factor * np.array(values)

    def _number(self, name: str, cell: Any, line: int) -> float:
        try:
            value = float(cell)
        except (TypeError, ValueError):
            value = np.nan
        if not np.isfinite(value):
            what = f"line {line}, column {name!r}: {cell!r}"
            raise InputError(what, "must be a finite number", self.where)
        return value


def read_table(data: str | Path | Mapping[str, Sequence[float]], label: str) -> DataTable:
    """Read a CSV file, or a mapping of names with units to values."""
    if not isinstance(data, str | Path | Mapping):
        raise InputError(f"data = {brief(data)}", "must be a path, or a mapping of columns", label)
    if isinstance(data, Mapping):
        columns = [(str(name), list(values)) for name, values in data.items()]
        lengths = {len(values) for _, values in columns}
        if len(lengths) != 1:
            raise InputError("data", "needs columns of one length", label)
        return _table(label, columns, range(1, 1 + lengths.pop()))
    if problem := file_problem(Path(data)):
        raise InputError(problem[0], "must be a CSV file", str(data), problem[1])
    content = Path(data).read_text(encoding="utf-8-sig", errors="replace")
    numbered = [
        (number, line)
        for number, line in enumerate(content.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    rows = list(csv.reader(line for _, line in numbered))
    if len(rows) < 2:
        allowed = "it needs a line of names, then lines of numbers"
        raise InputError("too few lines", allowed, str(data))
    if ";" in numbered[0][1]:
        raise InputError("columns between semicolons", COMMAS, str(data))
    for (number, _), row in zip(numbered, rows, strict=True):
        if len(row) != len(rows[0]):
            what = f"line {number} has {len(row)} cells"
            allowed = f"must have {len(rows[0])}, as the first line; {COMMAS}"
            raise InputError(what, allowed, str(data))
    columns = [(name, list(cells)) for name, *cells in zip(*rows, strict=True)]
    return _table(str(data), columns, [number for number, _ in numbered[1:]])


def _table(where: str, columns: Sequence[tuple[str, list]], lines: Sequence[int]) -> DataTable:
    cells: dict[str, tuple[str | None, Sequence[Any]]] = {}
    for head, values in columns:
        match = _HEAD.fullmatch(head)
        name = match["name"] if match else ""
        if not match or name in cells:
            allowed = "must be a name of its own, with its unit: name [unit]"
            raise InputError(f"column {head!r}", allowed, where)
        cells[name] = match["unit"], values
    return DataTable(where, cells, lines)


ASSUMED = 0.02  # of the largest value: the uncertainty where nobody states one
ROUND = 1e-6  # of what the run reaches: points beyond it by less are within
LEAST = 1e-9  # of the largest value: the least uncertainty
Reach = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Measured:
    """The points of one measured column, in SI units."""

    column: str
    quantity: Quantity
    unit: str
    values: np.ndarray  # (n,)
    sigma: np.ndarray  # (n,) standard uncertainties
    along: np.ndarray | None = None  # (n,) changes from the start, or times; None for numbers
    # (R, n) repeats minus their mean; None where the errors of points are independent.
    scatter: np.ndarray | None = None
    is_assumed: bool = False  # whether sigma is the usual 2 %
    along_unit: str = ""

    @property
    def largest(self) -> float:
        return float(np.abs(self.values).max())


def read_measured(
    experiment: Experiment, units_of: Sequence[str], along_unit: str, reach: Reach | None
) -> tuple[Measured, ...]:
    """Read the points of an experiment, and refuse points that the run cannot reach.

    `units_of` are the SI units of the measured quantities, `reach` the range of changes of what
    orders the points, if it is known.
    """
    table = read_table(experiment.data, experiment.label)
    columns = experiment.columns
    named = zip(columns.items(), units_of, strict=True)
    listed = [(c, q, unit, table.numbers(c, unit)) for (c, q), unit in named]
    repeats = _repeats(experiment, table)
    along = None
    if experiment.order:
        along = _along(table, experiment, along_unit, repeats, reach)
    read = [_points(experiment, table, each, along, repeats) for each in listed]
    return tuple(replace(points, along_unit=along_unit) for points in read)


def _repeats(experiment: Experiment, table: DataTable) -> np.ndarray:
    """The number of the repeat of each row; all are one where the column is not there."""
    wanted = "repeats" in {experiment.sigma_of(column) for column in experiment.columns}
    if wanted or "repeat" in table:
        numbers = table.numbers("repeat", None)
        if wanted and len(np.unique(numbers)) < 2:
            allowed = "needs at least 2 repeats in the column repeat"
            raise InputError('sigma = "repeats"', allowed, table.where)
        return numbers
    return np.zeros(len(table.lines))


def _along(
    table: DataTable, experiment: Experiment, unit: str, repeats: np.ndarray, reach: Reach | None
) -> np.ndarray:
    """The changes from the start at each row."""
    assert experiment.order is not None
    column, quantity = experiment.order
    has_unit = table.cells.get(column, ("",))[0]
    # The part of the loads has no unit, and may be written as a time of 1 s.
    values = table.numbers(column, unit if quantity or unit or has_unit is None else "s")
    if reach is None:
        return values
    low, high = reach
    spare = ROUND * max(abs(low), abs(high))
    if quantity and values.size and not ((values >= low - spare) & (values <= high + spare)).any():
        for number in np.unique(repeats):  # a distance, not a change: from its first value
            rows = repeats == number
            values[rows] -= values[rows][0]
    moved = values
    if experiment.offset:  # by at most half of the reach
        half = (high - low) / 2
        moved = values - np.clip(values.min() - low, -half, half) if high > -low else values
    outside = np.flatnonzero((moved < low - spare) | (moved > high + spare))
    if len(outside):
        row = outside[np.argmax(np.abs(moved[outside]))]
        what = f"line {table.lines[row]}: {column} = {values[row]:.6g} {unit}".rstrip()
        allowed = f"is beyond what the run reaches, {low:.6g} to {high:.6g} {unit}".rstrip()
        remedy = "Move the grip farther, leave points out, or look at the sign and the unit."
        raise InputError(what, allowed, table.where, remedy)
    return values


def _points(
    experiment: Experiment,
    table: DataTable,
    listed: tuple[str, Quantity, str, np.ndarray],
    along: np.ndarray | None,
    repeats: np.ndarray,
) -> Measured:
    column, quantity, unit, values = listed
    asked = experiment.sigma_of(column)
    if asked == "repeats":
        return _mean_of_repeats(table, listed, along, repeats)
    sigma = _sigma(table, column, unit, values, asked)
    if not (sigma > 0).all():
        line = table.lines[int(np.argmin(sigma))]
        what = f"line {line}: sigma of {column} = {sigma.min():g} {unit}".rstrip()
        remedy = 'As "2 %" of the largest value, or "0.1 N".'
        raise InputError(what, "must be > 0", table.where, remedy)
    return Measured(column, quantity, unit, values, sigma, along, None, asked is None)


def _sigma(
    table: DataTable, column: str, unit: str, values: np.ndarray, asked: str | float | None
) -> np.ndarray:
    """The standard uncertainties (n,) of the values."""
    same, largest = np.ones(len(values)), np.abs(values).max()
    if asked is None:
        return ASSUMED * largest * same
    if not isinstance(asked, str):
        return float(asked) * same
    if asked in table:
        return table.numbers(asked, unit)
    words = asked.strip()
    try:
        if words.endswith("%"):
            return float(words[:-1]) / 100 * largest * same
        if unit:
            dimension = DIMENSIONS[unit.replace("²", "^2").replace("³", "^3")]
            return units.quantity("sigma", words, dimension) * same
        return float(words) * same
    except (ValueError, KeyError) as error:
        allowed = 'must be as "2 %", "0.1 N", the name of a column, or "repeats"'
        raise InputError(f"sigma = {brief(asked)}", allowed, table.where) from error


def _mean_of_repeats(
    table: DataTable,
    listed: tuple[str, Quantity, str, np.ndarray],
    along: np.ndarray | None,
    repeats: np.ndarray,
) -> Measured:
    """The mean of the repeats, on equal steps along the part of the curve that all have.

    Its uncertainty is the scatter of the repeats, one number for the curve, over √R.
    """
    column, quantity, unit, values = listed
    groups = [np.flatnonzero(repeats == number) for number in np.unique(repeats)]
    if along is None:
        curves, places = np.array([[values[rows].mean()] for rows in groups]), None
    else:
        first = max(along[rows].min() for rows in groups)
        end = min(along[rows].max() for rows in groups)
        if not first < end:
            allowed = "the repeats have no part of the curve in common"
            raise InputError(f"column {column!r}", allowed, table.where)
        places = np.linspace(first, end, int(np.median([len(rows) for rows in groups])))
        ordered = [rows[np.argsort(along[rows], kind="stable")] for rows in groups]
        curves = np.array([np.interp(places, along[rows], values[rows]) for rows in ordered])
    mean = curves.mean(axis=0)
    scatter = curves - mean
    variance = (scatter**2).sum() / (scatter.size - mean.size)  # R − 1 of R are free
    least = LEAST * np.abs(mean).max()
    sigma = np.full(len(mean), max(np.sqrt(variance / len(groups)), least))
    return Measured(column, quantity, unit, mean, sigma, places, scatter)
