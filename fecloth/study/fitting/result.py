"""The result of a fit: constants with intervals, tables, figure, and the fitted fabric."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import errors
from fecloth.scene.toml_text import to_toml
from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.fitting import words
from fecloth.study.fitting.evaluation import Evaluation, Fitting
from fecloth.study.fitting.measured import ASSUMED_SIGMA
from fecloth.study.fitting.specimens import fabric_with
from fecloth.study.fitting.statistics import statistics
from fecloth.study.result import Cell, StudyResult, Table, in_percent, write_csv

Interval = tuple[float, float]
EMPTY = Table(())
NO_INTERVAL = (float("nan"), float("nan"))
PANELS_IN_ROW = 3  # of the figure


@dataclass(frozen=True, eq=False, repr=False)
class Fit(StudyResult):
    """What `fit` found.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        A row for each constant; see `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    values
        The constants by name, in SI units.
    intervals
        The ends of the 95 % intervals by name; NaN where the data do not tell a constant, or
        where the law is wrong.
    covariance
        Covariance of `values`, in their order and in SI units.
    identified
        Names of the constants that the data tell.
    misfit
        Reduced χ²: 1 if the residuals are as large as the uncertainties.
    numerical
        The shift of each constant by h/2 and dt/2, by name and in SI units; NaN where nothing
        can be refined.
    law_fails
        Whether the misfit is larger than the uncertainties allow.
    offsets
        The slack of each experiment with an offset, by its name and in SI units.
    experiments
        A table with a row for each measured column.
    points
        A table with a row for each measured point.
    fabric
        The fitted table [fabric].
    """

    values: Mapping[str, float] = field(default_factory=dict)
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    identified: tuple[str, ...] = ()
    misfit: float = np.nan
    numerical: Mapping[str, float] = field(default_factory=dict)
    law_fails: bool = False
    offsets: Mapping[str, float] = field(default_factory=dict)
    experiments: Table = EMPTY
    points: Table = EMPTY
    fabric: Mapping[str, Any] = field(default_factory=dict)

    @property
    def resolved(self) -> bool:
        """Whether mesh and step shift each constant by less than half of its interval."""
        return not any(
            abs(shift) > (self.intervals[name][1] - self.intervals[name][0]) / 2
            for name, shift in self.numerical.items()
        )

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 if all constants are told and the law is not wrong."""
        are_told = len(self.identified) == len(self.values)
        if are_told and self.resolved and not self.law_fails:
            return 0
        return errors.MISSED

    def summary(self) -> str:
        """The answer in words, the table of constants, and the table of experiments."""
        return "\n".join([super().summary(), str(self.experiments), ""])

    def figure(self) -> Figure:
        """Return a panel for each measured column: points and curve, with residuals below."""
        rows = list(self.experiments)
        panels_in_row = min(PANELS_IN_ROW, len(rows))
        rows_of_panels = math.ceil(len(rows) / panels_in_row)
        drawing, axes = new_figure(
            2 * rows_of_panels,
            panels_in_row,
            (4.2 * panels_in_row, 4.6 * rows_of_panels),
            squeeze=False,
            height_ratios=[3, 1] * rows_of_panels,
        )
        # (panels, 2): the axes of the curve, and below it the axes of the residuals
        panels = axes.reshape(rows_of_panels, 2, panels_in_row).swapaxes(1, 2).reshape(-1, 2)
        for ax in panels[len(rows) :].ravel():  # the rest of the last row is empty
            ax.set_axis_off()
        for row, (above, below) in zip(rows, panels, strict=False):
            name = row["experiment"], row["column"]
            points: list[Any] = [
                point for point in self.points if (point["experiment"], point["column"]) == name
            ]
            _draw(above, below, row, sorted(points, key=lambda point: point["along"]))
        return drawing

    def report(self, folder: str | Path) -> Path:
        """Write points.csv, fitted.toml, report.html, results.csv and the figure."""
        write_csv(list(self.points), Path(folder) / "points.csv")
        return super().report(folder)

    @property
    def scene_file(self) -> tuple[str, str]:
        """Name and text of the file of the fitted fabric and the constants of terms."""
        comments = [f"# {line}" for line in self.words()]
        others = {
            name: value for name, value in self.values.items() if not name.startswith("fabric.")
        }
        tables: dict[str, Any] = {"parameters": others, "fabric": dict(self.fabric)}
        return "fitted.toml", "\n".join([*comments, "", to_toml(tables)])


def _draw(above: Any, below: Any, row: Mapping, points: Sequence[Mapping]) -> None:
    """Draw the points and the curve of a measured column `above`, and the residuals `below`.

    `above` and `below` are axes of matplotlib. `row` is the row of the column in
    `Fit.experiments`, and `points` are its rows in `Fit.points`, along the curve.
    """
    x = [point["along"] for point in points]
    measured = [point["measured"] for point in points]
    sigma = [point["sigma"] for point in points]
    look = {"fmt": ".", "color": COLOURS[0], "elinewidth": 0.6}
    above.errorbar(x, measured, yerr=sigma, label="measured", **look)
    above.plot(x, [point["computed"] for point in points], color=COLOURS[1], label="computed")
    above.set_ylabel(f"{row['column']} [{row['unit']}]" if row["unit"] else row["column"])
    note = "" if row["fitted"] == "yes" else " (not fitted)"
    above.set_title(f"{row['experiment']}{note}", loc="left")
    above.legend()
    below.plot(x, [point["residual"] for point in points], ".", color=COLOURS[0])
    below.axhline(0.0, color="k", lw=0.8)
    below.set(xlabel=row["along"], ylabel="residual / σ")


def summarise(
    fitting: Fitting,
    end: Evaluation,
    coarse_end: Evaluation | None,
    title: str,
    remarks: list[str],
) -> Fit:
    """Return the result of a fit: constants, intervals, tables, and the answer in words.

    `end` is where the search ended, and `coarse_end` is where it ended before h and dt were
    halved; None if they were not. A constant that the data do not tell has no interval and no
    shift; no constant has an interval if the law is wrong.
    """
    facts = statistics(end)
    constants = fitting.constants
    count = len(constants)
    half_intervals = facts.quantile * np.sqrt(np.diag(facts.covariance))  # of u
    values = {}
    intervals = {}
    numerical = {}
    slopes = []
    for i, constant in enumerate(constants):
        name = constant.name
        u = float(end.u[i])
        values[name] = constant.at(u)
        slopes.append(constant.slope(u))
        intervals[name] = NO_INTERVAL
        if facts.told[i] and not facts.law_fails:
            intervals[name] = constant.spread(u, float(half_intervals[i]))
        numerical[name] = np.nan
        if facts.told[i] and coarse_end:
            numerical[name] = values[name] - coarse_end.values[name]
    # of the constants p, by the slopes dp/du; the offsets come last in u
    covariance = facts.covariance[:count, :count] * np.outer(slopes, slopes)
    rows: list[Any] = _rows_of_experiments(end)
    verdict = [
        words.describe_fit(fitting, end, facts),
        *(words.describe_value(name, values[name], intervals[name]) for name in values),
        *words.describe_untold(fitting, facts),
        *words.describe_resolution(numerical, intervals),
        *words.describe_law(fitting, end, facts),
        *words.describe_predictions(end),
    ]
    return Fit(
        title=title,
        verdict="\n".join(verdict),
        table=_table_of_constants(fitting, values, intervals, numerical),
        values=values,
        intervals=intervals,
        covariance=covariance,
        identified=tuple(constant.name for i, constant in enumerate(constants) if facts.told[i]),
        misfit=facts.misfit,
        numerical=numerical,
        law_fails=facts.law_fails,
        offsets={row["experiment"]: row["offset"] for row in rows if row["offset"] is not None},
        experiments=Table(tuple(rows)),
        points=_table_of_points(end),
        fabric=_fitted_fabric(fitting, values, intervals, covariance),
        remarks=(*remarks, *_describe_held(fitting), *_describe_assumed(end)),
    )


def _describe_held(fitting: Fitting) -> Iterator[str]:
    """Yield a sentence with the constants of the fabrics that were not sought, and their values.

    There is none if all were sought. A constant that differs between the specimens has several
    values; constants that are 0 are left out.
    """
    held_values: dict[str, dict[str, None]] = {}  # by constant: texts, each once, in their order
    for specimen in fitting.specimens:
        for name, value in specimen.problem.source.numbers():
            # the unknown may be a pair, whose numbers end with .0 and .1
            is_sought = name in specimen.names or name.rpartition(".")[0] in specimen.names
            if name.startswith("fabric.") and value and not is_sought:
                texts = held_values.setdefault(name.removeprefix("fabric."), {})
                texts[f"{value:.4g}"] = None
    if held_values:
        items = [f"{name} = {' and '.join(texts)}" for name, texts in held_values.items()]
        yield f"taken as given, and not measured: {', '.join(items)}"


def _describe_assumed(end: Evaluation) -> Iterator[str]:
    """For which experiments nobody states an uncertainty."""
    if names := {column.label for column in end.fitted if column.points.is_assumed}:
        share = in_percent(ASSUMED_SIGMA)
        listed = ", ".join(sorted(names))
        yield f"{listed}: no sigma is given, so {share} of the largest value is assumed"


def _table_of_constants(
    fitting: Fitting,
    values: Mapping[str, float],
    intervals: Mapping[str, Interval],
    numerical: Mapping[str, float],
) -> Table:
    """Return the table of the constants: value, interval, shift and start, in SI.

    The arguments are by the names of the constants, as in `Fit`.
    """
    rows: list[dict[str, Cell]] = [
        {
            "constant": constant.name,
            "unit": words.unit_of(constant.name),
            "value": values[constant.name],
            "from": intervals[constant.name][0],
            "to": intervals[constant.name][1],
            "shift by mesh and step": numerical[constant.name],
            "start": constant.start,
        }
        for constant in fitting.constants
    ]
    return Table(tuple(rows))


def _rows_of_experiments(end: Evaluation) -> list[dict[str, Cell]]:
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


def _table_of_points(end: Evaluation) -> Table:
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


def _fitted_fabric(
    fitting: Fitting,
    values: Mapping[str, float],
    intervals: Mapping[str, Interval],
    covariance: np.ndarray,
) -> dict[str, Any]:
    """Return the table [fabric] with the fitted constants, from the first scene of the fit.

    Its [fabric.uncertainty] has the standard uncertainties of the constants with an interval,
    and their correlations. The table is empty if no problem is a scene, or if no constant of a
    fabric was fitted. `covariance` (k, k) is the one of `values`, in their order.
    """
    tables = (specimen.problem.tables.get("fabric") for specimen in fitting.specimens)
    table = next(filter(None, tables), None)
    constants = {name: value for name, value in values.items() if name.startswith("fabric.")}
    if not (table and constants):
        return {}
    fabric = fabric_with(table, constants)
    keys = [name.removeprefix("fabric.") for name in values]
    has_interval = [name in constants and np.isfinite(intervals[name][0]) for name in values]
    with_interval = np.flatnonzero(has_interval).tolist()
    deviations = np.sqrt(np.diag(covariance))
    uncertainty: dict[str, Any] = {keys[i]: float(deviations[i]) for i in with_interval}
    correlations = []
    for i, j in combinations(with_interval, 2):
        correlation = float(covariance[i, j] / (deviations[i] * deviations[j]))
        correlations.append([keys[i], keys[j], correlation])
    if correlations:
        uncertainty["correlation"] = correlations
    if uncertainty:
        fabric["uncertainty"] = uncertainty
    return fabric
