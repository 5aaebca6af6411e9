"""`fit`: constants of a fabric from several experiments, and what these do not tell."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.study.change import FIRST
from fecloth.study.fitting import words
from fecloth.study.fitting.evaluation import PRICE, Block, Evaluation, Fitting
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.measured import ASSUMED, Measured
from fecloth.study.fitting.result import Fit, Interval
from fecloth.study.fitting.search import Place, refine, search
from fecloth.study.fitting.specimens import fabric_with, open_specimens
from fecloth.study.fitting.statistics import statistics
from fecloth.study.fitting.unknowns import make_unknowns
from fecloth.study.problems import SceneProblem
from fecloth.study.result import Cell, Table, in_percent
from fecloth.study.run_problems import Runs
from fecloth.study.workload import check_size

EVALUATIONS = 8  # that a start usually takes
HOW = ("cache", "jobs", "scheduler", "time_limit", "most_seconds", "fresh")  # how cases run
NO_INTERVAL = (float("nan"), float("nan"))


def fit(
    experiments: Sequence[Experiment],
    parameters: Mapping[str, float],
    *,
    fabric: Mapping[str, Any] | Fabric | None = None,
    starts: int = 1,
    refined: bool = True,
    title: str = "fit",
    **shared: Any,
) -> Fit:
    """Find the constants with which problems meet measurements, by least squares.

    The sum of ((computed − measured)/σ)² over all points is least. The derivatives are the
    derivatives of `fecloth.sensitivity`; constants that are positive are sought by their
    logarithms. Beside each constant stands its 95 % interval, whether the data tell it at all, and
    its shift by half of h and dt; the constants are the ones of the finer meshes.

    Parameters
    ----------
    experiments
        What was measured, with the problem of each specimen.
    parameters
        Where to begin, by the names of the numbers: keys of scenes, as "fabric.shear_stiffness",
        with .0 (warp) or .1 (weft) for one number of a pair, or arguments of functions.
    fabric
        The rest of the fabric, for scenes; by default each scene has its own.
    starts
        Number of starts: the given one, and others between a third and three times of it.
    refined
        Whether the fit is repeated with half of h and dt.
    title
        A name for the report.
    shared
        Arguments of `fecloth.study.of`, as h, dt, probes, jobs and cache.

    Returns
    -------
    Fit
        With `values`, `intervals`, `covariance`, `identified`, `misfit`, `numerical`, `law_fails`
        and `verdict`.

    Raises
    ------
    InputError
        Before the first run: for a column that is not in the data, a quantity that the run does not
        have, a value that is no number, points beyond what the run reaches, and a name that is no
        number of any problem.
    FitFailed
        If no start runs.

    Notes
    -----
    A constant is not told if its standard uncertainty is above a factor of 1.65, or above 0.25 for
    Poisson's ratios; it has no interval then. The law is wrong if scatter alone gives such
    residuals with a probability below 0.5 %, by χ², or F where repeats give the scatter; no
    constant has an interval then.

    Sources: Seber and Wild (1989), Nonlinear Regression; the trust region of Branch, Coleman and Li
    (1999) in `scipy.optimize.least_squares`.

    Examples
    --------
    Three points of the force of a strip with Y = 1000 N/m, which is 0.5 m wide:

    >>> import fecloth as fc
    >>> def strip(h, stiffness, drawn=0.1):
    ...     cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    ...     system = fc.System(cloth, fc.Fabric(0.2, stiffness), [fc.StVK()], ["left", "right"])
    ...     return cloth, system, None, system.state(system.rest().x * [1.0 + drawn, 1.0, 1.0])
    >>> data = {"force [N]": [57.5, 58.0, 57.9]}
    >>> test = fc.Experiment(strip, data, quantity={"force": "reaction.right.x"}, sigma="0.5 %")
    >>> answer = fc.fit([test], {"stiffness": 800.0}, h=0.25)
    >>> print(f"{answer.values['stiffness']:.1f}")
    1000.6
    """
    listed = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    if not all(isinstance(each, Experiment) for each in listed):
        raise InputError("experiments", "must be a list of Experiment", "fit")
    if not any(each.fitted for each in listed):
        raise InputError("experiments", "at least one must be fitted", "fit")
    runs = Runs(**{key: shared.pop(key) for key in HOW if key in shared})
    sought = parameters if isinstance(parameters, Mapping) else {}
    specimens = open_specimens(listed, sought, fabric, shared)
    fitting = Fitting(specimens, make_unknowns(parameters, specimens), runs)
    _check_cost(fitting, starts, refined)
    place = search(fitting, starts)
    finer = fitting.finer() if refined else None
    end, coarse, remarks = place.best, None, list(_describe_starts(place))
    why = "no problem has h or dt to refine"
    if finer:
        better = refine(finer, end)
        why = better.cause
        if not why:
            fitting, end, coarse = finer, better, end
    if refined and why:
        remarks.append(f"the part of mesh and step is not known: {why}")
    if not all(each.fitted for each in listed):
        end = fitting.evaluate(end.u, only_fitted=False)
        remarks += [f"not compared: {end.cause}"] if end.cause else []
    return _summarise(fitting, end, coarse, title, remarks)


def _check_cost(fitting: Fitting, starts: int, refined: bool) -> None:
    """Print the predicted size, and refuse a fit that would take too long."""
    sizes = []
    for each in fitting.specimens:
        size = each.problem.workload(FIRST)
        cost = replace(size, steps=round(size.steps * (1 + PRICE * len(each.names))))
        sizes += EVALUATIONS * starts * [cost]
        if refined:
            sizes.append(replace(cost, triangles=4 * cost.triangles))
    check_size(sizes, fitting.runs.jobs, fitting.runs.most_seconds, "fit")


def _describe_signs(fitting: Fitting, end: Evaluation) -> Iterator[str]:
    for block, experiment, points, _ in _blocks(fitting):
        if block in end.computed and end.computed[block].values @ points.values < 0:
            column = f"{experiment.label}: {points.column}"
            yield f"{column} has the sign opposite to {points.quantity}; is its direction right?"


def _describe_starts(place: Place) -> Iterator[str]:
    if place.starts > 1:
        yield f"{place.same} of {place.starts} starts end at these constants"


def _summarise(
    fitting: Fitting, end: Evaluation, coarse: Evaluation | None, title: str, remarks: list[str]
) -> Fit:
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
