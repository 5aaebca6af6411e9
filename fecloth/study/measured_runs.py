"""One run of a study, and what quantities of interest need of it, as a row of numbers."""

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fecloth.errors import FeclothError, FeclothWarning
from fecloth.mesh.cloth import Cloth
from fecloth.simulation.equilibrium import Equilibrium, equilibrium
from fecloth.simulation.on_request import on_request
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.simulation.record_steps import ROWS
from fecloth.simulation.run import columns
from fecloth.simulation.setup import Setup
from fecloth.study.modes import modes as natural_modes
from fecloth.study.problem import find_obstacles
from fecloth.study.status import TimeLimit, check_time_limit

WHOLE = ("max", "min", "path", "period", "frequency")  # `how` of quantities of the whole run
# Runs at most to compare seconds, of which the fastest counts; no run is added once all together
# have taken this long [s], where the clock is exact enough.
REPEATS = 3
LONG_ENOUGH = 1.0
Solve = Callable[[Setup, Callable[..., None]], dict]
Rest = Callable[..., Equilibrium]


def measure_problem(
    problem: Any,
    recorded: Sequence[str],
    modes: int = 0,
    disturbed: int | None = None,
    **more: Any,
) -> dict:
    """Return the row of `measure` of a problem, with the CPU seconds of set-up and all runs.

    `disturbed` is the seed of a disturbance of the start, `more` are arguments of `measure`.
    """
    begin = time.process_time()
    setup = problem.setup()
    if disturbed is not None:
        setup = setup.disturbed(disturbed)
    row = measure(setup, recorded, modes, **more)
    return row | {"case_seconds": time.process_time() - begin}


def measure(
    setup: Setup,
    recorded: Sequence[str],
    modes: int = 0,
    function: Callable[[Any], float] | None = None,
    timed: bool = False,
    repeats: int = REPEATS,
    most: float | None = None,
    rest: Rest = equilibrium,
) -> dict:
    """Run a setup, and return what quantities need of the run, as numbers and lists.

    Parameters
    ----------
    recorded
        Columns, or names of vectors, that are returned over the whole run.
    modes
        Number of natural frequencies about the start, or about the equilibrium. With modes a
        setup in time is not run.
    function
        A user's function of the result.
    timed
        Whether the CPU seconds will be compared. Then a few steps warm up first, and a short run
        is repeated; the fastest counts.
    repeats
        Number of runs at most.
    most
        Longest CPU time of a run [s].
    rest
        Finds the equilibrium of a setup without `t_end`.
    """
    quiet = warnings.catch_warnings(action="ignore", category=FeclothWarning)
    with setup.system.team.pinned(), quiet:
        setup = setup.recording(recorded)
        solve: Solve = partial(_march, whole=bool(recorded or function))
        if setup.t_end is None:
            solve = partial(_solve, rest=rest)
        elif modes and not setup.is_static:
            solve = partial(_solve, rest=None)
        if timed:
            row, seconds = _run_timed(solve, setup, repeats, most)
        else:
            row, seconds = _run_once(solve, setup, most)
        result = row.pop("result")
        all_columns = row.pop("columns")
        end = row.pop("end")
        row["cpu_seconds"] = seconds
        row["ends"] = {key: [float(v[0]), float(v[-1])] for key, v in all_columns.items()}
        wanted = {*recorded, *(f"{name}.{c}" for name in recorded for c in "xyz")}
        row["energies"] = setup.energies
        row["columns"] = {k: v.tolist() for k, v in all_columns.items() if k in wanted}
        if wanted:
            row["times"] = row["times"].tolist()
        else:
            row["times"] = [row["times"][0], row["times"][-1]]
        row["displacement"] = (end.x - setup.start.x).tolist()
        row["velocity"] = end.v.tolist()
        if modes:
            shapes = natural_modes(setup.system, end, count=modes)
            row["frequencies"] = [float(frequency) for frequency in shapes.frequencies]
        if function:
            row["function"] = float(function(result))
    cloth = setup.cloth
    sizes = {"triangles": len(cloth.triangles), "nodes": len(cloth.X), "element": cloth.element}
    sizes["edge"] = math.sqrt(cloth.area / len(cloth.triangles))
    return sizes | row | {"obstacles": find_obstacles(setup, row["ends"], end.x)}


