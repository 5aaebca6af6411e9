"""The result of a fit: constants with intervals, tables, figure, and the fitted fabric."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import errors
from fecloth.fabric.uncertainty import UNKNOWN, merged
from fecloth.scene.toml_text import to_toml
from fecloth.study.constants_read import numbers_read
from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.fitting import mistakes, words
from fecloth.study.fitting.discrepancy import Discrepancy, find_discrepancy, read_curve
from fecloth.study.fitting.evaluation import Evaluation, Fitting
from fecloth.study.fitting.measured import ASSUMED_SIGMA
from fecloth.study.fitting.specimens import fabric_with
from fecloth.study.fitting.statistics import LARGEST_UNCERTAINTY, statistics
from fecloth.study.result import Cell, StudyResult, Table, in_percent, write_csv

Interval = tuple[float, float]
EMPTY = Table(())
NO_INTERVAL = (float("nan"), float("nan"))
PANELS_IN_ROW = 3  # of the figure
COVERS = 2.0  # times a standard uncertainty is an interval, as `budget` reads it


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
    fabric
        The fitted table [fabric].
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
    fabric: Mapping[str, Any] = field(default_factory=dict)

    @property
    def resolved(self) -> bool:
        """Whether mesh and step shift each constant by less than half of its interval."""
        return not any(
            abs(shift) > words.half_of(self.intervals_of_data[name])
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
    rows: list[Any] = _rows_of_experiments(end)
    predictions = _table_of_predictions(end, scale)
    verdict = [
        words.describe_fit(fitting, end, facts),
        *words.describe_values(values, intervals, of_data),
        *words.describe_search(end),
        *mistakes.describe_points(end),
        *mistakes.describe_units(fitting.unknowns, end.u, facts.told),
        *words.describe_specimens(scale),
        *words.describe_untold(fitting, facts),
        *words.describe_resolution(numerical, of_data),
        *words.describe_law(fitting, end, facts),
        *words.describe_predictions(end, predictions),
    ]
    return Fit(
        title=title,
        verdict="\n".join(verdict),
        table=_table_of_constants(fitting, values, intervals, of_data, numerical),
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
        offsets={row["experiment"]: row["offset"] for row in rows if row["offset"] is not None},
        experiments=Table(tuple(rows)),
        points=_table_of_points(end),
        fabric=_fitted_fabric(fitting, values, intervals, covariance, scale),
        remarks=(*remarks, *_describe_held(fitting), *_describe_assumed(end)),
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


def _table_of_predictions(end: Evaluation, scale: Discrepancy | None) -> Table:
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
    scale: Discrepancy | None,
) -> dict[str, Any]:
    """Return the table [fabric] with the fitted constants, from the first scene of the fit.

    Its [fabric.uncertainty] has the standard uncertainties of the constants with an interval,
    their correlations, and the ones of specimens and of the law. They are so large that twice of
    each covers 95 %. The other constants that the specimens depend on are "unknown", unless the
    fabric of the fit states their uncertainty. The table is empty if no problem is a scene, or if
    no constant of a fabric was fitted. `covariance` (k, k) is the one of `values`, in their order.
    """
    tables = (specimen.problem.tables.get("fabric") for specimen in fitting.specimens)
    table = next(filter(None, tables), None)
    constants = {name: value for name, value in values.items() if name.startswith("fabric.")}
    if not (table and constants):
        return {}
    fabric = fabric_with(table, constants)
    keys = [name.removeprefix("fabric.") for name in values]
    read = [name for specimen in fitting.specimens for name in numbers_read(specimen.problem)]
    uncertainty: dict[str, Any] = {
        name.removeprefix("fabric."): UNKNOWN for name in [*read, *constants]
    }
    uncertainty = merged(uncertainty, (), fabric.get("uncertainty", {}))
    with_interval = [
        i for i, name in enumerate(values) if name in constants and np.isfinite(intervals[name][0])
    ]
    if scale and with_interval:
        widened = scale.quantile / COVERS
        deviations = np.sqrt(np.diag(covariance))
        uncertainty |= {keys[i]: float(widened * deviations[i]) for i in with_interval}
        uncertainty["correlation"] = [
            [keys[i], keys[j], float(covariance[i, j] / (deviations[i] * deviations[j]))]
            for i, j in combinations(with_interval, 2)
        ]
        of_curves = {"specimen": scale.specimens, "law": scale.law}
        uncertainty |= {key: float(widened * u) for key, u in of_curves.items() if u > 0}
    return fabric | {"uncertainty": uncertainty}
