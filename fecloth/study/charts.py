"""`chart`: what each accuracy of a problem costs, over mesh, element, model, method and step."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fecloth import validation
from fecloth.errors import InputError
from fecloth.integrators import EXPLICIT
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, difference_of, size_of, value_of
from fecloth.study import run_problems
from fecloth.study.change import Level
from fecloth.study.chart_grid import Setting, change_names, make_settings
from fecloth.study.chart_result import Chart, bound_of, describe_chart, find_front
from fecloth.study.convergence import Convergence
from fecloth.study.opened import Opened, open_study
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.refinement import refine_problem
from fecloth.study.result import Table
from fecloth.study.status import NO_VALUE, OK, failure
from fecloth.study.workload import in_words

LONGEST_CASE = 60.0  # usual limit of the CPU time of a setting [s]
LIMIT_RATIO = 2.0  # h of a level of the limit over h of the next one
STEPS_OF_LIMIT = 200  # steps of the first level of the limit, where the scene has no dt


@dataclass(frozen=True, eq=False)
class Limit:
    """The converged limit of a quantity, to which all settings are compared.

    Attributes
    ----------
    study
        The convergence of the problem.
    quantity
        The quantity.
    finest
        What the finest level has recorded.
    """

    study: Convergence
    quantity: Quantity
    finest: RunRecord

    @property
    def size(self) -> float:
        """Size of the quantity; 0 if it has none, as at a zero."""
        return size_of(self.quantity, self.finest)

    def error(self, record: RunRecord) -> float:
        """Return the distance to the extrapolated value, or to the finest level without one."""
        if self.study.converges and math.isfinite(self.study.limit):
            return abs(value_of(self.quantity, record) - self.study.limit)
        return difference_of(self.quantity, self.finest, record)


def chart(
    problem: Scene | str | Path | Callable | Opened,
    quantity: str | Callable[[Any], float] | Quantity | None = None,
    methods: Sequence[str] | None = None,
    elements: Sequence[str] | None = None,
    models: Sequence[str] | None = None,
    *,
    meshes: int = 2,
    levels: int = 3,
    **shared: Any,
) -> Chart:
    """Run a problem with other methods, elements, models, meshes and steps, and rank them.

    The error of a setting is its distance to the limit of this very problem, from `converge`
    in h and dt; the limit has an uncertainty, below which an error means nothing. The Pareto
    front holds the settings that no other beats in both error and CPU seconds. These are
    measured after a warm-up, without compilation; of short runs the fastest of three counts.

    Each combination runs with h, h/2, … and dt, dt/2, dt/4. Explicit methods take 0.9 of their
    stable step; methods that choose their steps take three tolerances rtol. A combination that
    the problem refuses, a run that fails and a case above `time_limit` are rows with that
    status. Raises `InputError` for an unknown name, a quantity that no run in time has, or a
    problem without h and dt.

    Parameters
    ----------
    problem, quantity
        As for `of` and `converge`.
    methods, elements, models
        Names as in a scene, such as "bdf2", "P2", "NeoHookean"; by default the scene's own
        with the usual others, P1 and P2, and its own model. Of a function's problem they are
        values of its arguments `method`, `element` and `model`.
    meshes
        Number of meshes: h, h/2, …
    levels
        Levels of the limit, from 3; h and dt are halved at least twice.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
        A case whose predicted or measured time is above time_limit is left out.
    """
    study = open_study(problem, shared)
    validation.whole("meshes", meshes, 1, "chart", most=4)
    opened = study.problem
    timed_runs = replace(study.runs(LONGEST_CASE), timed=True)  # for the settings
    runs = replace(timed_runs, time_limit=None, timed=False)  # for the limit
    finest_level = Level(h=LIMIT_RATIO ** (levels - 1))
    run_problems.refuse_huge(opened, runs, finest_level)
    doubts = run_problems.print_warnings(opened)
    chosen_quantity = opened.choose_quantity(quantity)
    own_quantities = opened.quantities if quantity is None else ()
    if chosen_quantity.how == "mode":
        allowed = "has no method and no step: take converge"
        raise InputError(f"{chosen_quantity}", allowed, "chart")
    settings = make_settings(opened, methods, elements, models, meshes)
    limit = find_limit(opened, chosen_quantity, levels, runs)
    if limit is None:
        lines = [_table_row(setting, None, chosen_quantity, None) for setting in settings]
        table = Table(tuple(lines))
        verdict = "not known: the limit of this problem was not found; see `converge`"
        return Chart(title=opened.name, verdict=verdict, table=table, doubts=doubts)
    lines = []
    for setting, row in zip(settings, _run(settings, chosen_quantity, timed_runs), strict=True):
        lines.append(_table_row(setting, row, chosen_quantity, limit))
    numbers_on_front = find_front(lines)
    lines = [{**line, "on front": i in numbers_on_front} for i, line in enumerate(lines)]
    table = Table(tuple(lines))
    other_names = [other.text for other in own_quantities if other.text != chosen_quantity.text]
    return Chart(
        title=opened.name,
        doubts=doubts,
        verdict=describe_chart(table, limit.study),
        table=table,
        quantity=chosen_quantity.text,
        others=tuple(other_names),
        limit=limit.study,
        size=limit.size,
    )


def find_limit(
    opened: Problem, quantity: Quantity, levels: int, runs: run_problems.Runs
) -> Limit | None:
    """Refine the problem in all of h and dt that it has, and return the limit of the quantity.

    The problem is refined with a method of second order, which has the same limit as any other.
    Return None if the levels give no estimate of the limit. Raise `InputError` if there is
    neither h nor dt to refine.
    """
    problem = _change_for_limit(opened)
    # explicit methods take their stable step, which falls with h: "both" refines it, too
    has_stable_steps = isinstance(problem, SceneProblem) and problem.is_explicit
    has_steps = problem.can_refine("dt") or has_stable_steps
    if not problem.can_refine("h"):
        refine = "dt"
    elif has_steps and not problem.is_static:
        refine = "both"
    else:
        refine = "h"
    problem.check(refine)
    study = refine_problem(problem, quantity, refine, levels, LIMIT_RATIO, runs)
    if study.estimate is None:
        return None
    return Limit(study, quantity, run_problems.record_at(study.levels[-1], quantity))


def _change_for_limit(opened: Problem) -> Problem:
    """Return the problem with fixed steps of a method of second order.

    A problem that cannot change its method, or needs no other, is returned as it is: a
    function, an equilibrium, an explicit method with its stable step, and fixed steps of second
    order.
    """
    if not isinstance(opened, SceneProblem) or opened.is_static:
        return opened
    time = opened.scene.time
    if time.method.type in EXPLICIT and time.rtol is None:
        return opened
    if time.dt != "auto" and opened.first.steps.traits.order >= 2:
        return opened
    dt = time.dt
    if dt == "auto":  # the error chooses the steps, which cannot be halved from level to level
        dt = (time.t_end - time.t_start) / STEPS_OF_LIMIT
    names = {"method": "bdf2", "element": opened.scene.cloth.element, "model": "", "dt": dt}
    return opened.changed(change_names(opened, names))


def _run(
    settings: Sequence[Setting], quantity: Quantity, runs: run_problems.Runs
) -> list[Mapping[str, Any]]:
    """Return a row for each setting.

    A setting that was refused, or whose predicted time is above the time limit, does not run:
    its row has the reason.
    """

    def skip_long(setting: Setting) -> Setting:
        if isinstance(setting, dict):  # it was refused, and is a row already
            return setting
        if setting.size.seconds <= (runs.time_limit or math.inf):
            return setting
        cause = f"predicted: about {in_words(setting.size.seconds)}"
        return {"status": "skipped", "cause": cause}

    points_or_rows = [skip_long(setting) for setting in settings]
    if points := [item for item in points_or_rows if isinstance(item, run_problems.Point)]:
        run_problems.check_points(points, runs)
    return run_problems.run_or_skip(points_or_rows, [quantity], runs)


def _table_row(
    setting: Setting, row: Mapping | None, quantity: Quantity, limit: Limit | None
) -> dict:
    """Return the row of a setting in the table: its names, its cost and its error.

    Parameters
    ----------
    setting
        What ran, or the cells of what was refused.
    row
        The row of the run; None if nothing ran.
    limit
        The limit to which the error is the distance; None if it was not found. Then the status
        is "not run".
    """
    line: dict[str, Any] = dict(setting if isinstance(setting, dict) else setting.cells)
    if row is None or limit is None:
        return line | failure("not run", "")
    if row["status"] != OK:
        return line | failure(row["status"], row["cause"])
    line.setdefault("h", row["edge"])
    if math.isfinite(row["step"]):
        line["dt"] = float(f"{row['step']:.9g}")  # without the round-off of times
    line |= {"triangles": row["triangles"], "steps": row["steps"], "seconds": row["cpu_seconds"]}
    try:
        error = limit.error(run_problems.record_at(row, quantity))
    except InputError as refusal:  # as where a signal has no period
        return line | failure(NO_VALUE, refusal)
    line |= {"error": error, "uncertainty": limit.study.uncertainty}
    if limit.size:
        line["error %"] = 100 * error / limit.size
        line["uncertainty %"] = 100 * limit.study.uncertainty / limit.size
        line["at most %"] = bound_of(line, " %")  # as in the figure
    return {"status": OK} | line
