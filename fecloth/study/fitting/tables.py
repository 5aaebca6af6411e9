"""The tables of a fit: constants, measured columns, points, and predictions of other columns."""

import math
from collections.abc import Mapping

import numpy as np

from fecloth.study.fitting import words
from fecloth.study.fitting.amplitude import read_curve
from fecloth.study.fitting.discrepancy import Discrepancy
from fecloth.study.fitting.evaluation import Evaluation, Fitting
from fecloth.study.result import Cell, Table

Interval = tuple[float, float]


def table_of_constants(
    fitting: Fitting,
    values: Mapping[str, float],
    intervals: Mapping[str, Interval],
    of_data: Mapping[str, Interval],
    numerical: Mapping[str, float],
) -> Table:
    """Return the table of the constants: value, intervals, shift and start, in SI.

    The arguments are by the names of the constants, as in `Fit`.
    """
    rows: list[dict[str, Cell]] = [
        {
            "constant": constant.name,
            "unit": words.unit_of(constant.name),
            "value": values[constant.name],
            "from": intervals[constant.name][0],
            "to": intervals[constant.name][1],
            "from, these specimens": of_data[constant.name][0],
            "to, these specimens": of_data[constant.name][1],
            "shift by mesh and step": numerical[constant.name],
            "start": constant.start,
        }
        for constant in fitting.constants
    ]
    return Table(tuple(rows))


def rows_of_experiments(end: Evaluation) -> list[dict[str, Cell]]:
    """Return a row for each measured column: its points, and how far the fit is off there.

    "rms / sigma" is in units of the uncertainty of each point. "rms %" and "largest %" are in
    per cent of the largest measured value. They are NaN if the run failed.
    """
    rows: list[dict[str, Cell]] = []
    for column in end.columns:
        experiment = column.specimen.experiment
        points = column.points
        r = column.residual  # in units of sigma
        difference = r * points.sigma  # computed − measured
        along = experiment.order[0] if experiment.order else "number"
        if points.along_unit:
            along = f"{along} [{points.along_unit}]"
        shift = column.computed.shift if column.computed else np.nan
        rows.append(
            {
                "experiment": column.label,
                "column": points.column,
                "unit": points.unit,
                "along": along,
                "points": len(points.values),
                "sigma": float(np.median(points.sigma)),
                "rms / sigma": float(np.sqrt(np.mean(r**2))),
                "rms %": 100 * float(np.sqrt(np.mean(difference**2))) / points.largest,
                "largest %": 100 * float(np.abs(difference).max()) / points.largest,
                "offset": shift if experiment.offset else None,
                "fitted": "yes" if experiment.fitted else "no",
            }
        )
    return rows


def table_of_points(end: Evaluation) -> Table:
    """Return a row for each measured point, in SI units.

    "along" is its place along the curve, or its number if there is no curve. "residual" is
    computed − measured value in units of sigma; it and "computed" are NaN if the run failed.
    """
    rows: list[dict[str, Cell]] = []
    for fitted in end.columns:
        points = fitted.points
        residuals = fitted.residual
        places = np.arange(len(residuals)) if points.along is None else points.along
        computed = points.values + residuals * points.sigma
        for i, residual in enumerate(residuals):
            row: dict[str, Cell] = {
                "experiment": fitted.label,
                "column": points.column,
                "along": float(places[i]),
                "measured": float(points.values[i]),
                "sigma": float(points.sigma[i]),
                "computed": float(computed[i]),
                "residual": float(residual),
            }
            rows.append(row)
    return Table(tuple(rows))


def table_of_predictions(end: Evaluation, scale: Discrepancy | None) -> Table:
    """Return the table `Fit.predictions`, for the columns that were not fitted and ran."""
    rows: list[dict[str, Cell]] = []
    for column in end.columns:
        curve = None if column.is_fitted else read_curve(column)
        if curve is None or scale is None:
            continue
        assert column.computed
        start = column.computed.start
        places = column.points.along
        last = len(column.residual) - 1 if places is None else int(np.argmax(np.abs(places)))
        change = float(column.computed.changes[last])
        half = scale.quantile * float(np.sqrt(scale.variance(curve)))
        ends = sorted(start + change * math.exp(end_of) for end_of in (-half, half))
        rows.append(
            {
                "experiment": column.label,
                "column": column.points.column,
                "unit": column.points.unit,
                "start": start,
                "predicted": start + change,
                "from": ends[0],
                "to": ends[1],
                "measured": start + change * math.exp(curve.amplitude),
            }
        )
    return Table(tuple(rows))
