"""The objects of a scene, each made once: system, start, method, what is recorded."""

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fecloth.compiled.team import number_of_threads
from fecloth.errors import InputError, SceneError
from fecloth.fabric.panel import Panel
from fecloth.homogenisation import bending_note
from fecloth.integrators.protocol import StepChoice, check_terms, has_symmetric_matrix
from fecloth.linalg import select
from fecloth.mesh.cloth import Cloth
from fecloth.output.frames import read_frame
from fecloth.scene.cloth_tables import Pieces
from fecloth.scene.error_words import errors_at
from fecloth.scene.placement import PinTable
from fecloth.scene.probe_tables import refuse_unknown
from fecloth.scene.problem import Problem
from fecloth.scene.schedule import EquilibriumTable, Time
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.on_request import on_request
from fecloth.simulation.probes import Probe
from fecloth.simulation.step_times import step_times
from fecloth.simulation.steps import Memory
from fecloth.system.clamps import find_clamps
from fecloth.system.constraints import Constraints
from fecloth.system.pins import Motion, Pin
from fecloth.system.state import State, make_state
from fecloth.system.system import System
from fecloth.terms.protocol import has_own
from fecloth.validation import FARTHEST

# No cloth has larger values. They are refused by the name of their key, not by a failed step.
LARGEST_SPEED = 1e6  # m/s of a node at the start
LARGEST_FORCE = 1e15  # N of a term on a node at the start
# Times × nodes at which a motion of t, X and Y is checked before a run: it limits the work.
MOST_CHECKED_PLACES = 1_000_000

AnyTime = Time | EquilibriumTable
At = Callable[[str], AbstractContextManager[None]]  # names the key of the scene in errors


def build(scene: Any, cloth: Cloth, make_system: Callable[..., System] = System) -> Problem:
    """Bind terms and pins of a `Scene` to the cloth, place the start, check the method."""
    at = partial(errors_at, where=scene.source)
    state = _start(scene, cloth, at)
    system = _system(scene, cloth, state, at, make_system)
    _check_start(scene, system, state, at)
    steps = scene.schedule.steps()
    _check_method(scene, system, state, steps, at)
    probes = tuple(table.probe() for table in scene.probes)
    if scene.expect:
        pattern = getattr(scene.cloth, "pattern", "")
        note = bending_note(pattern, [term.type for term in scene.terms])
    else:
        note = ""
    problem = Problem(
        system,
        state,
        steps,
        t_end=scene.schedule.t_end,
        unit=scene.schedule.unit,
        newton=scene.solver.make(),
        linear=scene.solver.linear,
        probes=(*probes, *_on_request(scene)),
        memory=Memory(0, state.t, None),  # the start is checked above
        frame_steps=scene.output.steps(scene.schedule),
        stops=scene.output.stops(scene.schedule),
        note=note,
        output=scene.output,
    )
    _check_columns(scene, problem, probes, at)
    return problem


def _system(scene: Any, cloth: Cloth, start: State, at: At, make_system: Callable) -> System:
    """Bind the terms and pins of a scene; an error names the table with the mistake."""
    pins = [_pin(i, table, scene.schedule, cloth, at) for i, table in enumerate(scene.pins)]
    if scene.fabric:
        fabric = scene.fabric.make()
    else:
        fabric = {region: table.make() for region, table in scene.fabrics.items()}
    grain = _in_radians(scene.grain_degrees)
    terms = [term.make() for term in scene.terms]
    threads = scene.solver.threads
    with at("solver.threads"):
        number_of_threads(threads)
    try:
        return make_system(cloth, fabric, terms, pins, scene.mass, grain, start, threads=threads)
    except InputError:
        _refuse_parts(scene, cloth, start, fabric, grain, pins, terms, at)
        with at("terms"):
            raise


def _refuse_parts(
    scene: Any,
    cloth: Cloth,
    start: State,
    fabric: Any,
    grain: Any,
    pins: list[Pin],
    terms: list,
    at: At,
) -> None:
    """Make the parts of a system one by one: the error names the table with the mistake."""
    with at("pins"):
        Constraints.bind(pins, cloth)
    written = {"terms": [{"type": table.type} for table in scene.terms], "pins": scene.pins}
    for i, pin in enumerate(pins):
        with errors_at(f"pins.{i}", scene.source, written, scene.text):
            find_clamps(Constraints.bind([pin], cloth), cloth, start)
    with at("fabric" if scene.fabric else "fabrics"):
        Panel.cut(cloth, fabric)
    with at("grain_degrees"):
        Panel.cut(cloth, fabric, grain)
    with at("mass"):
        System(cloth, fabric, (), (), scene.mass, grain)
    for i, term in enumerate(terms):
        with errors_at(f"terms.{i}", scene.source, written, scene.text):
            System(cloth, fabric, [term], (), scene.mass, grain)


def _in_radians(degrees: float | Mapping[str, float]) -> float | dict[str, float]:
    """Return an angle, or the angle of each region, in radians."""
    if isinstance(degrees, Mapping):
        return {region: math.radians(angle) for region, angle in degrees.items()}
    return math.radians(degrees)


