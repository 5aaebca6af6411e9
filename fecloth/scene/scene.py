"""Scenes: a strict TOML file that names a cloth, a fabric, terms, pins, a start and a method.

The same thing as the Python calls: the keys of a term, the fabric or the solver are the fields of
the classes in `fecloth.terms`, of `Fabric` and of `Newton`, with the same units. Numbers are in SI,
and so is what formulas give; text may be a number with another unit of the same quantity, as in
``dt = "5 ms"`` (see `units`). The tables are described in `scenetables`, `scenefabric`,
`scenestart` and `scenetime`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationError, create_model, model_validator

from fecloth.errors import InputError, SceneError
from fecloth.fabric.panel import Panel
from fecloth.homogenisation import bending_note
from fecloth.linalg import select
from fecloth.mesh.cloth import Cloth
from fecloth.output.frames import read_frame
from fecloth.scene import tables, toml_text
from fecloth.scene.expectations import refuse_times, refuse_unknown
from fecloth.scene.fabric_table import FabricTable
from fecloth.scene.problem import Built
from fecloth.scene.start_table import Start
from fecloth.scene.table_model import Table, as_tuples, exactly_one, scene_error, told_at
from fecloth.scene.time_table import Output, Time
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.stability_limited import refuse_unstable
from fecloth.simulation.step_times import step_times
from fecloth.system.constraints import Constraints
from fecloth.system.pins import Pin
from fecloth.system.system import State, System

MOST_PLACES = 1_000_000  # times × nodes at which a motion of t, X, Y is evaluated before a run


class Scene(Table):
    """A scene file, checked; its tables hold what the file says and the defaults.

    `fabric` is that of the whole cloth, or `fabrics` has one for each region, as in
    [fabrics.body]; `grain_degrees` is the angle of the warp from X, one or by region. `mass` left
    out is "lumped", on a cloth of element "P2" "consistent".
    Two scenes are equal if they say the same, whatever file they come from.
    """

    title: str | None = None
    mass: Literal["lumped", "consistent"] = "lumped"  # for P2 cloths consistent, see below
    cloth: tables.Shape
    fabric: FabricTable | None = None
    fabrics: dict[str, FabricTable] | None = None
    grain_degrees: float | dict[str, float] = 0.0
    terms: tuple[tables.Term, ...] = ()
    pins: tuple[tables.PinTable, ...] = ()
    start: Start = Start(plane="xy")
    time: Time
    solver: tables.SolverTable = tables.SolverTable()
    output: Output = Output(frames=50)
    probes: tuple[tables.ProbeTable, ...] = ()
    expect: dict[str, tables.Expectations] = Field({})
    interest: tables.Interest | None = None

    _source: str = PrivateAttr("scene")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self.model_dump() == other.model_dump()

    @model_validator(mode="before")
    @classmethod
    def _lists_as_tuples(cls, data: Any) -> Any:
        data = as_tuples(data)
        if isinstance(data, dict) and isinstance(cloth := data.get("cloth"), dict):
            usual = "consistent" if cloth.get("element") == "P2" else "lumped"
            data.setdefault("mass", usual)
        return data

    @model_validator(mode="after")
    def _consistent(self):
        exactly_one(self, "fabric", "fabrics")
        if self.mass == "lumped" and self.cloth.element == "P2":
            allowed = 'must be "consistent" for element P2: row sums give its corners no mass'
            raise InputError('mass = "lumped"', allowed, "", "Leave it out.")
        if self.fabrics == {}:
            raise InputError("fabrics = {}", "must name a region, as in [fabrics.body]")
        names = [probe.name for probe in self.probes]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise InputError(f"probes.{i}.name = {name!r}", "two probes need two names")
        fixed = self.time.dt != "auto"
        if fixed and self.output.every and self.output.every < self.time.dt:
            allowed = f"must be at least time.dt = {self.time.dt} [s]"
            raise InputError(f"output.every = {self.output.every}", allowed)
        return self

    def require_expectations(self) -> None:
        """Raise `SceneError` if [expect] is empty or asks for a time that the run does not pass.

        For `check`, before the run; a run that is shortened by hand need not mind.
        """
        if not self.expect:
            remedy = "Add one, as in: sag = { value = 0.1, relative = 0.01 }"
            raise SceneError("no [expect] table", "nothing to check", self._source, remedy)
        refuse_times(self.expect, self.time.t_start, self.time.t_end, self._source)

    # --- to text ------------------------------------------------------------------------------

    def to_toml(self) -> str:
        """The scene with all defaults written out; it loads again to an equal scene.

        Paths are absolute, so that the text may lie in any folder.
        """
        data = self.model_dump(exclude_none=True)
        if len(data["time"]["method"]) == 1:
            data["time"]["method"] = data["time"]["method"]["type"]
        data["expect"] = {k: v[0] if len(v) == 1 else v for k, v in data["expect"].items()}
        return toml_text.written(data)

    # --- to objects ---------------------------------------------------------------------------

    def mesh(self) -> Cloth:
        """The cloth alone; raises `SceneError` for one that cannot be meshed."""
        with self._at("cloth"):
            return self.cloth.cloth()

    def build(self, cloth: Cloth | None = None) -> Built:
        """Mesh the cloth (unless it is given), bind the terms and pins, place the start.

        Raises
        ------
        SceneError
            For a mesh that cannot be read, a set or region that it does not have, regions that
            overlap or leave a gap, pins that share a node, a formula that is not finite where it
            is needed, an unknown name in [expect].
        """
        cloth = self.mesh() if cloth is None else cloth
        pins, fabric, grain = self._pins(cloth), *self._cut(cloth)
        with self._at("terms"):
            given = [term.make() for term in self.terms]
            system = System(cloth, fabric, given, pins, self.mass, grain)
        state = self._start(system)
        self._check_start(system, state)
        method, dt = self.time.stepping()
        self._check_method(system, state, method, dt)
        probes = self._probes(cloth)
        self._check_expected(system, state, probes)
        return Built(
            cloth=cloth,
            system=system,
            state=state,
            method=method,
            dt=dt,
            t_end=self.time.t_end,
            newton=self.solver.make(),
            linear=self.solver.linear,
            probes=probes,
            frame_steps=self.output.steps(self.time),
            stops=self.output.stops(self.time),
            frame_format=self.output.format,
            note=self._note(),
            restarts=self.output.restart_steps or self.output.restart_every,
        )

    def _note(self) -> str:
        """What [expect] should know of the mesh."""
        pattern = getattr(self.cloth, "pattern", "")
        return bending_note(pattern, [t.type for t in self.terms]) if self.expect else ""

    def _cut(self, cloth: Cloth) -> tuple:
        """The fabric and the grain [rad] as `System` takes them, each one or by region."""
        fabric = self.fabric.make() if self.fabric else _each(self.fabrics, lambda t: t.make())
        with self._at("fabric" if self.fabric else "fabrics"):
            Panel.cut(cloth, fabric)
        grain = _each(self.grain_degrees, math.radians)
        with self._at("grain_degrees"):
            Panel.cut(cloth, fabric, grain)
        return fabric, grain

    def _pins(self, cloth: Cloth) -> list[Pin]:
        pins = []
        for i, table in enumerate(self.pins):
            pin = table.pin()
            with self._at(f"pins.{i}.{'inside' if table.where is None else 'where'}"):
                X = cloth.X[cloth.nodes(pin.where)]
            pins.append(pin.at(X))
            if pin.motion:
                times = self._motion_times()
                if pin.motion.by_place:  # at some of them, to limit the work
                    times = times[:: 1 + len(times) * len(X) // MOST_PLACES, None]
                with self._at(f"pins.{i}.motion"):
                    pins[-1].motion.check(times)
        with self._at("pins"):
            Constraints.bind(pins, cloth)
        return pins

    def _motion_times(self) -> np.ndarray:
        """The start and the ends of all steps, at which a run needs a motion."""
        start, end, dt = self.time.t_start, self.time.t_end, self.time.dt
        dt = (end - start) / 1000 if dt == "auto" else dt
        return np.append(start, step_times(start, dt, end))

    def _start(self, system: System) -> State:
        cloth, start = system.cloth, self.start
        if start.frame:
            with self._at("start.frame"):
                return replace(read_frame(start.frame, cloth), t=self.time.t_start)
        with self._at("start.position"):
            x = start.x(cloth.X)
        with self._at("start.velocity"):
            v = start.v(cloth.X)
        with self._at("start"):
            return system.state(x, v, self.time.t_start)

    def _check_start(self, system: System, state: State) -> None:
        for name, term in zip(system.names, system.bound, strict=True):
            f = np.zeros_like(state.x)
            with self._at("terms"):
                term.add_force(state.x, state.v, state.t, f)
            if not np.isfinite(f).all():
                allowed = "has no finite force at the start"
                remedy = "Is the start degenerate? A Gas needs a volume: give it a dome."
                raise SceneError(f"terms: {name}", allowed, self._source, remedy)

    def _check_method(self, system: System, state: State, method, dt: float | None) -> None:
        """Refuse a mass, a step or a linear solver that the method cannot have."""
        if method.traits.explicit:
            with self._at(""):  # the mass
                method.check(system)
        elif self.solver.linear != "auto":
            symmetric = system.symmetric and method.traits.symmetric
            with self._at("solver.linear"):
                select.named(self.solver.linear, symmetric or self.solver.definiteness == "clamp")
        if dt:
            insist = f'method = {{ type = "{self.time.method.type}", beyond_limit = true }}'
            with self._at("time"):
                refuse_unstable(system, method, state, dt, insist)

    def _probes(self, cloth: Cloth) -> tuple[Probe, ...]:
        probes = tuple(table.probe() for table in self.probes)
        for i, probe in enumerate(probes):
            with self._at(f"probes.{i}.{'where' if probe.point is None else 'point'}"):
                probe.weights(cloth)
        return probes

    def _check_expected(self, system: System, state: State, probes: tuple[Probe, ...]) -> None:
        if not (self.expect or self.interest):
            return
        observed = Observer.bind(system, state, probes).row(None, None)
        names = sorted({*observed, *Ledger.open(system, state).row()} - {"t"})
        refuse_unknown(self.expect, self.interest, names, self._source)

    def _at(self, key: str) -> AbstractContextManager[None]:
        """Refusals of the objects, told as what the scene says at `key`."""
        return told_at(key, self._source)


def _each(given: Any, function: Callable) -> Any:
    """The function's value, or one for each region."""
    if isinstance(given, Mapping):
        return {name: function(value) for name, value in given.items()}
    return function(given)


