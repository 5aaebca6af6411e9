"""One scene of needs.py: what it is asked for, its cost, and how far two answers are apart."""

from __future__ import annotations

import tempfile
import time
import tomllib
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.errors import InputError
from fecloth.integrators.step import Step
from fecloth.nonlinear.statistics import Counts
from fecloth.runs.warm_up import compile_kernels
from fecloth.scene.probe_tables import Interest
from fecloth.scene.problem import Problem
from fecloth.scene.scene import Scene, load
from fecloth.simulation.probes import Observer
from fecloth.simulation.record_steps import balanced
from fecloth.simulation.resolve import resolve
from fecloth.simulation.run import columns

COUNTED = ("newton", "linear", "factorisations")
ENOUGH = 1.5  # CPU seconds of timing, after which a run is not repeated


def scene_of(text: str) -> Scene:
    """The scene of a TOML text whose paths are absolute."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return load(path)


def answer(
    scene: str,
    variant: str,
    text: str,
    static: bool = False,
    repeats: int = 3,
    most: float | None = None,
) -> dict:
    """Run a scene: its columns and displacements, counts, and the CPU seconds of the fastest run.

    `scene` and `variant` are names for the tables. With `static` the state at the end is sought
    by `equilibrium`, without the way there. `most` CPU seconds may a run take, with what it
    records and without compiling.
    """
    built = scene_of(text).build()
    compile_kernels(built)
    solved, rows = (balance if static else partial(march, most=most)), []
    while len(rows) < repeats and sum(row["cpu_seconds"] for row in rows) < ENOUGH:
        rows.append(solved(built))
    row = min(rows, key=lambda row: row["cpu_seconds"])
    moved = row.pop("state").x - built.state.x
    return {"triangles": len(built.cloth.triangles), **row, "moved": moved.tolist()}


def march(built: Problem, most: float | None) -> dict:
    """The run that the scene describes; what it records is not in its seconds."""
    system, state, counts = built.system, built.state, dict.fromkeys(COUNTED, 0)
    ledger, observer = fc.Ledger.open(system, state), Observer.bind(system, state, built.probes)
    rows, seconds, begin = [ledger.row() | observer.row(None, None)], 0.0, time.process_time()
    given = system, built.method, state, built.dt, built.t_end
    method, solver, _ = resolve(*given, built.linear, built.newton)
    first = begin
    for state, info in fc.march(system, method, *given[2:], solver=solver):  # noqa: B007
        seconds += time.process_time() - begin
        if most and time.process_time() - first > most:
            raise study.TimeLimit(f"more than {most:g} CPU seconds, at {info.t:.3g} s")
        ledger = balanced(system, method, ledger, info)
        rows.append(ledger.row() | observer.row(info.old, info.result))
        counts = {name: counts[name] + getattr(info.counts, name) for name in COUNTED}
        begin = time.process_time()
    row = {"cpu_seconds": seconds + time.process_time() - begin, "steps": len(rows) - 1, **counts}
    return row | {"times": [r["t"] for r in rows], "columns": listed(rows), "state": state}


def listed(rows: list[dict]) -> dict[str, list[float]]:
    return {name: values.tolist() for name, values in columns(rows).items()}


def balance(built: Problem) -> dict:
    """The equilibrium under the loads at the end; two rows, the start and it."""
    if any(pin.motion for pin, _ in built.system.constraints.groups.values()):
        raise InputError("a pin moves", "equilibrium holds pins where they start", "needs.py")
    found, old, begin = [], built.state, time.process_time()
    start = replace(old, t=built.t_end)
    state = fc.equilibrium(built.system, start, report=found.append)
    row = {"cpu_seconds": time.process_time() - begin, "steps": 1}
    row |= {"newton": len(found), "factorisations": len(found)}
    observer = Observer.bind(built.system, old, built.probes)
    seen = [observer.row(None, None), observer.row(old, Step(state, state, None, Counts()))]
    held = [fc.Ledger.open(built.system, at).row() for at in (old, state)]
    rows = [ledger | row for ledger, row in zip(held, seen, strict=True)]
    return row | {"times": [old.t, state.t], "columns": listed(rows), "state": state}


@dataclass(frozen=True)
class Answer:
    """The rows of one run, as `answer` returned them, and the cloth they stand on."""

    row: dict
    cloth: fc.Cloth
    probes: tuple[str, ...]

    @classmethod
    def of(cls, row: dict) -> Answer:
        scene = scene_of(row["text"])
        return cls(row, scene.mesh(), tuple(probe.name for probe in scene.probes))

    @property
    def times(self) -> np.ndarray:
        return np.array(self.row["times"])

    @property
    def moved(self) -> np.ndarray:
        """(n, 3) displacements at the end [m]."""
        return np.array(self.row["moved"])

    def column(self, name: str) -> np.ndarray:
        """(s, 1 or 3) a column, or a probe's three, over the run; probes from where they start.

        A term that is not there has no energy.
        """
        columns = self.row["columns"]
        names = [f"{name}.{c}" for c in "xyz"] if f"{name}.x" in columns else [name]
        none = np.zeros(len(self.times))
        values = np.stack([columns.get(one, none) for one in names], axis=1)
        return values - values[0] if name.split(".")[0] in self.probes else values


def changes(full: Answer, other: Answer, interest: Interest) -> dict[str, float]:
    """Relative change of each quantity of interest; the largest counts."""
    found = {f"{name} at the end": at_end(full, other, name) for name in interest.end}
    found |= {f"path of {name}": along(full, other, name) for name in interest.path}
    periods = {name: (period(full, name), period(other, name)) for name in interest.period}
    return found | {f"period of {name}": abs(b / a - 1) for name, (a, b) in periods.items()}


def at_end(full: Answer, other: Answer, name: str) -> float:
    """‖b − a‖/‖a‖ at the end, for the displacement field in L2 over the finer cloth."""
    if name == "displacement":
        apart = full.cloth.l2_difference(other.cloth, full.moved, other.moved)
        return ratio(apart, full.cloth.l2_norm(full.moved))
    a, b = full.column(name)[-1], other.column(name)[-1]
    return ratio(np.linalg.norm(b - a), np.linalg.norm(a))


def along(full: Answer, other: Answer, name: str) -> float:
    """√∫|b − a|² dt / √∫|a|² dt, each step of the run with fewer by its end.

    Not by the trapezoidal rule: reactions have no value at the start.
    """
    t = min(full.times, other.times, key=len)
    a, b = (
        np.stack([np.interp(t[1:], one.times, column) for column in one.column(name).T])
        for one in (full, other)
    )
    apart, size = (np.sqrt(np.sum(np.diff(t) * values**2)) for values in (b - a, a))
    return ratio(apart, size)


def period(one: Answer, name: str) -> float:
    """Mean time between two passages of a column through its time mean in one direction [s].

    With two passages in all, twice what lies between them.
    """
    t, values = one.times, one.column(name)
    if values.shape[1] > 1:
        raise InputError(f"interest.period: {name}", f"take a component, as {name}.z", "needs.py")
    y = values[:, 0] - np.trapezoid(values[:, 0], t) / (t[-1] - t[0])
    at = np.flatnonzero(y[:-1] * y[1:] < 0)
    if len(at) < 2:
        what, remedy = f"interest.period: {name}", "Take a greater t_end."
        raise InputError(what, "passes its mean less than twice", "needs.py", remedy)
    passed = t[at] - y[at] * (t[at + 1] - t[at]) / (y[at + 1] - y[at])
    return float((passed[2:] - passed[:-2]).mean() if len(at) > 2 else 2 * np.ptp(passed))


def ratio(apart: float, size: float) -> float:
    """apart/size; of nothing, nothing is no change and all else an endless one."""
    return float(apart / size) if size else (np.inf if apart else 0.0)


def interest_of(scene: Scene) -> Interest:
    """What the scene names; else its probes' paths, or the displacements at the end."""
    if scene.interest:
        return scene.interest
    if scene.probes:
        return Interest(path=tuple(probe.name for probe in scene.probes))
    return Interest(end=("displacement",))


def data_of(scene: Scene) -> dict:
    """The tables of a scene with all defaults, paths absolute."""
    return tomllib.loads(scene.to_toml())
