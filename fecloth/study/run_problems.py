"""Run problems, each on a level, for quantities of interest: the engine of all such studies."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.simulation.energy_balance import DISTRUST
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.study import status
from fecloth.study.cases import Progress, run_cases
from fecloth.study.change import FIRST, Level
from fecloth.study.measured_runs import REPEATS, columns_to_record, measure, record_of
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.workload import LONGEST, Workload, check_size
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True)
class Runs:
    """How the cases of a study run."""

    # Folder whose `cache` stores each finished case, for the next time; None for none.
    cache: str | Path | None = None
    # Processes of this machine, or the address of a Dask scheduler.
    jobs: int = 1
    scheduler: str | None = None
    time_limit: float | None = None  # longest CPU time of a case [s]
    # Predicted time above which the study does not start [s]; None for no limit.
    most_seconds: float | None = LONGEST
    fresh: bool = False  # run every case, even if its result is stored
    # Measure CPU seconds that can be compared, by up to this many repeated runs; see `measure`.
    timed: bool = False
    repeats: int = REPEATS
    quiet: bool = False  # print no line for each case

    def __post_init__(self):
        if not (isinstance(self.jobs, int) and self.jobs >= 1):
            raise InputError(f"jobs = {self.jobs!r}", "must be an integer of at least 1")
        for name, seconds in (("time_limit", self.time_limit), ("most_seconds", self.most_seconds)):
            if seconds is not None:
                validation.number(name, seconds, 0.0, "", infinite=True)


@dataclass(frozen=True, eq=False)
class Point:
    """A problem on a level, in words for the progress lines, and its predicted size."""

    problem: Problem
    level: Level
    words: str
    size: Workload
    most: float | None = None  # longest CPU time of the run [s]

    @cached_property
    def refined(self) -> Problem:
        """The problem on the level: what runs."""
        return self.problem.refined(self.level)


def check_points(points: Sequence[Point], runs: Runs) -> None:
    """Print the size of all, and refuse what takes too long."""
    sizes = [point.size for point in points]
    check_size(sizes, runs.jobs, runs.most_seconds, points[0].problem.source)


def run_or_skip(
    listed: Sequence[Point | Mapping], quantities: Sequence[Quantity], runs: Runs
) -> list[Mapping]:
    """Return a row for each point; what is a row already, of one that does not run, stays."""
    points = [point for point in listed if isinstance(point, Point)]
    rows = iter(run_points(points, quantities, runs) if points else ())
    return [next(rows) if isinstance(item, Point) else item for item in listed]


def refuse_huge(opened: Problem, runs: Runs, level: Level = FIRST) -> None:
    """Refuse a scene that would take too long, before its mesh is made."""
    if isinstance(opened, SceneProblem) and runs.most_seconds is not None:
        size = opened.workload(level)
        if size.seconds > runs.most_seconds:
            check_size([size], 1, runs.most_seconds, opened.source)  # says how long, and raises


def print_warnings(opened: Problem) -> tuple[str, ...]:
    """Print and return the warnings of the set-up, which the runs of a study do not repeat."""
    for words in opened.warnings:
        print(f"warning: {words}", file=sys.stderr, flush=True)
    return opened.warnings


def run_points(points: Sequence[Point], quantities: Sequence[Quantity], runs: Runs) -> list[dict]:
    """Return a row for each point, with its `point`."""
    # A run that warns not to trust its motion has failed: it is no evidence. A function that other
    # processes cannot import, and a function as quantity, run in this process and are not stored.
    functions = [quantity.function for quantity in quantities if quantity.function]
    if len(functions) > 1:
        raise InputError(f"{len(functions)} functions as quantities", "must be at most 1", "study")
    first = points[0].problem
    needed = (*quantities, *first.interest)  # so studies of others of them share cases
    recorded = sorted({name for quantity in needed for name in columns_to_record(quantity)})
    modes = max((quantity.mode for quantity in quantities), default=0)
    asked = {"recorded": recorded, "modes": modes}
    if functions or not all(point.problem.is_importable for point in points):
        asked |= {"function": functions[0]} if functions else {}

        def run(point: Point) -> dict:
            settings = {"point": point, **asked, **_timing(point, runs)}
            return status.attempt(_measure, settings, runs.time_limit)

        rows = run_here(points, run, runs.quiet)
    else:
        cases = [point.refined.case() | asked | _timing(point, runs) for point in points]
        rows = run_stored(points, cases, first.runner, runs)
    return [judged(row) | {"point": point} for row, point in zip(rows, points, strict=True)]


def judged(row: Mapping) -> dict:
    """Return a row, as failed if its run warns not to trust its motion."""
    doubts = (words for words in row.get("warnings", ()) if DISTRUST in words)
    cause = next(doubts, "") if row["status"] == status.OK else ""
    return {**row, **status.failure(status.FAILED, cause)} if cause else {**row}


def _timing(point: Point, runs: Runs) -> dict:
    """Return the arguments of `measure` on the time of a run, without defaults."""
    timing: dict = {"timed": True, "repeats": runs.repeats} if runs.timed else {}
    return timing | ({"most": point.most} if point.most is not None else {})


def _measure(point: Point, **asked: Any) -> dict:
    return measure(point.refined.setup(), **asked)


def run_stored(
    listed: Sequence[Any], cases: Sequence[dict], runner: Callable[..., dict], runs: Runs
) -> list[dict]:
    """Return the rows of cases, from the store or run; what is listed has `words` and a `size`."""
    return run_cases(
        cases,
        runner,
        runs.cache,
        runs.jobs,
        runs.scheduler,
        runs.time_limit,
        runs.fresh,
        label=lambda settings: listed[cases.index(dict(settings))].words,
        costs=[item.size.seconds for item in listed],
        quiet=runs.quiet,
    )


def run_here(listed: Sequence[Any], run: Callable[[Any], dict], quiet: bool = False) -> list[dict]:
    """Run what has `words` and a `size`, in this process, with progress lines unless `quiet`."""
    costs, rows = [item.size.seconds for item in listed], list[dict]()
    progress = Progress(costs, in_seconds=True, quiet=quiet)
    for item, cost in zip(listed, costs, strict=True):
        rows.append(run(item))
        progress.print(item.words, rows[-1], cost)
    return rows


def end_of(row: Mapping) -> tuple[System, State]:
    """Return the system and the last state of a run, of a row of `run_points`."""
    setup = row["point"].problem.first
    moved, v = np.array(row["displacement"]), np.array(row["velocity"])
    return setup.system, State(row["times"][-1], setup.start.x + moved, v)


def record_at(row: Mapping, quantity: Quantity) -> RunRecord:
    """Return what a quantity is computed from, of a row of `run_points`."""
    problem = row["point"].refined
    return record_of(row, quantity, problem.cloth_for(quantity), problem.probes)