def load(
    path: str | Path, overrides: Iterable[str] = (), terms: Mapping[str, type] | None = None
) -> Scene:
    """Read and check a scene file.

    Parameters
    ----------
    path
        A TOML file; the paths in it are relative to its folder.
    overrides
        Values that replace those of the file, as in ``["time.dt=0.005", "terms.0.time=0.02"]``.
    terms
        Types of terms of one's own, beside those of `fecloth.terms`: ``{"Winkler": Winkler}``, a
        dataclass each, whose fields are the keys of its ``[[terms]]`` table. Only Python code can
        give them: a scene names no code, so that a file from elsewhere runs none.

    Raises
    ------
    SceneError
        For any mistake, with the file, the key, its value, what is allowed, and the nearest
        valid key or name.
    """
    path, overrides = Path(path), tuple(overrides)
    data = toml_text.overridden(toml_text.read(path), overrides)
    source = f"{path} with {', '.join(overrides)}" if overrides else str(path)
    try:
        scene = _scene(terms or {}).model_validate(data, context={"folder": path.parent})
    except ValidationError as error:
        raise scene_error(error, data, source) from None
    scene._source = source
    return scene


def _scene(terms: Mapping[str, type]) -> type[Scene]:
    """The class of the scenes that know these terms too."""
    if not terms:
        return Scene
    return create_model("Scene", __base__=Scene, terms=(tuple[tables.terms_with(terms), ...], ()))
