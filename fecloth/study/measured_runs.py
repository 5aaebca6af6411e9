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
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.integrators.protocol import chooses_method, method_of
from fecloth.mesh.cloth import Cloth
from fecloth.runs.first_calls import compile_kernels
from fecloth.simulation.equilibrium import Equilibrium, equilibrium
from fecloth.simulation.fixed_step import GivenSteps
from fecloth.simulation.fused_march import ROWS
from fecloth.simulation.on_request import on_request
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.simulation.run import columns
from fecloth.simulation.setup import Setup
from fecloth.study.coarser_start import rest_from
from fecloth.study.laying import describe_state, lay
from fecloth.study.modes import modes as natural_modes
from fecloth.study.orders import find_obstacles
from fecloth.study.status import TimeLimit, check_progress, check_time_limit

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
    change: Callable[[Setup], Setup] | None = None,
    coarser: Mapping[str, Any] | None = None,
    laid: str = "",
    halved: Mapping[str, Any] | None = None,
    **more: Any,
) -> dict:
    """Return the row of `measure` of a problem, with the seconds of set-up and all runs.

    These `case_seconds` are by the clock, which a user waits for: other programs and threads
    count. They are without the first calls of kernels, which other runs of the process need not
    make. `disturbed` is the seed of a disturbance of the start, `change` a function that returns
    the set-up to run, `more` are arguments of `measure`. `coarser` has the case of a `problem` on
    a coarser mesh and its `displacement` (n, 3) at rest: an equilibrium starts from there, or, if
    it is not found so, as it would without. `laid` is a way of `ways_of_laying`. `halved` has the
    `method` and the `sizes` of the steps of another run: this run takes each of them in halves.
    """
    begin = time.perf_counter()
    setup = problem.setup()
    if change:
        setup = change(setup)
    if disturbed is not None:
        setup = setup.disturbed(disturbed)
    if laid:
        setup = lay(setup, laid)
    if halved:
        setup = replace(setup, steps=_halve_steps(setup, **halved))
    begin_of_compilation = time.perf_counter()
    compile_kernels(setup)
    begin += time.perf_counter() - begin_of_compilation
    near = None
    if coarser:
        coarser_problem = coarser["problem"]
        if isinstance(coarser_problem, Mapping):
            coarser_problem = problem.of_case(**coarser_problem)
        near = rest_from(setup, coarser_problem.source.cloth, coarser["displacement"])
    row = None
    if near:
        with suppress(FeclothError):  # as a start that enters an obstacle
            row = measure(setup, recorded, modes, near=near, **more)
    if row is None:
        row = measure(setup, recorded, modes, **more)
    return row | {"case_seconds": time.perf_counter() - begin}


def make_method(name: str) -> Any:
    """Return the method whose class has this name, with its defaults."""
    methods = [make() for make in (METHODS | EXPLICIT).values()]
    return next(method for method in methods if type(method).__name__ == name)


def _halve_steps(setup: Setup, method: str, sizes: Sequence[float]) -> GivenSteps:
    """Return steps of these sizes [s], each in halves, by the method of the set-up.

    `method` is the name of the method that `Auto` has chosen; other set-ups have their own.
    """
    own = method_of(setup.steps)
    if chooses_method(own):
        own = make_method(method)
    return GivenSteps(own, tuple(np.repeat(np.array(sizes) / 2, 2)))


def measure(
    setup: Setup,
    recorded: Sequence[str],
    modes: int = 0,
    function: Callable[[Any], float] | None = None,
    timed: bool = False,
    repeats: int = REPEATS,
    most: float | None = None,
    rest: Rest = equilibrium,
    near: Rest | None = None,
) -> dict:
    """Run a setup, and return what quantities need of the run, as numbers and lists.

    The row has the size of the mesh, the CPU seconds, the columns at both ends (`ends`) and the
    recorded `columns` over the whole run with their `times`, the displacement and velocity at
    the end, the frequencies and the value of the function if they are asked for, and what may
    limit the convergence (`obstacles`). Warnings of fecloth are not shown: they are the
    `doubts` of the row. Raise `TimeLimit` for a run of more than `most` CPU seconds.

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
    near
        Finds the equilibrium from a start near it, in place of `rest` and of load steps.
    """
    quiet = warnings.catch_warnings(action="ignore", category=FeclothWarning)
    with setup.system.team.pinned(), quiet:
        setup = setup.recording(recorded)
        solve: Solve = partial(_march, whole=bool(recorded or function))
        if near or setup.t_end is None:
            solve = partial(_solve, rest=near or rest)
        elif modes and not setup.is_static:  # modes about the start, so that nothing runs
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
        # a vector, such as a probe, has the columns NAME.x, NAME.y and NAME.z
        recorded_columns = {*recorded, *(f"{name}.{c}" for name in recorded for c in "xyz")}
        row["energies"] = setup.energies
        row["columns"] = {k: v.tolist() for k, v in all_columns.items() if k in recorded_columns}
        if recorded_columns:
            row["times"] = row["times"].tolist()
        else:
            row["times"] = [row["times"][0], row["times"][-1]]
        row["displacement"] = (end.x - setup.start.x).tolist()
        row["velocity"] = end.v.tolist()
        if modes:
            shapes = natural_modes(setup.system, end, count=modes)
            row["frequencies"] = [float(frequency) for frequency in shapes.frequencies]
            known = {entry["kind"] for entry in row["doubts"]}
            new = (doubt.entry() for doubt in shapes.doubts)
            row["doubts"] += [entry for entry in new if entry["kind"] not in known]
        if setup.is_static:
            row |= describe_state(setup, end.x)
        if function:
            row["function"] = float(function(result))
    cloth = setup.cloth
    sizes = {"triangles": len(cloth.triangles), "nodes": len(cloth.X), "element": cloth.element}
    sizes["edge"] = math.sqrt(cloth.area / len(cloth.triangles))
    return sizes | row | {"obstacles": find_obstacles(setup, row["ends"], end.x)}


