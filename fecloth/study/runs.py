"""Run problems, each on a level, for quantities of interest: the engine of all such studies."""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.study import status
from fecloth.study.cases import Progress, run_cases
from fecloth.study.change import FIRST_LEVEL, Level
from fecloth.study.measured_runs import REPEATS, columns_to_record, measure_problem, record_of
from fecloth.study.problems import FunctionProblem, Problem, SceneProblem
from fecloth.study.workload import LONGEST, Workload, check_size
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True)
class Runs:
    """How the cases of a study run.

    Attributes
    ----------
    cache
        Folder whose `cache` stores each finished case for the next time; None for none.
    jobs
        Number of processes of this machine.
    scheduler
        Address of a Dask scheduler that runs the cases in place of this machine.
    time_limit
        Longest CPU time of a case [s]; None for no limit.
    most_seconds
        Predicted time above which the study does not start [s]; None for no limit.
    fresh
        Whether every case runs, even if its result is stored.
    timed
        Whether CPU seconds are measured so that they can be compared; see `measure`.
    repeats
        Number of runs at most to measure them.
    quiet
        Whether no line is printed for a case.
    """

    cache: str | Path | None = None
    jobs: int = 1
    scheduler: str | None = None
    time_limit: float | None = None
    most_seconds: float | None = LONGEST
    fresh: bool = False
    timed: bool = False
    repeats: int = REPEATS
    quiet: bool = False

    def __post_init__(self):
        if not (isinstance(self.jobs, int) and self.jobs >= 1):
            raise InputError(f"jobs = {self.jobs!r}", "must be an integer of at least 1")
        if self.time_limit is not None:
            validation.number("time_limit", self.time_limit, 0.0, "", infinite=True)
        if self.most_seconds is not None:
            validation.number("most_seconds", self.most_seconds, 0.0, "", infinite=True)


@dataclass(frozen=True, eq=False)
class Point:
    """A problem on a level, to run.

    Attributes
    ----------
    problem
        The problem on its first level.
    level
        How it is refined.
    words
        What the progress line says.
    size
        Predicted size of the run.
    most
        Longest CPU time of the run [s]; None for no limit.
    cells
        Cells of a row that the caller needs again.
    disturbed
        Seed of a disturbance of the start; None for none.
    """

    problem: Problem
    level: Level
    words: str
    size: Workload
    most: float | None = None
    cells: Mapping[str, Any] = field(default_factory=dict)
    disturbed: int | None = None

    @cached_property
    def refined(self) -> Problem:
        """The problem on the level: what runs."""
        return self.problem.refined(self.level)


def check_points(points: Sequence[Point], runs: Runs) -> None:
    """Print the size of all points, and raise `InputError` if they take too long."""
    sizes = [point.size for point in points]
    check_size(sizes, runs.jobs, runs.most_seconds, points[0].problem.source)


def run_or_skip(
    points_or_rows: Sequence[Point | Mapping], quantities: Sequence[Quantity], runs: Runs
) -> list[Mapping]:
    """Return a row for each item of the list: the row of a point that runs, or the row itself.

    A row (a mapping) in the list is of what does not run, such as a setting that was refused.
    """
    points = [item for item in points_or_rows if isinstance(item, Point)]
    new_rows = iter(run_points(points, quantities, runs)) if points else iter(())
    return [next(new_rows) if isinstance(item, Point) else item for item in points_or_rows]


def refuse_huge(opened: Problem, runs: Runs, level: Level = FIRST_LEVEL) -> None:
    """Raise `InputError` for a scene that would take too long, before its mesh is made."""
    if isinstance(opened, SceneProblem) and runs.most_seconds is not None:
        size = opened.workload(level)
        if size.seconds > runs.most_seconds:
            check_size([size], 1, runs.most_seconds, opened.source)  # says how long, and raises


def print_warnings(opened: Problem) -> tuple[Doubt, ...]:
    """Print and return the doubts about the set-up, which the runs of a study do not repeat."""
    for doubt in opened.doubts:
        print(f"warning: {doubt}", file=sys.stderr, flush=True)
    return opened.doubts


def run_points(points: Sequence[Point], quantities: Sequence[Quantity], runs: Runs) -> list[dict]:
    """Run the points, and return the row of `measure_problem` for each, with its `point`.

    The row has all that the quantities are computed from, see `record_at`. A run with a doubt
    that spoils it counts as failed: it is no evidence. Raise `InputError` for several functions
    as quantities.
    """
    functions = [quantity.function for quantity in quantities if quantity.function]
    if len(functions) > 1:
        what = f"{len(functions)} functions as quantities"
        raise InputError(what, "must be at most 1", "study")
    # With all quantities of interest, studies of other quantities find the same stored cases.
    needed_quantities = (*quantities, *points[0].problem.interest)
    recorded = {name for quantity in needed_quantities for name in columns_to_record(quantity)}
    modes = max((quantity.mode for quantity in quantities), default=0)
    common_settings: dict[str, Any] = {"recorded": sorted(recorded), "modes": modes}
    if functions:
        common_settings["function"] = functions[0]
    tasks = []
    for point in points:
        settings = common_settings | _timing(point, runs)
        task = Task(measure_problem, point.refined, settings, words=point.words, size=point.size)
        tasks.append(task)
    rows = run_tasks(tasks, runs)
    return [judged(row) | {"point": point} for row, point in zip(rows, points, strict=True)]


