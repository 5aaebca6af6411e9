"""The runs of a stability map: a problem with each method and with steps from long to short."""

import math
import sys
from collections.abc import Mapping, Sequence
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
from fecloth.study.change import FIRST_LEVEL, describe_values
from fecloth.study.measured_runs import measure
from fecloth.study.problems import Problem
from fecloth.study.run_problems import Runs, Task, doubts_of, run_tasks
from fecloth.study.stability_words import WRONG
from fecloth.study.status import OK
from fecloth.study.workload import ANYWAY, Workload, check_size

ALL_METHODS: dict[str, Any] = {**METHODS, **EXPLICIT}
# Energy that the method made over the energy that moved: above it the run is wrong.
WRONG_ENERGY = 0.05
# Steps of the runs with an implicit method: from the fewest, doubled, to the most.
FEWEST_STEPS = 8
MOST_STEPS = 256
# Steps of the runs with an explicit method over its predicted limit.
AROUND = (2**1.5, 2**0.5, 2**-0.5, 2**-1.5)
# Of two more runs, one with r times the limit and one with 1/r: the least and the largest r.
CLOSE = (1.06, 2**0.25)
# Half the logarithm of the growth from round-off to the size of the motion, which shows an
# unstable mode: e^48 = 7e20.
GROWTH = 24.0
MINUTE = 60.0  # predicted time [s]: a map that takes longer says what it can do in this time
SUMS = ("pins", "numerical", "total", "remainder")


def span_of(setup: Setup) -> float:
    """Return the length of the run [s]; raise `InputError` for an equilibrium."""
    if setup.is_static or setup.t_end is None:
        remedy = "Give [time] in a scene, t_end to a function's problem."
        raise InputError("an equilibrium", "has no steps in time", "stability", remedy)
    return setup.t_end - setup.start.t


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


def list_runs(values: Mapping[str, object], problem: Problem, methods: Sequence[str]) -> list[Task]:
    """Return the runs of a problem with each method, with steps from long to short.

    `values` are the values of the varied keys, which the problem has already; they are for the
    rows and the progress lines. Raise `InputError` for an equilibrium.
    """
    problem = problem.refined(FIRST_LEVEL)
    tasks = list[Task]()
    setup = problem.first
    span = span_of(problem.first)
    for name in methods:
        limit = None
        with suppress(SolveFailed):  # then the limit is not known
            limit = critical_dt(setup.system, setup.start, make_method(name))
        for count in counts_of(span, limit):
            words = [name, amount(count, "step")]
            if values:
                words.insert(0, describe_values(values))
            cells = {"method": name, **values, "dt": span / count, "steps": count}
            task = Task(
                run_with,
                problem,
                settings={"method": name, "count": count},
                words=", ".join(words),
                size=Workload(len(setup.cloth.triangles), count, name in EXPLICIT),
                cells=cells | {"predicted": limit},
            )
            tasks.append(task)
    return tasks


def run_all(tasks: Sequence[Task], runs: Runs) -> list[dict]:
    """Run all tasks of a map, and return a row for each.

    First print the size of all runs and, if they take more than a minute, which of them take
    less. Raise `InputError` if they would take longer than `runs.most_seconds`.
    """
    offer = offer_less(tasks, runs.jobs)
    remedy = f"{offer or 'fewer methods or values'}; {ANYWAY}"
    sizes = [task.size for task in tasks]
    where = tasks[0].problem.source
    check_size(sizes, runs.jobs, runs.most_seconds, where, remedy)
    if offer:
        print(offer, file=sys.stderr, flush=True)
    rows = run_tasks(tasks, runs)
    return [_make_row(task, row) for task, row in zip(tasks, rows, strict=True)]


def offer_less(tasks: Sequence[Task], jobs: int) -> str:
    """Return in words which part of the map takes a minute at most, by the predicted times.

    That may be the fastest methods, or all methods on a coarser mesh. Return "" if the whole map
    takes a minute at most, or if no part does. `jobs` is the number of processes.
    """
    seconds_of = dict.fromkeys((task.settings["method"] for task in tasks), 0.0)
    for task in tasks:
        seconds_of[task.settings["method"]] += task.size.seconds / jobs
    if sum(seconds_of.values()) <= MINUTE:
        return ""
    fast_methods = []
    seconds = 0.0
    for method in sorted(seconds_of, key=lambda name: seconds_of[name]):
        seconds += seconds_of[method]
        if seconds <= MINUTE:
            fast_methods.append(method)
    offers = []
    if fast_methods:
        offers.append(f"the methods {', '.join(fast_methods)}")
    h = tasks[0].problem.h
    for factor in (2, 4, 8, 16):
        if h and sum(task.size.coarser(factor).seconds for task in tasks) <= MINUTE * jobs:
            offers.append(f"all methods with h = {factor * h:.3g} m")
            break
    if offers:
        return f"within a minute: {', or '.join(offers)}"
    return ""


def run_with(problem: Problem, method: str, count: int) -> dict:
    """Run a problem with a method, named as in a scene, and `count` equal steps.

    Return a row with the energy that the method `made`, over the energy that moved, the first
    `warning` or "", and the CPU seconds.
    """
    setup = problem.setup()
    steps = FixedStep(make_method(method), span_of(setup) / count)
    names = setup.energies
    row = measure(replace(setup, steps=steps, probes=()), names)
    # A warning that the cloth passes through itself says nothing about the steps.
    doubts = [doubt for doubt in doubts_of(row) if doubt.kind is not DoubtKind.INTERSECTION]
    energies = {name: np.array(row["columns"][name]) for name in names if name in row["columns"]}
    return {
        "made": energy_made(energies),
        "warning": str(doubts[0]) if doubts else "",
        "cpu_seconds": row["cpu_seconds"],
    }


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


def _make_row(task: Task, row: Mapping) -> dict:
    """Return the row of a run in the map, from its task and the row of `run_with`.

    Its status is "ok", "wrong", "failed", or the status of a case that was stopped. A run that
    reached its end is "wrong" if the method made too much energy, or if it warned.
    """
    cells = dict(task.cells)
    predicted = cells.pop("predicted")  # it is the last column
    cells["status"] = row["status"]
    cells["cause"] = str(row["cause"]).partition("\n")[0]
    if row["status"] == OK and row["made"] > WRONG_ENERGY:
        cells["status"] = WRONG
        cells["cause"] = f"the method made {row['made']:.2g} of the energy that moved"
    elif row["status"] == OK and row["warning"]:
        cells["status"] = WRONG
        cells["cause"] = row["warning"].partition("\n")[0]
    cells["energy made"] = row.get("made")
    cells["cpu_seconds"] = row.get("cpu_seconds")
    cells["predicted"] = predicted
    return cells
