"""Run one scene of the simplification study; compare two results."""

from __future__ import annotations

import time
import tomllib
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.errors import InputError
from fecloth.integrators.step import Step
from fecloth.nonlinear.statistics import Counts
from fecloth.runs.warm_up import compile_kernels
from fecloth.scene.probe_tables import Interest
from fecloth.scene.problem import Problem
from fecloth.scene.scene import Scene
from fecloth.simulation.probes import Observer
from fecloth.simulation.quantity_values import RunRecord, relative_difference
from fecloth.simulation.record_steps import update_ledger
from fecloth.simulation.resolve import resolve
from fecloth.simulation.run import columns
from fecloth.study.scene_text import scene_of

COUNTED = ("newton", "linear", "factorisations")
ENOUGH = 1.5  # CPU seconds of timing, after which the run is not repeated


def answer(
    scene: str,
    variant: str,
    text: str,
    static: bool = False,
    repeats: int = 3,
    most: float | None = None,
) -> dict:
    """Run a scene; return its columns, displacements, counts and CPU seconds (the fastest run).

    Parameters
    ----------
    scene, variant
        Names for the tables.
    text
        TOML of the scene.
    static
        Solve `equilibrium` for the state at the end, instead of marching to it.
    repeats
        Largest number of runs.
    most
        Largest CPU time of a run [s], with recording and without compiling.
    """
    built = scene_of(text).build()
    compile_kernels(built)
    solve, rows = (solve_equilibrium if static else partial(march, most=most)), []
    while len(rows) < repeats and sum(row["cpu_seconds"] for row in rows) < ENOUGH:
        rows.append(solve(built))
    row = min(rows, key=lambda row: row["cpu_seconds"])
    moved = row.pop("state").x - built.state.x
    return {"triangles": len(built.cloth.triangles), **row, "moved": moved.tolist()}


def march(built: Problem, most: float | None) -> dict:
    """Run the scene in time; its CPU seconds do not include recording."""
    system, state, counts = built.system, built.state, dict.fromkeys(COUNTED, 0)
    ledger, observer = fc.Ledger.open(system, state), bind_observer(built)
    rows, seconds, begin = [ledger.row() | observer.row(None, None)], 0.0, time.process_time()
    run = system, built.steps, state, built.t_end
    steps, solver, _ = resolve(*run, built.linear, built.newton)
    first = begin
    marching = fc.march(system, steps, state, t_end=built.t_end, solver=solver)
    for state, info in marching:  # noqa: B007
        seconds += time.process_time() - begin
        study.check_time_limit()
        if most and time.process_time() - first > most:
            raise study.TimeLimit(f"more than {most:g} CPU seconds, at {info.t:.3g} s")
        ledger = update_ledger(system, steps, ledger, info)
        rows.append(ledger.row() | observer.row(info.old, info.result))
        counts = {name: counts[name] + getattr(info.counts, name) for name in COUNTED}
        begin = time.process_time()
    row = {"cpu_seconds": seconds + time.process_time() - begin, "steps": len(rows) - 1, **counts}
    return row | {"times": [r["t"] for r in rows], "columns": column_lists(rows), "state": state}


def bind_observer(built: Problem) -> Observer:
    return Observer.bind(built.system, built.state, built.probes, shape=True)


def column_lists(rows: list[dict]) -> dict[str, list[float]]:
    return {name: values.tolist() for name, values in columns(rows).items()}


def solve_equilibrium(built: Problem) -> dict:
    """Solve for the equilibrium under the loads at the end; the rows are the start and the end."""
    if any(pin.motion for pin, _ in built.system.constraints.groups.values()):
        raise InputError("a pin moves", "equilibrium does not move pins", "studies.simplify")
    iterations, old, begin = [], built.state, time.process_time()
    start = replace(old, t=built.t_end)
    state = fc.equilibrium(built.system, start, report=iterations.append)
    row = {"cpu_seconds": time.process_time() - begin, "steps": 1}
    row |= {"newton": len(iterations), "factorisations": len(iterations)}
    observer = bind_observer(built)
    observed = [observer.row(None, None), observer.row(old, Step(state, state, None, Counts()))]
    ledgers = [fc.Ledger.open(built.system, at).row() for at in (old, state)]
    rows = [ledger | row for ledger, row in zip(ledgers, observed, strict=True)]
    return row | {"times": [old.t, state.t], "columns": column_lists(rows), "state": state}


@dataclass(frozen=True)
class Answer:
    """Result of one run: its row from `answer`, its cloth, and the names of its probes."""

    row: dict
    cloth: fc.Cloth
    probes: tuple[str, ...]

    @classmethod
    def of(cls, row: dict) -> Answer:
        scene = scene_of(row["text"])
        return cls(row, scene.mesh(), tuple(probe.name for probe in scene.probes))

    @property
    def record(self) -> RunRecord:
        """What quantities are computed from."""
        columns = {name: np.array(column) for name, column in self.row["columns"].items()}
        fields = {"displacement": np.array(self.row["moved"])}
        return RunRecord(np.array(self.row["times"]), columns, self.cloth, fields, self.probes)


def changes(full: Answer, other: Answer, interest: Interest) -> dict[str, float]:
    """Return the relative change of each quantity of interest."""
    a, b = full.record, other.record
    return {one.text: relative_difference(one, a, b) for one in interest.all}


def interest_of(scene: Scene) -> Interest:
    """Return [interest]; by default the paths of the probes, or the displacement at the end."""
    if scene.interest:
        return scene.interest
    if scene.probes:
        return Interest(path=tuple(probe.name for probe in scene.probes))
    return Interest(quantities=("displacement",))


def data_of(scene: Scene) -> dict:
    """Return the tables of a scene with all defaults and absolute paths."""
    return tomllib.loads(scene.to_toml())