def _pin(number: int, table: PinTable, time: AnyTime, cloth: Cloth, at: At) -> Pin:
    """Return the pin of a table after evaluating its motion at all times of the run."""
    key = "inside" if table.where is None else "where"
    with at(f"pins.{number}.{key}"):
        X = cloth.X[cloth.nodes(table.pin.where)]
    pin = table.pin.at(X)
    if isinstance(pin.motion, Motion):
        start = time.t_start
        end = time.t_end
        dt = (end - start) / 1000 if time.dt == "auto" else time.dt
        times = np.append(start, step_times(start, dt, end))
        if pin.motion.by_place:  # at some of the times, to limit the work
            times = times[:: 1 + len(times) * len(X) // MOST_CHECKED_PLACES]
        with at(f"pins.{number}.motion"):
            pin.motion.check(times)
    return pin


def _start(scene: Any, cloth: Cloth, at: At) -> State:
    """Return the state at the start; refuse a node that is too far away or too fast."""
    start = scene.start
    if start.frame:
        with at("start.frame"):
            return replace(read_frame(start.frame, cloth), t=scene.schedule.t_start)
    with at("start.position"):
        if isinstance(scene.cloth, Pieces):
            x = scene.cloth.x(cloth)
        else:
            x = start.x(cloth.X)
        if (distance := np.abs(x).max()) > FARTHEST:
            if start.shift and max(map(abs, start.shift)) > FARTHEST:
                key = "shift"
            else:
                key = "position"
            what = f"start.{key}: a node {distance:g} m away"
            raise SceneError(what, f"must be within {FARTHEST:g} m", scene.source)
    with at("start.velocity"):
        if isinstance(scene.cloth, Pieces):
            v = scene.cloth.v(cloth)
        else:
            v = start.v(cloth.X)
        if (speed := np.abs(v).max()) > LARGEST_SPEED:
            what = f"start.velocity: a node with {speed:g} m/s"
            raise SceneError(what, f"must be at most {LARGEST_SPEED:g} m/s", scene.source)
    with at("start"):
        return make_state(len(cloth.X), x, v, scene.schedule.t_start)


def _check_start(scene: Any, system: System, state: State, at: At) -> None:
    """Refuse a term whose force at the start is not finite, or beyond all measure."""
    for name, term in system.named:
        f = np.zeros_like(state.x)
        with at("start"):
            term.check_start(state.x, state.t, "")
        with at("terms"):
            term.add_force(state.x, state.v, state.t, f)
        if not np.isfinite(f).all():
            allowed = "has no finite force at the start"
            remedy = "Is the start degenerate, or a number far too large?"
            if name.startswith("Gas"):
                remedy = "A Gas needs a volume: give it a dome."
            raise SceneError(f"terms: {name}", allowed, scene.source, remedy)
        if (largest := np.abs(f).max()) > LARGEST_FORCE:
            what = f"terms: {name}: {largest:.1e} N on a node at the start"
            raise SceneError(what, f"must be at most {LARGEST_FORCE:g} N", scene.source)


def _check_method(
    scene: Any, system: System, state: State, steps: StepChoice | Auto, at: At
) -> None:
    """Refuse a method that cannot step the system, and a linear solver that cannot solve it."""
    with at("terms"):
        check_terms(system, steps, "terms")
    if not system.is_whole and (isinstance(steps, Auto) or steps.traits.explicit):
        allowed = "must be an implicit method by name on several processes"
        what = f'time.method = "{scene.time.method.type}"'
        raise SceneError(what, allowed, scene.source, "Take BDF2, or run on one process.")
    if isinstance(steps, LoadSteps):
        _refuse_loads_in_time(scene, system, state)
        return
    with at(""):  # the mass
        steps.check(system)
    if scene.solver.linear != "auto" and not steps.traits.explicit:
        symmetric = has_symmetric_matrix(system, steps)
        with at("solver.linear"):
            select.create(scene.solver.linear, symmetric or scene.solver.definiteness == "clamp")
    insist = f'method = {{ type = "{scene.time.method.type}", beyond_limit = true }}'
    with at("time"):
        steps.check_start(system, state, insist)


def _refuse_loads_in_time(scene: Any, system: System, state: State) -> None:
    """Refuse a term whose force changes with t, at positions that feel it from any direction."""
    x = state.x
    still = np.zeros_like(x)
    waves = np.sin(5 * x[:, [1, 2, 0]] + 3 * x + [1, 2, 3])
    x = x + 0.02 * system.cloth.extent * waves
    for name, term in system.named:
        if term.limits_direction or has_own(term, "work_of_clamps"):
            continue  # it may depend on t, as what it touches, or the normals of clamps, move
        forces = np.zeros((3, *x.shape))
        for t, f in zip((0.0, 0.37, 1.0), forces, strict=True):
            term.add_force(x, still, t, f)
        if not np.array_equal(forces[1:], forces[:2], equal_nan=True):
            allowed = "must not depend on t in a scene with [equilibrium]"
            remedy = "Write its value, or use [time]."
            raise SceneError(f"terms: {name}", allowed, scene.source, remedy)


def _on_request(scene: Any) -> tuple[str, ...]:
    """Return the names of columns that the run has only because the scene names them."""
    names = list(scene.expect)
    if scene.interest:
        names += [quantity.column for quantity in scene.interest.all]
    return on_request(names)


def _check_columns(scene: Any, problem: Problem, probes: tuple[Probe, ...], at: At) -> None:
    """Refuse probes that cannot be bound, and quantities that are no columns of the run."""
    try:
        _ = problem.observer
    except InputError:  # bind the probes one by one, to name the one with the mistake
        for i, probe in enumerate(probes):
            key = "where" if probe.point is None else "point"
            with at(f"probes.{i}.{key}"):
                probe.weights(problem.cloth)
        with at("interest" if scene.interest else "expect"):
            raise
    if scene.expect or scene.interest:
        names = sorted(problem.row().keys() - {"t"})
        refuse_unknown(scene.expect, scene.interest, names, scene.source)
