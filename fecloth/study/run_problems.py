"""Run problems, each on a level, for quantities of interest: the engine of all such studies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.simulation.quantity import Quantity
from fecloth.study import status
from fecloth.study.cases import run_cases
from fecloth.study.levels import FIRST, Level
from fecloth.study.measured_runs import columns_to_record, measure
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.progress import Progress
from fecloth.study.workload import LONGEST, Workload, check_size


@dataclass(frozen=True)
class Runs:
    """How the cases of a study run."""

    # Folder whose `cache` stores each finished case, for the next time; None for none.
    cache: str | Path | None = None
    # Processes of this machine, or the address of a Dask scheduler.
    jobs: int = 1
    scheduler: str | None = None
    time_limit: float | None = None  # longest time of a case [s]
    # Predicted time above which the study does not start [s]; None for no limit.
    most_seconds: float | None = LONGEST
    fresh: bool = False  # run every case, even if its result is stored
    timed: bool = False  # measure CPU seconds that can be compared, see `measure`
    quiet: bool = False  # print neither the size of all cases nor a line for each

    def __post_init__(self):
        if not (isinstance(self.jobs, int) and self.jobs >= 1):
            raise InputError(f"jobs = {self.jobs!r}", "must be an integer of at least 1")


@dataclass(frozen=True, eq=False)
class Point:
    """A problem on a level, in words for the progress lines, and its predicted size."""

    problem: Problem
    level: Level
    words: str
    size: Workload


def refuse_huge(opened: Problem, runs: Runs, level: Level = FIRST) -> None:
    """Refuse a scene that would take too long, before its mesh is made."""
    if isinstance(opened, SceneProblem) and runs.most_seconds is not None:
        size = opened.workload(level)
        if size.seconds > runs.most_seconds:
            check_size([size], 1, runs.most_seconds, opened.name)  # says how long, and raises


def run_points(points: Sequence[Point], quantities: Sequence[Quantity], runs: Runs) -> list[dict]:
    """Return a row for each point, with its `point`; first check and print the size of all.

    A function that other processes cannot import, and a function as quantity, run in this process
    and are not stored.
    """
    functions = [one.function for one in quantities if one.function]
    if len(functions) > 1:
        raise InputError(f"{len(functions)} functions as quantities", "must be at most 1", "study")
    needed = (*quantities, *points[0].problem.interest)  # so studies of others of them share cases
    recorded = sorted({name for one in needed for name in columns_to_record(one)})
    modes = max((one.mode for one in quantities), default=0)
    if not runs.quiet:
        check_size([p.size for p in points], runs.jobs, runs.most_seconds, points[0].problem.name)
    if functions or not all(point.problem.is_importable for point in points):
        function = functions[0] if functions else None
        rows = run_here(
            points, lambda one: _measure(one, recorded, modes, function, runs), runs.quiet
        )
    else:
        more = {"timed": True} if runs.timed else {}
        cases = [point.problem.case(point.level, recorded, modes) | more for point in points]
        rows = run_cases(
            cases,
            points[0].problem.runner,
            runs.cache,
            runs.jobs,
            runs.scheduler,
            runs.time_limit,
            runs.fresh,
            label=lambda settings: points[cases.index(dict(settings))].words,
            costs=[point.size.seconds for point in points],
            quiet=runs.quiet,
        )
    return [{**row, "point": point} for row, point in zip(rows, points, strict=True)]


def run_here(listed: Sequence[Any], run: Callable[[Any], dict], quiet: bool = False) -> list[dict]:
    """Run what has `words` and a `size`, in this process, with progress lines unless `quiet`."""
    costs, rows = [one.size.seconds for one in listed], list[dict]()
    progress = Progress(costs, in_seconds=True, quiet=quiet)
    for one, cost in zip(listed, costs, strict=True):
        rows.append(run(one))
        progress.print(one.words, rows[-1], cost)
    return rows


def _measure(
    point: Point, recorded: list[str], modes: int, function: Callable | None, runs: Runs
) -> dict:
    def run() -> dict:
        setup = point.problem.setup(point.level)
        return measure(setup, recorded, modes, function, timed=runs.timed)

    return status.attempt(run, {}, runs.time_limit)
