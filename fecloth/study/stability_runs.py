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
from fecloth.study.change import FIRST, describe_values
from fecloth.study.measured_runs import measure
from fecloth.study.problems import Problem
from fecloth.study.run_problems import Runs, Task, doubts_of, run_tasks
from fecloth.study.stability_words import WRONG
from fecloth.study.status import OK
from fecloth.study.workload import ANYWAY, Workload, check_size

ALL_METHODS: dict[str, Any] = {**METHODS, **EXPLICIT}
ENERGY = 0.05  # energy made by the method, relative to the energy that moved
COUNTS = (8, 16, 32, 64, 128, 256)  # steps of a run with an implicit method
AROUND = (2**1.5, 2**0.5, 2**-0.5, 2**-1.5)  # times the predicted limit: explicit methods
CLOSE = (1.06, 2**0.25)  # times the predicted limit and over it: least and most of two more runs
GROWTH = 24.0  # half the logarithm of the growth that shows an unstable mode, from round-off
MINUTE = 60.0  # s; a map that takes longer says what it can do in this time
SUMS = ("pins", "numerical", "total", "remainder")


def span_of(setup: Setup) -> float:
    if setup.is_static or setup.t_end is None:
        remedy = "Give [time] in a scene, t_end to a function's problem."
        raise InputError("an equilibrium", "has no steps in time", "stability", remedy)
    return setup.t_end - setup.start.t


def make_method(name: str):
    """Return the method with its defaults; explicit methods may exceed their limit."""
    if name in EXPLICIT:
        return ALL_METHODS[name](beyond_limit=True)
    return ALL_METHODS[name]()


def counts_of(span: float, predicted: float | None) -> list[int]:
    """Return the numbers of steps: around a predicted limit, or from 8 to 256 without one.

    With steps of r limits the stiffest mode grows by exp(2 arcosh r) in each step: the two runs
    next to the limit are so close to it that this is seen within the run.
    """
    if not predicted or math.isinf(predicted):
        return list(COUNTS)
    r = min(max(math.cosh(min(GROWTH * predicted / span, 1.0)), CLOSE[0]), CLOSE[1])
    parts = sorted((*AROUND, r, 1 / r), reverse=True)
    return list(dict.fromkeys(math.ceil(span / (part * predicted)) for part in parts))


def list_runs(values: Mapping[str, object], problem: Problem, methods: Sequence[str]) -> list[Task]:
    """Return the runs of a problem, with these values of its keys, by each method."""
    problem = problem.refined(FIRST)
    listed = list[Task]()
    setup = problem.first
    span = span_of(problem.first)
    for name in methods:
        limit = None
        with suppress(SolveFailed):  # then it is not known
            limit = critical_dt(setup.system, setup.start, make_method(name))
        for count in counts_of(span, limit):
            words = filter(None, (describe_values(values), name, amount(count, "step")))
            size = Workload(len(setup.cloth.triangles), count, name in EXPLICIT)
            cells = {"method": name, **values, "dt": span / count, "steps": count}
            run = problem, {"method": name, "count": count}, ", ".join(words), size
            listed.append(Task(run_with, *run, cells | {"predicted": limit}))
    return listed


def run_all(listed: Sequence[Task], runs: Runs) -> list[dict]:
    """Return a row for each run; first print the size of all."""
    less = offer_less(listed, runs.jobs)
    remedy = f"{less or 'fewer methods or values'}; {ANYWAY}"
    sizes = [run.size for run in listed]
    where = listed[0].problem.source
    check_size(sizes, runs.jobs, runs.most_seconds, where, remedy)
    if less:
        print(less, file=sys.stderr, flush=True)
    return [_row(*pair) for pair in zip(listed, run_tasks(listed, runs), strict=True)]


def offer_less(listed: Sequence[Task], jobs: int) -> str:
    """Return which methods, or which h, take a minute; "" where all take no longer."""
    costs = dict.fromkeys((run.settings["method"] for run in listed), 0.0)
    for run in listed:
        costs[run.settings["method"]] += run.size.seconds / jobs
    if sum(costs.values()) <= MINUTE:
        return ""
    costs = dict(sorted(costs.items(), key=lambda cost: cost[1]))
    fitting = [m for m, s in zip(costs, np.cumsum([*costs.values()]), strict=True) if s <= MINUTE]
    ways = [f"the methods {', '.join(fitting)}"] if fitting else []
    h = listed[0].problem.h
    for k in (2, 4, 8, 16):
        if h and sum(run.size.coarser(k).seconds for run in listed) <= MINUTE * jobs:
            ways.append(f"all methods with h = {k * h:.3g} m")
            break
    if ways:
        return f"within a minute: {', or '.join(ways)}"
    return ""


def run_with(problem: Problem, method: str, count: int) -> dict:
    """Run a problem with a method and a number of steps: energy made, first warning, seconds."""
    setup = problem.setup()
    steps = FixedStep(make_method(method), span_of(setup) / count)
    names = setup.energies
    row = measure(replace(setup, steps=steps, probes=()), names)
    # That the cloth passes through itself says nothing about the steps.
    doubts = [doubt for doubt in doubts_of(row) if doubt.kind is not DoubtKind.INTERSECTION]
    energies = {name: np.array(row["columns"][name]) for name in names if name in row["columns"]}
    return {
        "made": energy_made(energies),
        "warning": str(doubts[0]) if doubts else "",
        "cpu_seconds": row["cpu_seconds"],
    }


def energy_made(energies: Mapping[str, np.ndarray]) -> float:
    """Return the largest energy that start, loads and pins cannot give, over the moving energy."""
    # Dissipated energy is not added, because its sum over large steps is too large.
    terms = [c for name, c in energies.items() if ":" not in name and name not in (*SUMS, "t")]
    work = energies["pins"] + sum(c for name, c in energies.items() if name.startswith("work:"))
    gain = energies["total"] - energies["total"][0] - work
    moved = abs(work) + sum(abs(c - c[0]) for c in terms)
    return max(0.0, float(gain.max() / max(moved.max(), 1e-300)))


def _row(run: Task, row: Mapping) -> dict:
    """Return the row of a run: status "ok", "wrong", "failed", or as a stopped case has it."""
    cells = dict(run.cells)
    last = {"predicted": cells.pop("predicted")}
    state = row["status"]
    cause = str(row["cause"]).partition("\n")[0]
    if state == OK and row["made"] > ENERGY:
        state = WRONG
        cause = f"the method made {row['made']:.2g} of the energy that moved"
    elif state == OK and row["warning"]:
        state = WRONG
        cause = row["warning"].partition("\n")[0]
    numbers = {"energy made": row.get("made"), "cpu_seconds": row.get("cpu_seconds")}
    return cells | {"status": state, "cause": cause} | numbers | last
