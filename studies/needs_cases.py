"""One scene of needs.py: what it is asked for, its cost, and how far two answers are apart."""

from __future__ import annotations

import tempfile
import time
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import harness
import numpy as np

import fecloth as fc
from fecloth.errors import InputError
from fecloth.newton import Counts
from fecloth.observe import Observer
from fecloth.runner import compile_kernels
from fecloth.scene import Built, Scene, load
from fecloth.scenetables import Interest
from fecloth.step import Step

COUNTED = ("newton", "linear", "factorisations")
ENOUGH = 1.5  # CPU seconds of timing, after which a run is not repeated


def scene_of(text: str) -> Scene:
    """The scene of a TOML text whose paths are absolute."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return load(path)


def answer(scene: str, variant: str, text: str, static: bool = False, repeats: int = 3) -> dict:
    """Run a scene: its columns and displacements, counts, and the CPU seconds of the fastest run.

    `scene` and `variant` are names for the tables. With `static` the state at the end is sought
    by `equilibrium`, without the way there.
    """
    built = scene_of(text).build()
    compile_kernels(built)
    solved, spent = (balance if static else march), []
    while len(spent) < repeats and sum(spent) < ENOUGH:
        begin = time.process_time()
        row = solved(built)
        spent.append(time.process_time() - begin)
    moved = row.pop("state").x - built.state.x
    size = {"triangles": len(built.cloth.triangles), "cpu_seconds": min(spent)}
    return size | row | {"moved": moved.tolist()}


def march(built: Built) -> dict:
    """The run that the scene describes."""
    counts = dict.fromkeys(COUNTED, 0)

    def count(info) -> None:
        harness.tick()
        for name in COUNTED:
            counts[name] += getattr(info.counts, name)

    given = built.system, built.method, built.state, built.dt, built.t_end
    options = {"solver": built.linear, "newton": built.newton, "probes": built.probes}
    run = fc.run(*given, **options, report=count)
    columns = {name: values.tolist() for name, values in (run.energies | run.observed).items()}
    row = {"steps": len(run.times) - 1, **counts}
    return row | {"times": run.times.tolist(), "columns": columns, "state": run.state}


def balance(built: Built) -> dict:
    """The equilibrium under the loads at the end; two rows, the start and it."""
    if any(pin.motion for pin, _ in built.system.constraints.groups.values()):
        raise InputError("a pin moves", "equilibrium holds pins where they start", "needs.py")
    found, old = [], built.state
    start = replace(old, t=built.t_end)
    state = fc.equilibrium(built.system, start, report=found.append)
    observer = Observer.bind(built.system, old, built.probes)
    seen = [observer.row(None, None), observer.row(old, Step(state, state, None, Counts()))]
    held = [fc.Ledger.open(built.system, at).row() for at in (old, state)]
    rows = [ledger | row for ledger, row in zip(held, seen, strict=True)]
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    row = {"steps": 1, "newton": len(found), "factorisations": len(found)}
    return row | {"times": [old.t, state.t], "columns": columns, "state": state}


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
    """√∫|b − a|² dt / √∫|a|² dt, at the times of the run with fewer steps, from the second on."""
    t = min(full.times, other.times, key=len)[1:]
    a, b = (
        np.stack([np.interp(t, one.times, column) for column in one.column(name).T])
        for one in (full, other)
    )
    return ratio(mean_square(t, b - a), mean_square(t, a))


def mean_square(t: np.ndarray, values: np.ndarray) -> float:
    """√ of the time mean of |values|² by the trapezoidal rule."""
    return float(np.sqrt(np.trapezoid((values**2).sum(axis=0), t)))


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
