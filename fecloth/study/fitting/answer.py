"""What a fit answers: constants with intervals, words, tables, and the fitted fabric."""

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any

import numpy as np

from fecloth.study.fitting import words
from fecloth.study.fitting.evaluation import Block, Evaluation, Fitting
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.measured import ASSUMED, Measured
from fecloth.study.fitting.result import Fit, Interval
from fecloth.study.fitting.specimens import fabric_with
from fecloth.study.fitting.statistics import statistics
from fecloth.study.problems import SceneProblem
from fecloth.study.result import Cell, Table, in_percent

NO_INTERVAL = (float("nan"), float("nan"))


def _describe_signs(fitting: Fitting, end: Evaluation) -> Iterator[str]:
    for block, experiment, points, _ in _blocks(fitting):
        if block in end.computed and end.computed[block].values @ points.values < 0:
            column = f"{experiment.label}: {points.column}"
            yield f"{column} has the sign opposite to {points.quantity}; is its direction right?"


def summarise(
    fitting: Fitting, end: Evaluation, coarse: Evaluation | None, title: str, remarks: list[str]
) -> Fit:
    """The result at the end of a fit; `coarse` is the end before h and dt were halved."""
    facts = statistics(fitting, end)
    constants = fitting.constants
    count = len(constants)
    at = [float(u) for u in end.u[:count]]
    values = {each.name: each.at(u) for each, u in zip(constants, at, strict=True)}
    half = facts.quantile * np.sqrt(np.diag(facts.covariance))
    told = {each.name: bool(facts.told[i]) for i, each in enumerate(constants)}
    intervals = {}
    for i, each in enumerate(constants):
        known = told[each.name] and not facts.law_fails
        intervals[each.name] = each.spread(at[i], float(half[i])) if known else NO_INTERVAL
    numerical = {
        name: values[name] - coarse.values[name] if told[name] and coarse else np.nan
        for name in values
    }
    slopes = np.array([each.slope(u) for each, u in zip(constants, at, strict=True)])
    covariance = facts.covariance[:count, :count] * np.outer(slopes, slopes)
    verdict = [
        words.describe_fit(fitting, facts),
        *(words.describe_value(name, values[name], intervals[name]) for name in values),
        *words.describe_untold(fitting, facts),
        *words.describe_resolution(numerical, intervals),
        *words.describe_law(fitting, end, facts),
        *words.describe_predictions(fitting, end),
    ]
    return Fit(
        title=title,
        warnings=tuple(_describe_signs(fitting, end)),
        verdict="\n".join(verdict),
        table=_table(fitting, values, intervals, numerical),
        values=values,
        intervals=intervals,
        covariance=covariance,
        identified=tuple(name for name in values if told[name]),
        misfit=facts.misfit,
        numerical=numerical,
        law_fails=facts.law_fails,
        offsets={
            each.experiment.label: end.shift((i, 0))
            for i, each in enumerate(fitting.specimens)
            if each.experiment.offset
        },
        experiments=_experiments(fitting, end),
        points=_points(fitting, end),
        fabric=_fabric(fitting, values, intervals, covariance),
        remarks=(*remarks, *_describe_assumed(fitting)),
    )


def _describe_assumed(fitting: Fitting) -> Iterator[str]:
    names = {
        fitting.specimens[i].experiment.label
        for i, k in fitting.blocks
        if fitting.specimens[i].points[k].is_assumed
    }
    if names:
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


def _blocks(fitting: Fitting) -> Iterator[tuple[Block, Experiment, Measured, str]]:
    """All measured columns, with the name of what orders their points."""
    for block in fitting.all_blocks:
        specimen = fitting.specimens[block[0]]
        order = specimen.experiment.order
        yield block, specimen.experiment, specimen.points[block[1]], order[0] if order else "number"


def _experiments(fitting: Fitting, end: Evaluation) -> Table:
    rows: list[dict[str, Cell]] = []
    for block, experiment, points, along in _blocks(fitting):
        r, apart = end.residuals[block], end.residuals[block] * points.sigma
        rows.append(
            {
                "experiment": experiment.label,
                "column": points.column,
                "unit": points.unit,
                "along": f"{along} [{points.along_unit}]" if points.along_unit else along,
                "points": len(points.values),
                "misfit": float(np.mean(r**2)),
                "rms %": 100 * float(np.sqrt(np.mean(apart**2))) / points.largest,
                "largest %": 100 * float(np.abs(apart).max()) / points.largest,
                "offset": end.shift(block) if experiment.offset else None,
                "fitted": "yes" if experiment.fitted else "no",
            }
        )
    return Table(tuple(rows))


def _points(fitting: Fitting, end: Evaluation) -> Table:
    rows: list[dict[str, Cell]] = []
    for block, experiment, points, _ in _blocks(fitting):
        count = len(points.values)
        places = np.arange(count) if points.along is None else points.along
        computed = end.computed[block].values if block in end.computed else np.full(count, np.nan)
        names = "experiment", "column", "along", "measured", "sigma", "computed", "residual"
        columns = places, points.values, points.sigma, computed, end.residuals[block]
        for numbers in zip(*columns, strict=True):
            cells: list[Cell] = [experiment.label, points.column, *map(float, numbers)]
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
