"""The measured points of an experiment, from a CSV file or a mapping, in SI units."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import InputError, brief
from fecloth.quantities import units
from fecloth.quantities.columns import DIMENSIONS, DataTable, read_table
from fecloth.simulation.quantity import Quantity
from fecloth.study.fitting.experiment import Experiment

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
        if high > -low:
            moved = values - np.clip(values.min() - low, -half, half)
        else:
            moved = values
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
    same = np.ones(len(values))
    largest = np.abs(values).max()
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
        curves = np.array([[values[rows].mean()] for rows in groups])
        places = None
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
