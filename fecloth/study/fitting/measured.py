"""The measured points of an experiment, from a CSV file or a mapping, in SI units."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import InputError, brief
from fecloth.fabric.uncertainty import part_of
from fecloth.quantities import units
from fecloth.quantities.columns import DIMENSIONS, DataTable, read_table
from fecloth.simulation.quantity import Quantity
from fecloth.study.fitting.experiment import Experiment

# Standard uncertainty over the largest value where nobody states one; the result says so.
ASSUMED_SIGMA = 0.02
# Points that lie beyond the reach of the run by less than this part of it are within: the reach
# and the points are rounded.
ROUND_OFF_OF_REACH = 1e-6
Reach = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Measured:
    """The points of one measured column, in SI units.

    Attributes
    ----------
    column
        Name of the column.
    quantity
        The quantity of the run that it measures.
    unit
        The SI unit of the values.
    values
        (n,) values.
    sigma
        (n,) standard uncertainties.
    along
        (n,) changes from the start, or times; None for numbers without a curve.
    scatter
        (R, n) repeats minus their mean; None where the errors of points are independent.
    repeats
        (n,) number of the specimen, or of the pull, of each point.
    is_assumed
        Whether nobody states sigma, so that it is 2 %.
    along_unit
        The SI unit of `along`.
    """

    column: str
    quantity: Quantity
    unit: str
    values: np.ndarray
    sigma: np.ndarray
    along: np.ndarray | None = None
    scatter: np.ndarray | None = None
    repeats: np.ndarray | None = None
    is_assumed: bool = False
    along_unit: str = ""

    @property
    def largest(self) -> float:
        """The largest absolute value."""
        return float(np.abs(self.values).max())


def read_measured(
    experiment: Experiment, units_of: Sequence[str], along_unit: str, reach: Reach | None
) -> tuple[Measured, ...]:
    """Return the points of each measured column of an experiment, in SI units.

    `units_of` are the SI units of the measured quantities, and `along_unit` is the one of the
    column that orders the points. `reach` is the range that the run covers along the curve; None
    if only the run will tell it.

    Raise `InputError` for a missing column, a value that is no number, an uncertainty that is
    not > 0, and a point that lies beyond `reach`.
    """
    table = read_table(experiment.data, experiment.label)
    columns = experiment.columns
    named = zip(columns, units_of, strict=True)
    values = [table.numbers(column, unit) for column, unit in named]
    repeats = _read_repeats(experiment, table)
    along = None
    if experiment.order:
        along = _read_places(table, experiment, along_unit, repeats, reach)
    read = []
    for i, (column, quantity) in enumerate(columns.items()):
        points = Measured(
            column=column,
            quantity=quantity,
            unit=units_of[i],
            values=values[i],
            sigma=np.zeros(len(values[i])),  # set below
            along=along,
            along_unit=along_unit,
            repeats=repeats,
        )
        read.append(_with_sigma(points, experiment, table, repeats))
    return tuple(read)


def _read_repeats(experiment: Experiment, table: DataTable) -> np.ndarray:
    """Return the number of the repeat of each row; 0 for all rows without such a column.

    Raise `InputError` if sigma = "repeats" but there are less than 2 repeats.
    """
    has_repeats = "repeat" in table
    numbers = table.numbers("repeat", None) if has_repeats else np.zeros(len(table.lines))
    is_needed = "repeats" in {experiment.sigma_of(column) for column in experiment.columns}
    if is_needed and len(np.unique(numbers)) < 2:
        allowed = "needs at least 2 repeats in the column repeat"
        remedy = 'Of one specimen write sigma = "2 %", say.'
        raise InputError('sigma = "repeats"', allowed, table.where, remedy)
    return numbers


def _read_places(
    table: DataTable, experiment: Experiment, unit: str, repeats: np.ndarray, reach: Reach | None
) -> np.ndarray:
    """Return the place of each row along the curve: the change from the start, or the time.

    If no value of a quantity lies within `reach`, the column counts as a distance, as between
    two clamps, and its changes from the first value of each repeat are returned. Raise
    `InputError` for a place beyond `reach`.
    """
    assert experiment.order is not None
    column, quantity = experiment.order
    written_unit = table.cells.get(column, ("",))[0]
    if not quantity and not unit and written_unit is not None:
        unit_of_column = "s"  # the part of the loads has no unit, and may be a time of 1 s
    else:
        unit_of_column = unit
    values = table.numbers(column, unit_of_column)
    if reach is None:
        return values
    low, high = reach
    spare = ROUND_OFF_OF_REACH * max(abs(low), abs(high))
    is_reached = (values >= low - spare) & (values <= high + spare)
    if quantity and values.size and not is_reached.any():
        for number in np.unique(repeats):
            rows = repeats == number
            values[rows] -= values[rows][0]
    shifted = values
    if experiment.offset and high > -low:
        # the best that the fit can do: an offset of at most half of the reach
        half = (high - low) / 2
        shifted = values - np.clip(values.min() - low, -half, half)
    beyond_reach = np.flatnonzero((shifted < low - spare) | (shifted > high + spare))
    if len(beyond_reach):
        row = beyond_reach[np.argmax(np.abs(shifted[beyond_reach]))]
        what = f"line {table.lines[row]}: {column} = {values[row]:.6g} {unit}".rstrip()
        allowed = f"is beyond what the run reaches, {low:.6g} to {high:.6g} {unit}".rstrip()
        remedy = "Move the grip farther, leave points out, or look at the sign and the unit."
        raise InputError(what, allowed, table.where, remedy)
    return values


def _with_sigma(
    points: Measured, experiment: Experiment, table: DataTable, repeats: np.ndarray
) -> Measured:
    """Return the points with their standard uncertainties.

    With sigma = "repeats" they are the means of the repeats, with the uncertainty that their
    scatter gives. Raise `InputError` for an uncertainty that is not > 0.
    """
    stated_sigma = experiment.sigma_of(points.column)
    if stated_sigma == "repeats":
        return _mean_of_repeats(points, table, repeats)
    sigma = _read_sigma(table, points.column, points.unit, points.values, stated_sigma)
    if not (sigma > 0).all():
        line = table.lines[int(np.argmin(sigma))]
        what = f"line {line}: sigma of {points.column} = {sigma.min():g} {points.unit}".rstrip()
        remedy = 'As "2 %" of the largest value, or "0.1 N".'
        raise InputError(what, "must be > 0", table.where, remedy)
    return replace(points, sigma=sigma, is_assumed=stated_sigma is None)


def _read_sigma(
    table: DataTable, column: str, unit: str, values: np.ndarray, stated: str | float | None
) -> np.ndarray:
    """Return the standard uncertainties (n,) of the values of a column, in SI.

    `stated` is what the experiment says: a number in SI, the name of a column of the table, a
    text in per cent of the largest value, a text with a unit, or None for `ASSUMED_SIGMA`. Raise
    `InputError` for any other text.
    """
    ones = np.ones(len(values))
    largest = np.abs(values).max()
    if stated is None:
        return ASSUMED_SIGMA * largest * ones
    if isinstance(stated, str) and stated in table:
        return table.numbers(stated, unit)
    text = part_of(largest, stated, "sigma", table.where)
    if not isinstance(text, str):
        return float(text) * ones
    try:
        if unit:
            dimension = DIMENSIONS[unit.replace("²", "^2").replace("³", "^3")]
            return units.quantity("sigma", text, dimension) * ones
        return float(text) * ones
    except (ValueError, KeyError) as error:
        allowed = 'must be as "2 %", "0.1 N", the name of a column, or "repeats"'
        raise InputError(f"sigma = {brief(stated)}", allowed, table.where) from error


def _mean_of_repeats(points: Measured, table: DataTable, repeats: np.ndarray) -> Measured:
    """Return the mean of the R repeats, at equal steps along the part of the curve they share.

    The mean has as many points as a repeat usually has. Its standard uncertainty is the scatter
    of the repeats, one number for the whole curve, over √R. If all repeats are the same, it is
    the round-off of the values. Raise `InputError` if the repeats share no part of the curve.
    """
    along = points.along
    groups = [np.flatnonzero(repeats == number) for number in np.unique(repeats)]
    if along is None:
        curves = np.array([[points.values[rows].mean()] for rows in groups])
        places = None
    else:
        begin = max(along[rows].min() for rows in groups)
        end = min(along[rows].max() for rows in groups)
        if not begin < end:
            allowed = "the repeats have no part of the curve in common"
            raise InputError(f"column {points.column!r}", allowed, table.where)
        usual_number_of_points = int(np.median([len(rows) for rows in groups]))
        places = np.linspace(begin, end, usual_number_of_points)
        curves = np.empty((len(groups), len(places)))
        for i, rows in enumerate(groups):
            # np.interp needs increasing places
            ordered_rows = rows[np.argsort(along[rows], kind="stable")]
            curves[i] = np.interp(places, along[ordered_rows], points.values[ordered_rows])
    mean = curves.mean(axis=0)
    scatter = curves - mean
    # at each point R − 1 of the R differences from the mean are independent
    variance = (scatter**2).sum() / (scatter.size - mean.size)
    round_off = np.finfo(float).eps * np.abs(mean).max()
    sigma = max(np.sqrt(variance / len(groups)), round_off)
    return replace(
        points,
        values=mean,
        sigma=np.full(len(mean), sigma),
        along=places,
        scatter=scatter,
        repeats=np.zeros(len(mean)),
    )