def _run_once(solve: Solve, setup: Setup, most: float | None) -> tuple[dict, float]:
    """Return what a run gives, and its CPU seconds; raise `TimeLimit` above `most` [s]."""
    begin = time.process_time()

    def report(*_: object) -> None:
        check_time_limit()
        if most and time.process_time() - begin > most:
            raise TimeLimit(f"more than {most:g} CPU seconds")

    row = solve(setup, report)
    return row, time.process_time() - begin


def _run_timed(solve: Solve, setup: Setup, repeats: int, most: float | None) -> tuple[dict, float]:
    """Warm up with four steps, or a static solution; then return the fastest of some runs."""
    first = setup
    if setup.t_end is not None and not setup.is_static:
        span = setup.t_end - setup.start.t
        short = 0.02 * span
        if setup.steps.dt:
            short = 4 * setup.steps.dt
        first = replace(setup, t_end=setup.start.t + min(short, span))
    with suppress(FeclothError):  # the run itself will say so
        _run_once(solve, first, most)
    row, seconds = _run_once(solve, setup, most)
    spent = [seconds]
    while len(spent) < repeats and sum(spent) < LONG_ENOUGH:
        spent.append(_run_once(solve, setup, most)[1])
    return row, min(spent)


def _march(setup: Setup, report: Callable[..., None], whole: bool) -> dict:
    """Run over time or load steps; without `whole` only start and end have rows."""
    chosen, solver = setup.choose()
    sizes = [0.0]

    def follow(info):
        sizes.append(info.dt)
        report(info)

    result = chosen.run(solver, follow, None if whole else ROWS)
    return {
        "times": result.times,
        "columns": {**result.energies, **result.observed},
        "end": result.state,
        "result": result,
        "steps": result.steps,
        "step": math.nan if setup.is_static else max(sizes),
        "newton": result.newton,
        "time_error": result.time_error,
        "time_order": 0 if setup.is_static else chosen.steps.traits.order,
        "doubts": [doubt.entry() for doubt in result.doubts],
    }


def _solve(setup: Setup, report: Callable[..., None], rest: Rest | None) -> dict:
    """Find the equilibrium, or do nothing without `rest`; only start and end have rows."""
    state: Any = setup.start
    counted: dict[str, Any] = {"steps": 0, "newton": 0, "doubts": []}
    if rest:
        with warnings.catch_warnings(action="ignore", category=FeclothWarning):  # in the row
            state = rest(setup.system, setup.start, report=report)
        doubts = [doubt.entry() for doubt in state.doubts]
        counted = {"steps": 1, "newton": state.iterations, "doubts": doubts}
    return counted | {
        "times": np.array([setup.start.t, state.t]),
        "columns": columns([setup.row(), setup.row(state if rest else None)]),
        "end": state,
        "result": state,
        "step": math.nan,
        "time_error": math.nan,
        "time_order": 0,
    }


def columns_to_record(quantity: Quantity) -> list[str]:
    """Return the columns that a quantity needs over the whole run."""
    if quantity.how in WHOLE or quantity.at is not None or on_request([quantity.column]):
        return [quantity.column]
    return []


def record_of(row: Mapping, quantity: Quantity, cloth: Cloth | None, probes=()) -> RunRecord:
    """Return what a quantity is computed from, out of a row of `measure`."""
    columns_of_run = row["ends"]
    times = [row["times"][0], row["times"][-1]]
    if columns_to_record(quantity):
        columns_of_run = row["columns"]
        times = row["times"]
    fields = {name: np.array(row[name]) for name in ("displacement", "velocity")}
    return RunRecord(
        times=np.array(times),
        columns={name: np.array(values) for name, values in columns_of_run.items()},
        cloth=cloth,
        fields=fields,
        probes=tuple(probes),
        frequencies=tuple(row.get("frequencies", ())),
        values={quantity.text: row.get("function", math.nan)},
    )
