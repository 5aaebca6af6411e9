"""One engine for all studies: run problems and functions of problems, and return a row of each."""

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, amount
from fecloth.simulation.doubts.doubt import NOTE, Doubt, DoubtKind
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.study import status
from fecloth.study.cases import Progress, run_cases
from fecloth.study.coarser_start import needs_the_way
from fecloth.study.measured_runs import REPEATS, columns_to_record, measure_problem, record_of
from fecloth.study.problem import StudyProblem
from fecloth.study.work import ANYWAY, LONGEST, Work, in_magnitude, start_seconds
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
        Time above which the study does not start, or go on, by itself [s]; None for no limit.
        Before the first case it is compared with an order of magnitude, after it with what the
        first cases took.
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
class Run:
    """What runs: a problem, or a function of it, and what the table says of it.

    Attributes
    ----------
    problem
        The problem.
    words
        What the progress line says.
    cells
        Cells of the row that do not come from the run, as its settings.
    function
        A function of the problem and the arguments, at the top of a module; it returns cells.
    arguments
        Its other arguments.
    own_work
        The estimated size of the run, where it is not the size of its problem.
    follows
        Whether it starts from the solution of the run before it in the list, on a coarser mesh.
    halves
        Whether it repeats the steps of the run before it in the list, each halved.
    """

    problem: StudyProblem
    words: str
    cells: Mapping[str, Any] = field(default_factory=dict)
    function: Callable[..., dict] = measure_problem
    arguments: Mapping[str, Any] = field(default_factory=dict)
    own_work: Work | None = None
    follows: bool = False
    halves: bool = False

    @cached_property
    def case(self) -> dict | None:
        """The arguments of `run_case_of_problem`, as JSON values.

        It is None for a run that only this process can make, because its arguments, or those of
        its problem, are no JSON values, or because other processes cannot import the function of
        its problem.
        """
        if not self.problem.source.is_importable:
            return None
        name = f"{self.function.__module__}:{self.function.__name__}"
        try:
            json.dumps(self.arguments)
            problem = self.problem.case()
        except TypeError:  # such as a user's function as quantity
            return None
        return {"run": name, "problem": problem, "arguments": dict(self.arguments)}

    @property
    def work(self) -> Work:
        """The estimated size of the run."""
        return self.own_work or self.problem.work

    @property
    def seconds(self) -> float:
        """The estimated time [s], see `Work.seconds`."""
        return self.work.seconds


Row = dict[str, Any]


def run_quantities(
    runs: Sequence[Run | Mapping],
    quantities: Sequence[Quantity],
    how: Runs,
) -> list[Row]:
    """Run problems for quantities, and return the row of `measure_problem` for each.

    A row has the `cells` of its run, its `problem`, and all that the quantities are computed
    from, see `record_at`. A mapping among the runs is the row of what does not run, such as a
    setting that was refused: it is returned as it is. A run whose energy balance is off counts as
    failed: see `judged`.

    Raise `InputError` for several functions as quantities.
    """
    functions = [quantity.function for quantity in quantities if quantity.function]
    if len(functions) > 1:
        what = f"{len(functions)} functions as quantities"
        raise InputError(what, "must be at most 1", "study")
    to_run = [run for run in runs if isinstance(run, Run)]
    if not to_run:
        return [dict(row) for row in runs if isinstance(row, Mapping)]
    # With all quantities of interest, studies of other quantities find the same stored cases.
    needed_quantities = (*quantities, *to_run[0].problem.source.interest)
    recorded = {name for quantity in needed_quantities for name in columns_to_record(quantity)}
    modes = max((quantity.mode for quantity in quantities), default=0)
    common: dict[str, Any] = {"recorded": sorted(recorded), "modes": modes}
    if functions:
        common["function"] = functions[0]
    if how.timed:
        common |= {"timed": True, "repeats": how.repeats}
    is_of_end = not any(needs_the_way(quantity) for quantity in needed_quantities)
    measuring = [
        replace(run, arguments={**common, **run.arguments}, follows=run.follows and is_of_end)
        for run in to_run
    ]
    rows = iter(run_all(measuring, how))
    return [judged(next(rows)) if isinstance(run, Run) else dict(run) for run in runs]


def judged(row: Mapping) -> Row:
    """Return a row, as failed if the energy of its run is not explained: it is no evidence."""
    if row["status"] == status.OK:
        for doubt in doubts_of(row):
            if doubt.kind is DoubtKind.MOTION:
                return {**row, **status.failure(status.FAILED, doubt)}
    return {**row}


def doubts_of(row: Mapping) -> list[Doubt]:
    """Return the doubts of the run of a row."""
    return [Doubt.of_entry(entry) for entry in row.get("doubts", ())]


def run_case_of_problem(run: str, problem: dict, arguments: dict) -> dict:
    """Make a run in any process, and return what its function returns.

    `run` names the function as "module:function", `problem` is the case of the problem.
    """
    return resolve_name(run)(StudyProblem.of_case(**problem), **arguments)


def run_all(runs: Sequence[Run], how: Runs) -> list[Row]:
    """Make the runs, and return their rows in the same order, each with its cells and problem.

    Runs that follow others wait for them; all others run first, side by side.
    """
    costs = [run.seconds for run in runs]
    progress = Progress(costs, most_seconds=how.most_seconds, quiet=how.quiet)
    results: list[dict] = [{} for _ in runs]
    waiting = list(range(len(runs)))
    while waiting:
        ready = [i for i in waiting if not (_needs_the_run_before(runs[i]) and i - 1 in waiting)]
        wave = [_begin_at(runs[i], runs[i - 1], results[i - 1]) for i in ready]
        for i, result in zip(ready, _run_side_by_side(wave, how, progress), strict=True):
            results[i] = result
        waiting = [i for i in waiting if i not in ready]
    progress.tell_stored()
    pairs = zip(runs, results, strict=True)
    return [{**run.cells, **result, "problem": run.problem} for run, result in pairs]