def judged(row: Mapping) -> dict:
    """Return a row, as failed if its run has a doubt that spoils it as evidence."""
    if row["status"] == status.OK:
        for doubt in doubts_of(row):
            if doubt.kind.spoils:
                return {**row, **status.failure(status.FAILED, doubt)}
    return {**row}


def doubts_of(row: Mapping) -> list[Doubt]:
    """Return the doubts of the run of a row."""
    return [Doubt.of_entry(entry) for entry in row.get("doubts", ())]


def _timing(point: Point, runs: Runs) -> dict:
    """Return the arguments of `measure_problem` on time and disturbance, without defaults.

    The arguments are a part of the key under which a result is stored. With defaults among them
    the key would be another one, and earlier results of the same run would not be found.
    """
    arguments: dict = {}
    if runs.timed:
        arguments |= {"timed": True, "repeats": runs.repeats}
    if point.most is not None:
        arguments["most"] = point.most
    if point.disturbed is not None:
        arguments["disturbed"] = point.disturbed
    return arguments


@dataclass(frozen=True, eq=False)
class Task:
    """A function of a problem, to run.

    Attributes
    ----------
    function
        A function of the problem and the settings, at the top of a module.
    problem
        Its first argument.
    settings
        Its other arguments.
    words
        What the progress line says.
    size
        Predicted size of the run.
    cells
        Cells of a row that the caller needs again.
    """

    function: Callable[..., dict]
    problem: Problem
    settings: Mapping[str, Any]
    words: str
    size: Workload
    cells: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def case(self) -> dict | None:
        """The arguments of `run_task`, as JSON values.

        It is None for a task that only this process can run, because its settings are no JSON
        values, or because other processes cannot import the function of its problem.
        """
        try:
            json.dumps(self.settings)
        except TypeError:  # such as a user's function as quantity
            return None
        if not self.problem.is_importable:
            return None
        name = f"{self.function.__module__}:{self.function.__name__}"
        return {"task": name, "problem": self.problem.case(), "settings": dict(self.settings)}


def run_task(task: str, problem: dict, settings: dict) -> dict:
    """Run a task in any process, and return its row.

    `task` names the function as "module:function", `problem` is the case of the problem.
    """
    problem_class = SceneProblem if "tables" in problem else FunctionProblem
    return resolve_name(task)(problem_class.of_case(**problem), **settings)


def run_tasks(tasks: Sequence[Task], runs: Runs) -> list[dict]:
    """Run the tasks, and return their rows in the same order.

    A task that any process can run is a case, whose result is stored; see `run_cases`. A task
    that only this process can run is run here, and its result is not stored.
    """
    tasks_for_any_process = [task for task in tasks if task.case is not None]
    tasks_for_this_process = [task for task in tasks if task.case is None]
    rows: dict[Task, dict] = {}
    if tasks_for_any_process:
        new_rows = _run_as_cases(tasks_for_any_process, runs)
        rows |= zip(tasks_for_any_process, new_rows, strict=True)
    if tasks_for_this_process:
        new_rows = _run_here(tasks_for_this_process, runs)
        rows |= zip(tasks_for_this_process, new_rows, strict=True)
    return [rows[task] for task in tasks]


def _run_as_cases(tasks: Sequence[Task], runs: Runs) -> list[dict]:
    """Run tasks that any process can run, and return their rows; see `run_cases`.

    Results are stored in the cache of `runs`, if there is one, and read from there.
    """
    cases: list[Any] = [task.case for task in tasks]
    return run_cases(
        cases,
        run_task,
        out=runs.cache,
        jobs=runs.jobs,
        scheduler=runs.scheduler,
        time_limit=runs.time_limit,
        fresh=runs.fresh,
        label=lambda settings: tasks[cases.index(dict(settings))].words,
        costs=[task.size.seconds for task in tasks],
        quiet=runs.quiet,
    )


def _run_here(tasks: Sequence[Task], runs: Runs) -> list[dict]:
    """Run tasks one after the other in this process, and return their rows.

    A task that fails has a row with its status and cause. Progress lines are printed.
    """
    costs = [task.size.seconds for task in tasks]
    rows = list[dict]()
    progress = Progress(costs, in_seconds=True, quiet=runs.quiet)
    for task, cost in zip(tasks, costs, strict=True):
        arguments = {"problem": task.problem, **task.settings}
        rows.append(status.attempt(task.function, arguments, runs.time_limit))
        progress.print(task.words, rows[-1], cost)
    return rows


def end_of(row: Mapping) -> tuple[System, State]:
    """Return the system and the last state of a run from its row of `run_points`."""
    setup = row["point"].problem.first
    x = setup.start.x + np.array(row["displacement"])
    v = np.array(row["velocity"])
    return setup.system, State(row["times"][-1], x, v)


def record_at(row: Mapping, quantity: Quantity) -> RunRecord:
    """Return what a quantity is computed from, out of a row of `run_points`."""
    problem = row["point"].refined
    return record_of(row, quantity, problem.cloth_for(quantity), problem.probes)
