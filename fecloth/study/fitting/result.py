"""The result of a fit: constants with intervals, tables, figure, and the fitted fabric."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import errors
from fecloth.scene.toml_text import to_toml
from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.fitting import mistakes, words
from fecloth.study.fitting.discrepancy import find_discrepancy
from fecloth.study.fitting.evaluation import Evaluation, Fitting
from fecloth.study.fitting.fitted import fitted_tables
from fecloth.study.fitting.statistics import LARGEST_UNCERTAINTY, statistics
from fecloth.study.fitting.tables import (
    Interval,
    rows_of_experiments,
    table_of_constants,
    table_of_points,
    table_of_predictions,
)
from fecloth.study.result import StudyResult, Table, write_csv

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
        The ends of the 95 % intervals of new specimens by name; NaN where the data do not tell a
        constant, or nothing tells how much specimens differ, or how wrong a wrong law is.
    intervals_of_data
        The same of the specimens that were measured, by the noise of their points; NaN where the
        data do not tell a constant, or where the law is wrong.
    covariance
        Covariance of `values`, in their order and in SI units: of the mean of all specimens if
        `intervals` are known, else by the noise of points.
    identified
        Names of the constants that the data tell.
    misfit
        Reduced χ²: 1 if the residuals are as large as the uncertainties.
    numerical
        The shift of each constant by h/2 and dt/2, by name and in SI units; NaN where nothing
        can be refined.
    law_fails
        Whether the misfit is larger than the uncertainties allow.
    specimens
        Relative standard deviation of the curves of specimens about their mean; NaN if unknown.
    law
        Relative standard uncertainty of a curve by the law; NaN if no curve is told by others.
    specimens_and_law
        Root of the sum of the squares of both, where `specimens` alone is not known; else NaN.
    predictions
        A table with a row for each column that was not fitted: the first and last value of its
        curve, the 95 % interval of the last one for a new specimen, and the last value that all
        its points give. The interval is NaN where the fitted data do not tell it.
    offsets
        The slack of each experiment with an offset, by its name and in SI units.
    experiments
        A table with a row for each measured column.
    points
        A table with a row for each measured point.
    fitted
        The tables of fitted.toml, see `fecloth/study/fitting/fitted.py`.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    intervals_of_data: Mapping[str, Interval] = field(default_factory=dict)
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    identified: tuple[str, ...] = ()
    misfit: float = np.nan
    numerical: Mapping[str, float] = field(default_factory=dict)
    law_fails: bool = False
    specimens: float = np.nan
    law: float = np.nan
    specimens_and_law: float = np.nan
    predictions: Table = EMPTY
    offsets: Mapping[str, float] = field(default_factory=dict)
    experiments: Table = EMPTY
    points: Table = EMPTY
    fitted: Mapping[str, Any] = field(default_factory=dict)

    @property
    def fabric(self) -> Mapping[str, Any]:
        """The fitted table [fabric]; empty if no constant of one was fitted."""
        return self.fitted.get("fabric", {})

    @property
    def resolved(self) -> bool:
        """Whether mesh and step shift each constant by less than half of its interval."""
        return not words.unresolved(self.numerical, self.intervals_of_data)

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
        return "fitted.toml", "\n".join([*comments, "", to_toml(dict(self.fitted))])


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
    stated: float | None,
    title: str,
    remarks: list[str],
) -> Fit:
    """Return the result of a fit: constants, intervals, tables, and the answer in words.

    `end` is where the search ended, and `coarse_end` is where it ended before h and dt were
    halved; None if they were not. `stated` is the spread of specimens that the user states, or
    None. A constant that the data do not tell has no interval and no shift.
    """
    facts = statistics(end)
    scale = find_discrepancy(end, stated)
    told = {constant.name: bool(facts.told[i]) for i, constant in enumerate(fitting.constants)}
    told_by_data = facts.told & (not facts.law_fails)
    of_data = _intervals(fitting, end, facts.covariance, facts.quantile, told_by_data)
    intervals = dict.fromkeys(told, NO_INTERVAL)
    V = facts.covariance
    law_counts = not facts.law_fails or (scale is not None and np.isfinite(scale.law))
    if scale and np.isfinite(scale.specimens) and law_counts:
        V = scale.covariance(is_new=False)
        new = scale.covariance(is_new=True)
        # the limit for a constant holds for new specimens, too
        told_of_new = facts.told & (np.diag(new) <= LARGEST_UNCERTAINTY**2)
        intervals = _intervals(fitting, end, new, scale.quantile, told_of_new)
    values = {}
    numerical = {}
    slopes = []
    for i, constant in enumerate(fitting.constants):
        name = constant.name
        values[name] = constant.at(float(end.u[i]))
        slopes.append(constant.slope(float(end.u[i])))
        numerical[name] = np.nan
        if told[name] and coarse_end:
            numerical[name] = values[name] - coarse_end.values[name]
    count = len(fitting.constants)
    # of the constants p, by the slopes dp/du; the offsets come last in u
    covariance = V[:count, :count] * np.outer(slopes, slopes)
    rows: list[Any] = rows_of_experiments(end)
    predictions = table_of_predictions(end, scale)
    verdict = [
        words.describe_fit(fitting, end, facts),
        *words.describe_values(values, intervals, of_data),
        *words.describe_search(end),
        *mistakes.describe_points(end),
        *mistakes.describe_units(fitting.unknowns, end.u, facts.told),
        *words.describe_specimens(scale),
        *words.describe_slack(end),
        *words.describe_untold(fitting, facts),
        *words.describe_resolution(numerical, of_data),
        *words.describe_law(fitting, end, facts),
        *words.describe_predictions(end, predictions),
    ]
    return Fit(
        title=title,
        verdict="\n".join(verdict),
        table=table_of_constants(fitting, values, intervals, of_data, numerical),
        values=values,
        intervals=intervals,
        intervals_of_data=of_data,
        covariance=covariance,
        identified=tuple(name for name in told if told[name]),
        misfit=facts.misfit,
        numerical=numerical,
        law_fails=facts.law_fails,
        specimens=scale.specimens if scale else np.nan,
        law=scale.law if scale else np.nan,
        specimens_and_law=scale.both if scale else np.nan,
        predictions=predictions,
        offsets=words.slacks(end),
        experiments=Table(tuple(rows)),
        points=table_of_points(end),
        fitted=fitted_tables(
            fitting=fitting,
            values=values,
            intervals=intervals,
            covariance=covariance,
            scale=scale,
            slack=words.mean_and_next(words.slacks(end).values())[1],
        ),
        remarks=(*remarks, *words.describe_held(fitting), *words.describe_assumed(end)),
    )


def _intervals(
    fitting: Fitting, end: Evaluation, covariance: np.ndarray, quantile: float, told: np.ndarray
) -> dict[str, Interval]:
    """Return the interval of each constant by its name; NaN for one that is not told.

    `covariance` (m, m) is of u, and `told` (m,) says which unknowns have an interval.
    """
    half_intervals = quantile * np.sqrt(np.diag(covariance))
    intervals = {}
    for i, constant in enumerate(fitting.constants):
        intervals[constant.name] = NO_INTERVAL
        if told[i]:
            u = float(end.u[i])
            intervals[constant.name] = constant.spread(u, float(half_intervals[i]))
    return intervals