def _run_once(solve: Solve, setup: Setup, most: float | None) -> tuple[dict, float]:
    """Run a setup once, and return the part of its row from `solve`, and the CPU seconds.

    Raise `TimeLimit` if the run takes more than `most` CPU seconds, or the case more than its
    time limit; None is no limit.
    """
    begin = time.process_time()

    def report(*steps: object) -> None:
        check_time_limit()
        check_progress(begin, _part_done(setup, *steps))
        if most and time.process_time() - begin > most:
            raise TimeLimit(f"more than {most:g} CPU seconds")

    row = solve(setup, report)
    return row, time.process_time() - begin


def _part_done(setup: Setup, *steps: Any) -> float:
    """Return the part of the run that is done after a step; 1 where no step says it."""
    t = getattr(steps[0], "t", None) if steps else None
    if t is None or setup.t_end is None:
        return 1.0
    return (t - setup.start.t) / (setup.t_end - setup.start.t)


def _run_timed(
    solve: Solve, setup: Setup, repeats: int, most: float | None
) -> tuple[dict[str, Any], float]:
    """Run a setup so that its CPU seconds can be compared with those of other setups.

    First a run that does not count compiles and warms up what the run needs: four steps, 2 % of
    a run without fixed steps, or the whole static solution. Return the row of the first run that
    counts, and the CPU seconds of the fastest of up to `repeats` runs. Raise `TimeLimit` for a
    run of more than `most` CPU seconds.
    """
    warm_up = setup
    if setup.t_end is not None and not setup.is_static:
        span = setup.t_end - setup.start.t
        short_span = 0.02 * span
        if setup.steps.dt:
            short_span = 4 * setup.steps.dt
        warm_up = replace(setup, t_end=setup.start.t + min(short_span, span))
    with suppress(FeclothError):  # the run itself will fail, too, and say why
        _run_once(solve, warm_up, most)
    row, seconds = _run_once(solve, setup, most)
    seconds_of_runs = [seconds]
    # other work of the machine makes short runs slower by chance, so the fastest counts
    while len(seconds_of_runs) < repeats and sum(seconds_of_runs) < LONG_ENOUGH:
        _, seconds = _run_once(solve, setup, most)
        seconds_of_runs.append(seconds)
    return row, min(seconds_of_runs)


def _march(setup: Setup, report: Callable[..., None], whole: bool) -> dict:
    """Run a setup over time or load steps, and return the part of the row that the run gives.

    The row has the `times` and `columns` of what was recorded, the state at the `end`, the
    `result` of the run, and its cost and errors. With `whole` each step is recorded. Without, a
    run of many steps records only some of them, which is faster: then only the start and the
    end are wanted. `report` is called after each recorded step.
    """
    simulation, solver = setup.choose()
    sizes = list[float]()
    t = setup.start.t

    def follow(info):
        nonlocal t
        sizes.extend([(info.t - t) / info.number] * info.number)
        t = info.t
        report(info)

    result = simulation.run(solver, report=follow, rows=None if whole else ROWS)
    return {
        "times": result.times,
        "columns": {**result.energies, **result.observed},
        "end": result.state,
        "result": result,
        "steps": result.steps,
        "step": math.nan if setup.is_static else max(sizes, default=0.0),
        "method_of_steps": "" if setup.is_static else type(method_of(simulation.steps)).__name__,
        "sizes": [] if simulation.steps.dt else sizes,
        "newton": result.newton,
        "time_error": result.time_error,
        "time_order": 0 if setup.is_static else simulation.steps.traits.order,
        "doubts": [doubt.entry() for doubt in result.doubts],
    }


def _solve(setup: Setup, report: Callable[..., None], rest: Rest | None) -> dict:
    """Find the equilibrium of a setup, and return the same part of the row as `_march`.

    `rest` finds the equilibrium. If it is None, nothing is solved, and the end is the start.
    Only the start and the end have rows. `report` is called after each iteration.
    """
    state: Any = setup.start
    cost_and_doubts: dict[str, Any] = {"steps": 0, "newton": 0, "doubts": []}
    if rest:
        # warnings are not shown, because the row has them as doubts
        with warnings.catch_warnings(action="ignore", category=FeclothWarning):
            state = rest(setup.system, setup.start, report=report)
        doubts = [doubt.entry() for doubt in state.doubts]
        cost_and_doubts = {"steps": 1, "newton": state.iterations, "doubts": doubts}
    return cost_and_doubts | {
        "times": np.array([setup.start.t, state.t]),
        "columns": columns([setup.row(), setup.row(state if rest else None)]),
        "end": state,
        "result": state,
        "step": math.nan,
        "method_of_steps": "",
        "sizes": [],
        "time_error": math.nan,
        "time_order": 0,
    }


def columns_to_record(quantity: Quantity) -> list[str]:
    """Return the columns that a quantity needs over the whole run."""
    if quantity.place:
        return [quantity.column, quantity.place]
    if quantity.how in WHOLE or quantity.at is not None or on_request([quantity.column]):
        return [quantity.column]
    return []


def record_of(row: Mapping, quantity: Quantity, cloth: Cloth | None, probes=()) -> RunRecord:
    """Return the record from which a quantity is computed, made of a row of `measure`.

    It has the columns over the whole run if the quantity needs them, else only at both ends.
    `cloth` is what a field needs, `probes` are the names of the probes.
    """
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
