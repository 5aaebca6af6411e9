"""The runs of a stability map: a problem with each method and with steps from long to short."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from fecloth.errors import InputError, SolveFailed, amount
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.simulation.doubts.doubt import DoubtKind
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.setup import Setup
from fecloth.stability.critical_step import critical_dt
from fecloth.study.measured_runs import measure_problem
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Row, Run, Runs, announce, doubts_of, run_all
from fecloth.study.scene_source import describe_values
from fecloth.study.status import FAILED, OK
from fecloth.study.work import Work

ALL_METHODS: dict[str, Any] = {**METHODS, **EXPLICIT}
WRONG = "wrong"  # the run reached its end with energy from nowhere, or with a warning
JUDGED = (OK, WRONG, FAILED)  # any other run, as one above the time limit, says nothing
# Energy that the method made over the energy that moved: above it the run is wrong.
WRONG_ENERGY = 0.05
# Error in time of a run that is not wrong yet: a study of stability does not ask for accuracy.
MOST_TIME_ERROR = 0.25  # as a bound: an error of about 10 %
# Steps of the first runs with an implicit method: from the fewest, doubled, to the most.
FEWEST_STEPS = 8
MOST_STEPS = 256
# Steps of the first runs with an explicit method over its predicted limit.
AROUND = (2**1.5, 2**0.5, 2**-0.5, 2**-1.5)
# Of two more runs, one with r times the limit and one with 1/r: the least and the largest r.
CLOSE = (1.06, 2**0.25)
# Half the logarithm of the growth from round-off to the size of the motion, which shows an
# unstable mode: e^48 = 7e20.
GROWTH = 24.0
MOST_ROUNDS = 6  # of runs with half of the shortest step or twice the longest one
SUMS = ("pins", "numerical", "impacts", "total", "remainder")
Range = tuple[float, float]  # longest dt that holds, shortest longer one that does not [s]


def make_method(name: str) -> Any:
    """Return the method with its defaults; explicit methods may exceed their limit."""
    if name in EXPLICIT:
        return ALL_METHODS[name](beyond_limit=True)
    return ALL_METHODS[name]()


def counts_of(span: float, predicted: float | None) -> list[int]:
    """Return the numbers of steps: around a predicted limit, or from 8 to 256 without one.

    `span` is the length of the run, `predicted` the limit of the step [s]. With steps of r times
    the limit the stiffest mode grows by the factor exp(2 arcosh r) in each step. So r of the two
    runs next to the limit is as close to 1 as still shows this growth within the run.
    """
    if not predicted or math.isinf(predicted):
        doublings = round(math.log2(MOST_STEPS / FEWEST_STEPS))
        return [FEWEST_STEPS * 2**k for k in range(doublings + 1)]
    r = min(max(math.cosh(min(GROWTH * predicted / span, 1.0)), CLOSE[0]), CLOSE[1])
    parts = sorted((*AROUND, r, 1 / r), reverse=True)
    return list(dict.fromkeys(math.ceil(span / (part * predicted)) for part in parts))


def list_runs(
    problem: StudyProblem, values: Mapping[str, object], methods: Sequence[str]
) -> list[Run]:
    """Return the first runs of a problem with each method, with steps from long to short.

    `values` are the values of the varied keys, which the problem has already; they are for the
    rows and the progress lines. Raise `InputError` for an equilibrium.
    """
    if problem.is_static:
        remedy = "Give [time] in a scene, t_end to a function's problem."
        raise InputError("an equilibrium", "has no steps in time", "stability", remedy)
    problem = problem.finer(sharper=1.0)
    setup = problem.first
    runs = list[Run]()
    for name in methods:
        limit = None
        with suppress(SolveFailed):  # then the limit is not known
            limit = critical_dt(setup.system, setup.start, make_method(name))
        cells = {"method": name, **values, "predicted": limit}
        counts = counts_of(_span(setup), limit)
        runs += [_run_of(problem, cells, values, count) for count in counts]
    return runs


def _run_of(problem: StudyProblem, cells: Mapping, values: Mapping[str, object], count: int) -> Run:
    """Return the run of a problem with a method and so many steps."""
    setup = problem.first
    name = cells["method"]
    kind = "with contact" if problem.has_contact else "implicit"
    if name in EXPLICIT:
        kind = "explicit"
    words = [describe_values(values)] * bool(values) + [name, amount(count, "step")]
    return Run(
        problem,
        words=", ".join(words),
        cells={**cells, "dt": _span(setup) / count, "steps": count, "values": values},
        function=run_with,
        arguments={"method": name, "count": count, "energies": list(setup.energies)},
        own_work=Work(len(setup.cloth.triangles), count, kind),
    )


def _span(setup: Setup) -> float:
    """Return the length of the run [s]."""
    assert setup.t_end is not None
    return setup.t_end - setup.start.t


def search(runs: Sequence[Run], how: Runs) -> list[Row]:
    """Make the runs, and go on to shorter and longer steps until each method has both ends.

    Return a row for each run, with its status: "ok", "wrong", "failed", or the status of a run
    that was stopped.
    """
    announce(runs, how, stages=1 + MOST_ROUNDS)
    rows = list[Row]()
    for _ in range(1 + MOST_ROUNDS):
        rows += [judge(row) for row in run_all(runs, how)]
        runs = list_next_runs(rows, how.time_limit)
        if not runs:
            break
    return rows


def list_next_runs(rows: Sequence[Row], time_limit: float | None) -> list[Run]:
    """Return the runs with a shorter or a longer step that would tell an end of a range.

    Half of the shortest step runs if that step does not hold, unless the run would take longer
    than the time limit [CPU s]. Twice the longest step runs if that step does not fail, down to
    a single step.
    """
    rows_of = defaultdict(list)
    for row in rows:
        rows_of[row["problem"], row["method"]].append(row)
    runs = list[Run]()
    for (problem, _), own in rows_of.items():
        by_step = sorted(own, key=lambda row: row["dt"])
        shortest, longest = by_step[0], by_step[-1]
        counts = []
        seconds = 2 * shortest.get("cpu_seconds", 0.0)
        if shortest["status"] in (WRONG, FAILED) and seconds <= (time_limit or math.inf):
            counts.append(2 * shortest["steps"])
        if longest["status"] in (OK, WRONG) and longest["steps"] > 1:
            counts.append(math.ceil(longest["steps"] / 2))
        cells = {name: longest[name] for name in ("method", *longest["values"], "predicted")}
        runs += [_run_of(problem, cells, longest["values"], count) for count in counts]
    return runs


def run_with(
    problem: StudyProblem, method: str, count: int, energies: Sequence[str]
) -> dict[str, Any]:
    """Run a problem with a method, named as in a scene, and `count` equal steps.

    Return a row with the energy that the method `made`, over the energy that moved, and the
    `doubts`, size and CPU seconds of the run. `energies` are the names of its energies.
    """

    def with_method(setup: Setup) -> Setup:
        return replace(setup, steps=FixedStep(make_method(method), _span(setup) / count), probes=())

    row = measure_problem(problem, energies, change=with_method)
    columns = {name: np.array(row["columns"][name]) for name in energies if name in row["columns"]}
    kept = ("doubts", "time_error", "triangles", "newton", "cpu_seconds", "case_seconds")
    return {"made": energy_made(columns), **{name: row[name] for name in kept}}


def energy_made(energies: Mapping[str, np.ndarray]) -> float:
    """Return the largest energy that the method made, over the largest energy that moved.

    The made energy is what the total has gained since the start, without the work of loads and
    pins. Dissipated energy is not added, because its sum over large steps is too large. The
    energy that moved is the sum of the changes of all energies, and of the work. `energies` are
    the columns of a run [J]; the result is at least 0.
    """
    parts = []  # energies of the terms, and the kinetic energy
    work = energies["pins"]
    for name, values in energies.items():
        if name.startswith("work:"):
            work = work + values
        elif ":" not in name and name not in (*SUMS, "t"):
            parts.append(values)
    made_energy = energies["total"] - energies["total"][0] - work
    moved_energy = abs(work) + sum(abs(values - values[0]) for values in parts)
    largest_moved = max(moved_energy.max(), 1e-300)  # 1e-300 if nothing moved
    return max(0.0, float(made_energy.max() / largest_moved))


def judge(row: Mapping) -> Row:
    """Return the row of a run as "wrong" if it made too much energy, or warned.

    A warning that the cloth passes through itself says nothing about the steps, and one of an
    error in time below 10 % nothing about their stability.
    """
    if row["status"] != OK:
        return {**row, "cause": row["cause"].partition("\n")[0]}
    ignored = [DoubtKind.INTERSECTION]
    if row.get("time_error", math.nan) <= MOST_TIME_ERROR:
        ignored.append(DoubtKind.TIME)
    spoiling = (doubt for doubt in doubts_of(row) if doubt.kind.spoils)
    doubts = [doubt for doubt in spoiling if doubt.kind not in ignored]
    if row["made"] > WRONG_ENERGY:
        cause = f"the method made {row['made']:.2g} of the energy that moved"
        return {**row, "status": WRONG, "cause": cause}
    if doubts:
        return {**row, "status": WRONG, "cause": str(doubts[0]).partition("\n")[0]}
    return {**row}


def range_of(rows: Iterable[Mapping[str, Any]], held: tuple[str, ...] = (OK,)) -> Range:
    """Return the longest dt up to which all runs hold, and the next longer one, which does not.

    A run holds if its status is one of `held`. A run that was stopped is left out, because it
    says nothing. The first dt is 0 if the shortest step does not hold; the second is infinite if
    all steps hold. If all runs are left out, the range is 0 and infinite. Times are in s.
    """
    longest = 0.0
    for row in sorted((row for row in rows if row["status"] in JUDGED), key=lambda row: row["dt"]):
        if row["status"] not in held:
            return longest, row["dt"]
        longest = row["dt"]
    return longest, math.inf
