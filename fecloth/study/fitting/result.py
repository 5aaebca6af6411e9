"""The result of a fit: constants with intervals, tables, figure, and the fitted fabric."""

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
from fecloth.study.fitting.measured import ASSUMED
from fecloth.study.fitting.specimens import fabric_with
from fecloth.study.fitting.statistics import statistics
from fecloth.study.parameters import numbers_of
from fecloth.study.problems import SceneProblem
from fecloth.study.result import Cell, StudyResult, Table, in_percent, write_csv

Interval = tuple[float, float]
EMPTY = Table(())
COLUMNS = 3  # of panels of the figure


@dataclass(frozen=True, eq=False, repr=False)
class Fit(StudyResult):
    """What `fit` found: the table has a row for each constant.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        One row for each run or level; see `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    values
        Name → constant [SI].
    intervals
        Name → ends of the 95 % interval; NaN where the data do not tell it or the law is
        wrong.
    covariance
        Of values, [SI²].
    identified
        Names of the constants that the data tell.
    misfit
        Reduced χ²: 1 if the residuals are as large as the uncertainties.
    numerical
        Name → shift by h/2 and dt/2 [SI]; NaN where nothing can be refined.
    law_fails
        Whether the misfit is larger than the uncertainties allow.
    offsets
        Experiment → slack [SI].
    experiments
        a row for each measured column.
    points
        a row for each measured point.
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
        """Exit status of the command: 0 if all constants are told and the law can meet the data."""
        told = len(self.identified) == len(self.values)
        if told and self.resolved and not self.law_fails:
            return 0
        return errors.MISSED

    def summary(self) -> str:
        return "\n".join([super().summary(), str(self.experiments), ""])

    def figure(self) -> Figure:
        """Return a panel for each measured column: points, computed curve, and residuals below."""
        rows = list(self.experiments)
        columns = min(COLUMNS, len(rows))
        count = -(-len(rows) // columns)
        size = (4.2 * columns, 4.6 * count)
        heights = [3, 1] * count
        drawing, axes = new_figure(2 * count, columns, size, squeeze=False, height_ratios=heights)
        pairs = axes.reshape(count, 2, columns).swapaxes(1, 2).reshape(-1, 2)
        for ax in pairs[len(rows) :].ravel():
            ax.set_axis_off()
        for row, (above, below) in zip(rows, pairs, strict=False):
            name = row["experiment"], row["column"]
            own: list[Any] = [p for p in self.points if (p["experiment"], p["column"]) == name]
            _draw(above, below, row, sorted(own, key=lambda p: p["along"]))
        return drawing

    def report(self, folder: str | Path) -> Path:
        """Write points.csv, fitted.toml, report.html, results.csv and the figure."""
        write_csv(list(self.points), Path(folder) / "points.csv")
        return super().report(folder)

    @property
    def scene_file(self) -> tuple[str, str]:
        """Name and text of the file of the fitted fabric and the constants of terms."""
        head = [f"# {line}" for line in self.words()]
        others = {k: v for k, v in self.values.items() if not k.startswith("fabric.")}
        tables: dict[str, Any] = {"parameters": others, "fabric": dict(self.fabric)}
        return "fitted.toml", "\n".join([*head, "", to_toml(tables)])


def _draw(above: Any, below: Any, row: Mapping, points: Sequence[Mapping]) -> None:
    names = "along", "measured", "sigma", "computed", "residual"
    x, measured, sigma, computed, residual = ([p[name] for p in points] for name in names)
    dots = {"fmt": ".", "color": COLOURS[0], "elinewidth": 0.6}
    above.errorbar(x, measured, yerr=sigma, label="measured", **dots)
    above.plot(x, computed, color=COLOURS[1], label="computed")
    used = "" if row["fitted"] == "yes" else " (not fitted)"
    above.set(ylabel=f"{row['column']} [{row['unit']}]" if row["unit"] else row["column"])
    above.set_title(f"{row['experiment']}{used}", loc="left")
    above.legend()
    below.plot(x, residual, ".", color=COLOURS[0])
    below.axhline(0.0, color="k", lw=0.8)
    below.set(xlabel=row["along"], ylabel="residual / σ")


NO_INTERVAL = (float("nan"), float("nan"))


def summarise(
    fitting: Fitting, end: Evaluation, coarse: Evaluation | None, title: str, remarks: list[str]
) -> Fit:
    """The result at the end of a fit; `coarse` is the end before h and dt were halved."""
    facts = statistics(end)
    constants = fitting.constants
    count = len(constants)
    at = [float(u) for u in end.u[:count]]
    values = {each.name: each.at(u) for each, u in zip(constants, at, strict=True)}
    half = facts.quantile * np.sqrt(np.diag(facts.covariance))
    told = {each.name: bool(facts.told[i]) for i, each in enumerate(constants)}
    intervals = {}
    for i, each in enumerate(constants):
        known = told[each.name] and not facts.law_fails
        if known:
            intervals[each.name] = each.spread(at[i], float(half[i]))
        else:
            intervals[each.name] = NO_INTERVAL
    numerical = {
        name: values[name] - coarse.values[name] if told[name] and coarse else np.nan
        for name in values
    }
    slopes = np.array([each.slope(u) for each, u in zip(constants, at, strict=True)])
    covariance = facts.covariance[:count, :count] * np.outer(slopes, slopes)
    rows: list[Any] = _experiments(end)
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
        table=_table(fitting, values, intervals, numerical),
        values=values,
        intervals=intervals,
        covariance=covariance,
        identified=tuple(name for name in values if told[name]),
        misfit=facts.misfit,
        numerical=numerical,
        law_fails=facts.law_fails,
        offsets={row["experiment"]: row["offset"] for row in rows if row["offset"] is not None},
        experiments=Table(tuple(rows)),
        points=_points(end),
        fabric=_fabric(fitting, values, intervals, covariance),
        remarks=(*remarks, *_describe_held(fitting), *_describe_assumed(end)),
    )


def _describe_held(fitting: Fitting) -> Iterator[str]:
    """Which constants of the fabric were taken as given."""
    held: dict[str, list[str]] = {}
    for each in fitting.specimens:
        for name, value in numbers_of(each.problem):
            sought = {name, name.rpartition(".")[0]} & set(each.names)
            if name.startswith("fabric.") and value and not sought:
                texts = held.setdefault(name.removeprefix("fabric."), [])
                texts += [f"{value:.4g}"] if f"{value:.4g}" not in texts else []
    if held:
        listed = ", ".join(f"{name} = {' and '.join(texts)}" for name, texts in held.items())
        yield f"taken as given, and not measured: {listed}"


def _describe_assumed(end: Evaluation) -> Iterator[str]:
    if names := {column.label for column in end.fitted if column.points.is_assumed}:
        share = in_percent(ASSUMED)
        listed = ", ".join(sorted(names))
        yield f"{listed}: no sigma is given, so {share} of the largest value is assumed"


def _table(
    fitting: Fitting,
    values: Mapping[str, float],
    intervals: Mapping[str, Interval],
    numerical: Mapping[str, float],
) -> Table:
    rows: list[dict[str, Cell]] = [
        {
            "constant": each.name,
            "unit": words.unit_of(each.name),
            "value": values[each.name],
            "from": intervals[each.name][0],
            "to": intervals[each.name][1],
            "shift by mesh and step": numerical[each.name],
            "start": each.start,
        }
        for each in fitting.constants
    ]
    return Table(tuple(rows))


def _experiments(end: Evaluation) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for column in end.columns:
        experiment = column.specimen.experiment
        points = column.points
        r = column.residual
        along = experiment.order[0] if experiment.order else "number"
        apart = r * points.sigma
        shift = column.computed.shift if column.computed else np.nan
        rows.append(
            {
                "experiment": column.label,
                "column": points.column,
                "unit": points.unit,
                "along": f"{along} [{points.along_unit}]" if points.along_unit else along,
                "points": len(points.values),
                "sigma": float(np.median(points.sigma)),
                "rms / sigma": float(np.sqrt(np.mean(r**2))),
                "rms %": 100 * float(np.sqrt(np.mean(apart**2))) / points.largest,
                "largest %": 100 * float(np.abs(apart).max()) / points.largest,
                "offset": shift if experiment.offset else None,
                "fitted": "yes" if experiment.fitted else "no",
            }
        )
    return rows


def _points(end: Evaluation) -> Table:
    rows: list[dict[str, Cell]] = []
    for column in end.columns:
        points = column.points
        r = column.residual
        places = np.arange(len(r)) if points.along is None else points.along
        computed = points.values + r * points.sigma
        names = "experiment", "column", "along", "measured", "sigma", "computed", "residual"
        for numbers in zip(places, points.values, points.sigma, computed, r, strict=True):
            cells: list[Cell] = [column.label, points.column, *map(float, numbers)]
            rows.append(dict(zip(names, cells, strict=True)))
    return Table(tuple(rows))


def _fabric(
    fitting: Fitting,
    values: Mapping[str, float],
    intervals: Mapping[str, Interval],
    covariance: np.ndarray,
) -> dict[str, Any]:
    """The table [fabric] of the fitted scenes, with the uncertainty of what has an interval."""
    scene = next((s for s in fitting.specimens if isinstance(s.problem, SceneProblem)), None)
    own = {name: value for name, value in values.items() if name.startswith("fabric.")}
    if not (scene and own):
        return {}
    fabric = fabric_with(scene.problem.tables["fabric"], own)
    names = list(values)
    known = [i for i, name in enumerate(names) if name in own and np.isfinite(intervals[name][0])]
    standard = np.sqrt(np.diag(covariance))
    uncertain: dict[str, Any] = {
        names[i].removeprefix("fabric."): float(standard[i]) for i in known
    }
    pairs = [
        [
            *(names[k].removeprefix("fabric.") for k in (i, j)),
            float(covariance[i, j] / (standard[i] * standard[j])),
        ]
        for i, j in combinations(known, 2)
    ]
    uncertain |= {"correlation": pairs} if pairs else {}
    return fabric | ({"uncertainty": uncertain} if uncertain else {})