def _needs_the_run_before(run: Run) -> bool:
    """Return whether a run takes the solution or the steps of the run before it."""
    return run.follows or run.halves


def _begin_at(run: Run, coarser: Run, result: Mapping) -> Run:
    """Return a run with what it takes of the run before it: its solution, or its steps."""
    if not _needs_the_run_before(run) or result["status"] != status.OK:
        return run
    if run.halves:
        steps = {"method": result["method_of_steps"], "sizes": result["sizes"]}
        return replace(run, arguments={**run.arguments, "halved": steps})
    problem: Any = coarser.problem
    if coarser.case is not None:
        problem = problem.case()
    start = {"problem": problem, "displacement": result["displacement"]}
    return replace(run, arguments={**run.arguments, "coarser": start})


def _run_side_by_side(runs: Sequence[Run], how: Runs, progress: Progress) -> list[dict]:
    """Make runs that wait for no other, and return their results.

    A run that any process can make is a case, whose result is stored; see `run_cases`. A run that
    only this process can make is made here, and its result is not stored.
    """
    for_any_process = [run for run in runs if run.case is not None]
    for_this_process = [run for run in runs if run.case is None]
    results: dict[Run, dict] = {}
    if for_any_process:
        made = _run_as_cases(for_any_process, how, progress)
        results |= zip(for_any_process, made, strict=True)
    if for_this_process:
        made = _run_here(for_this_process, how, progress)
        results |= zip(for_this_process, made, strict=True)
    return [results[run] for run in runs]


def _run_as_cases(runs: Sequence[Run], how: Runs, progress: Progress) -> list[dict]:
    """Make runs that any process can make, and return their results; see `run_cases`.

    Results are stored in the cache of `how`, if there is one, and read from there.
    """
    cases: list[Any] = [run.case for run in runs]
    return run_cases(
        cases,
        run_case_of_problem,
        out=how.cache,
        jobs=how.jobs,
        scheduler=how.scheduler,
        time_limit=how.time_limit,
        fresh=how.fresh,
        label=lambda settings: runs[cases.index(dict(settings))].words,
        costs=[run.seconds for run in runs],
        progress=progress,
    )


def _run_here(runs: Sequence[Run], how: Runs, progress: Progress) -> list[dict]:
    """Make runs one after the other in this process, and return their results.

    A run that fails has a result with its status and cause. Progress lines are printed.
    """
    results = list[dict]()
    for run in runs:
        arguments = {"problem": run.problem, **run.arguments}
        results.append(status.attempt(run.function, arguments, how.time_limit))
        progress.print(run.words, results[-1], run.seconds)
    return results


def announce(runs: Iterable[Run | Mapping], how: Runs, stages: int = 1) -> None:
    """Print the size of a study before its first case, and refuse one that takes far too long.

    The line has the number of cases, of triangles and of steps, the number of `stages` that the
    study has at most (0 for a further stage, which is called so), and the order of magnitude of
    the time, with start, meshing and compilation. Raise `InputError` if that is above
    `how.most_seconds`.
    """
    to_run = [run for run in runs if isinstance(run, Run)]
    if not to_run:
        return
    at_once = 1 if how.scheduler else how.jobs
    seconds = start_seconds() + sum(run.seconds for run in to_run) / at_once
    largest = max(to_run, key=lambda run: run.work.triangles).work
    most_steps = max(run.work.steps for run in to_run)
    count = amount(len(to_run), "case")
    if stages > 1:
        count = f"at most {amount(stages, 'stage')}, the first of {count}"
    elif not stages:
        count = f"next stage: {count}"
    size = f"{count}, up to {largest.triangles:,.0f} triangles × {most_steps:,.0f} {largest.unit}"
    print(f"{size}; it may take {in_magnitude(seconds)}", file=sys.stderr, flush=True)
    if how.most_seconds is not None and seconds > how.most_seconds:
        allowed = f"may take {in_magnitude(seconds)}: above {how.most_seconds:,.0f} s"
        advice = f"Check the size of the cloth, h and dt; {ANYWAY}"
        raise InputError(size, allowed, to_run[0].problem.where, advice)


def refuse_huge(problem: StudyProblem, how: Runs) -> None:
    """Raise `InputError` for a problem that would take far too long, before its mesh is made."""
    if how.most_seconds is not None and problem.work.seconds > how.most_seconds:
        announce([Run(problem, "")], how)  # says how long, and raises


def print_doubts(problem: StudyProblem) -> tuple[Doubt, ...]:
    """Print and return the doubts about the set-up, which the runs of a study do not repeat."""
    for doubt in problem.doubts:
        if doubt.kind.label != NOTE:
            print(doubt.line, file=sys.stderr, flush=True)
    return problem.doubts


def end_of(row: Mapping) -> tuple[System, State]:
    """Return the system and the last state of a run from its row."""
    setup = row["problem"].first
    x = setup.start.x + np.array(row["displacement"])
    v = np.array(row["velocity"])
    return setup.system, State(row["times"][-1], x, v)


def record_at(row: Mapping, quantity: Quantity) -> RunRecord:
    """Return what a quantity is computed from, out of a row of `run_quantities`."""
    problem = row["problem"]
    return record_of(row, quantity, problem.cloth_for(quantity), problem.source.probes)
