"""The objects of a scene, each made once: system, start, method, what is recorded."""

import math
import warnings
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fecloth.compiled.team import number_of_threads
from fecloth.errors import FeclothWarning, InputError, SceneError
from fecloth.fabric.panel import Panel
from fecloth.homogenisation import bending_note
from fecloth.integrators.protocol import StepChoice, check_terms, has_symmetric_matrix
from fecloth.linalg import select
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.static_equation import EquilibriumFailed
from fecloth.output.frames import read_frame
from fecloth.scene.cloth_tables import Pieces
from fecloth.scene.error_words import errors_at
from fecloth.scene.placement import PinTable
from fecloth.scene.probe_tables import read_measured, refuse_unknown
from fecloth.scene.problem import Problem
from fecloth.scene.schedule import EquilibriumTable, Time
from fecloth.simulation.defined_in_time import refuse_undefined
from fecloth.simulation.disturbance import bend_by_mode, lift_by_waves
from fecloth.simulation.doubts.units import refuse_start_in_other_units
from fecloth.simulation.equilibrium import equilibrium
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.on_request import on_request
from fecloth.simulation.probes import SHAPE_COLUMNS, Probe
from fecloth.simulation.step_times import step_times
from fecloth.simulation.steps import Memory
from fecloth.system.clamps import find_clamps
from fecloth.system.constraints import Constraints
from fecloth.system.pins import Motion, Pin
from fecloth.system.state import State, make_state
from fecloth.system.system import System
from fecloth.terms.custom.condition import RESERVED
from fecloth.terms.protocol import has_own
from fecloth.validation import FARTHEST

# No cloth has larger values. They are refused by the name of their key, not by a failed step.
LARGEST_SPEED = 1e6  # m/s of a node at the start
LARGEST_FORCE = 1e15  # N of a term on a node at the start
# Times × nodes at which a motion of t, X and Y is checked before a run: it limits the work.
MOST_CHECKED_PLACES = 1_000_000

AnyTime = Time | EquilibriumTable
# `errors_at` for the file of the scene: in a block ``with errors_of_key("terms"):`` an
# `InputError` becomes a `SceneError` that names the file and the key "terms".
ErrorsOfKey = Callable[[str], AbstractContextManager[None]]


def build(scene: Any, cloth: Cloth, make_system: Callable[..., System] = System) -> Problem:
    """Return the objects of a `Scene` on a cloth, ready to run.

    Bind terms and pins to the cloth, place the start and choose the steps. `make_system` takes
    the arguments of `System`. Raise `SceneError`, with the key of the mistake, for a start, a
    method, a solver, a probe or a quantity that this cloth does not allow.
    """
    errors_of_key = partial(errors_at, where=scene.source)
    state = _make_start(scene, cloth, errors_of_key)
    system = _bind_system(scene, cloth, state, errors_of_key, make_system)
    state = _disturb_start(scene, system, state, errors_of_key)
    _check_start(scene, system, state, errors_of_key)
    steps = scene.schedule.steps()
    _check_method(scene, system, state, steps, errors_of_key)
    probes = tuple(table.probe() for table in scene.probes)
    if scene.expect:
        pattern = getattr(scene.cloth, "pattern", "")
        note = bending_note(pattern, [term.type for term in scene.terms])
    else:
        note = ""
    with errors_of_key("measured"):
        measured = read_measured(scene.measured, (*system.names, *RESERVED))
        interest = scene.quantities
    asked = [*scene.expect, *(quantity.column for quantity in interest)]
    problem = Problem(
        system,
        state,
        steps,
        interest=interest,
        measured=measured,
        error_in_time=scene.time.error_in_time if scene.time else "none",
        t_end=scene.schedule.t_end,
        unit=scene.schedule.unit,
        newton=scene.solver.make(),
        linear=scene.solver.linear,
        probes=(*probes, *on_request(asked)),
        shape=not SHAPE_COLUMNS.isdisjoint(asked),
        # With a memory the start is not checked again; `_check_method` has done so.
        memory=Memory(step=0, start=state.t, method_memory=None),
        frame_steps=scene.output.steps(scene.schedule),
        stops=scene.output.stops(scene.schedule),
        note=note,
        output=scene.output,
    )
    _check_columns(scene, problem, probes, errors_of_key)
    with errors_of_key(""):
        refuse_undefined(problem.planned)
    return problem


def _bind_system(
    scene: Any, cloth: Cloth, start: State, errors_of_key: ErrorsOfKey, make_system: Callable
) -> System:
    """Return the system: the terms and pins of a scene, bound to the cloth.

    Raise `SceneError`, with the key of the table with the mistake, for what does not fit.
    """
    pins = [
        _make_pin(number, table, scene.schedule, cloth, errors_of_key)
        for number, table in enumerate(scene.pins)
    ]
    if scene.fabric:
        fabric = scene.fabric.make()
    else:
        fabric = {region: table.make() for region, table in scene.fabrics.items()}
    grain = _in_radians(scene.grain_degrees)
    terms = [term.make() for term in scene.terms]
    threads = scene.solver.threads
    with errors_of_key("solver.threads"):
        number_of_threads(threads)  # only to refuse a wrong number by the name of its key
    try:
        seams = [table.make() for table in scene.seams]
        given = cloth, fabric, terms, pins, scene.mass, grain, start
        return make_system(*given, threads=threads, seams=seams)
    except InputError:
        # Find the part with the mistake. If each part alone is valid, the terms do not fit
        # together.
        _refuse_parts(scene, cloth, start, fabric, grain, pins, terms, errors_of_key)
        with errors_of_key("terms"):
            raise


def _refuse_parts(
    scene: Any,
    cloth: Cloth,
    start: State,
    fabric: Any,
    grain: Any,
    pins: list[Pin],
    terms: list,
    errors_of_key: ErrorsOfKey,
) -> None:
    """Raise `SceneError` for the first part that alone makes no system, by its key.

    A message about one of several pins or terms also has its type and its line in the file.
    """
    with errors_of_key("pins"):
        Constraints.bind(pins, cloth)
    written = {"terms": [{"type": table.type} for table in scene.terms], "pins": scene.pins}
    for i, pin in enumerate(pins):
        with errors_at(f"pins.{i}", scene.source, written, scene.text):
            find_clamps(Constraints.bind([pin], cloth), cloth, start)
    _refuse_seams(scene, cloth, terms, pins, errors_of_key)
    with errors_of_key("fabric" if scene.fabric else "fabrics"):
        Panel.cut(cloth, fabric)
    with errors_of_key("grain_degrees"):
        Panel.cut(cloth, fabric, grain)
    with errors_of_key("mass"):
        System(cloth, fabric, terms=(), pins=(), mass=scene.mass, grain=grain)
    for i, term in enumerate(terms):
        with errors_at(f"terms.{i}", scene.source, written, scene.text):
            System(cloth, fabric, [term], pins=(), mass=scene.mass, grain=grain)


def _refuse_seams(
    scene: Any, cloth: Cloth, terms: list, pins: list[Pin], errors_of_key: ErrorsOfKey
) -> None:
    """Raise `SceneError` for the first seam that alone makes no system; else for all together."""
    seams = [table.make() for table in scene.seams]
    for i, seam in enumerate(seams):
        with errors_of_key(f"seams.{i}"):
            seam.complete([seam], cloth, tuple(terms))
            seam.sew([seam], cloth, Constraints.bind((), cloth))
    with errors_of_key("seams"):
        for seam in seams[:1]:
            seam.sew(seams, cloth, Constraints.bind(pins, cloth))


def _in_radians(degrees: float | Mapping[str, float]) -> float | dict[str, float]:
    """Return an angle, or the angle of each region, in radians."""
    if isinstance(degrees, Mapping):
        return {region: math.radians(angle) for region, angle in degrees.items()}
    return math.radians(degrees)


def _make_pin(
    number: int, table: PinTable, time: AnyTime, cloth: Cloth, errors_of_key: ErrorsOfKey
) -> Pin:
    """Return pin `number` of a scene, whose nodes and motion are valid in the whole run.

    Raise `SceneError`, with its key, if it holds no nodes, or if its motion has no value at a
    time of the run. A motion by place is tested at some of the times only.
    """
    key = "inside" if table.where is None else "where"
    with errors_of_key(f"pins.{number}.{key}"):
        cloth.nodes(table.pin.where)
    with errors_of_key(f"pins.{number}.without"):
        X = cloth.X[table.pin.nodes(cloth)]
    with errors_of_key(f"pins.{number}"):
        _check_release(table.until, time)
    pin = table.pin.at(X)
    if isinstance(pin.motion, Motion):
        start = time.t_start
        end = time.t_end
        # Steps that are still to be chosen are not known: test the motion at 1000 times.
        dt = (end - start) / 1000 if time.dt == "auto" else time.dt
        times = np.append(start, step_times(start, dt, end))
        if pin.motion.by_place:  # at some of the times, to limit the work
            times = times[:: 1 + len(times) * len(X) // MOST_CHECKED_PLACES]
        with errors_of_key(f"pins.{number}.motion"):
            pin.motion.check(times)
    return pin


def _check_release(until: float | None, time: AnyTime) -> None:
    """Raise `InputError` for a time of release in a static scene, or not after the start."""
    if until is None:
        return
    if isinstance(time, EquilibriumTable):
        raise InputError(f"until = {until:g}", "needs [time]: an equilibrium has no time")
    if until <= time.t_start:
        allowed = f"must be after the start, at {time.t_start:g} s"
        raise InputError(f"until = {until:g}", allowed, remedy="Leave the pin out.")


def _make_start(scene: Any, cloth: Cloth, errors_of_key: ErrorsOfKey) -> State:
    """Return the state at the start.

    Raise `SceneError`, with the key, for a start that cannot be made, and for a node farther
    than `FARTHEST` or faster than `LARGEST_SPEED`. A frame is not tested: a run wrote it.
    """
    start = scene.start
    if start.frame:
        with errors_of_key("start.frame"):
            return replace(read_frame(start.frame, cloth), t=scene.schedule.t_start)
    with errors_of_key("start.position"):
        if isinstance(scene.cloth, Pieces):
            x = scene.cloth.x(cloth)
        else:
            x = start.x(cloth.X, cloth.start)
        if (distance := np.abs(x).max()) > FARTHEST:
            # A shift this large is the mistake, whatever the position before it.
            if start.shift and max(map(abs, start.shift)) > FARTHEST:
                key = "shift"
            else:
                key = "position"
            what = f"start.{key}: a node {distance:g} m away"
            raise SceneError(what, f"must be within {FARTHEST:g} m", scene.source)
    with errors_of_key("start.velocity"):
        if isinstance(scene.cloth, Pieces):
            v = scene.cloth.v(cloth)
        else:
            v = start.v(cloth.X)
        if (speed := np.abs(v).max()) > LARGEST_SPEED:
            what = f"start.velocity: a node with {speed:g} m/s"
            raise SceneError(what, f"must be at most {LARGEST_SPEED:g} m/s", scene.source)
    with errors_of_key("start"):
        return make_state(len(cloth.X), x, v, scene.schedule.t_start)


def _disturb_start(scene: Any, system: System, state: State, errors_of_key: ErrorsOfKey) -> State:
    """Return the state at the start, lifted by waves and bent by a mode, as [start] asks for.

    Raise `SceneError` for a cloth on several processes, for a mode that does not exist, and
    where the equilibrium without it is not found.
    """
    start = scene.start
    if not start.is_disturbed:
        return state
    key = "disturb" if start.disturb else "mode"
    if not system.is_whole:
        raise SceneError(f"start.{key} is given", "needs one process", scene.source)
    x = state.x
    if start.disturb:
        x = lift_by_waves(system, x, start.disturb, seed=0)
    if start.mode:
        most = system.admissible.shape[1] - 1
        if start.mode > most:
            what = f"start.mode = {start.mode}"
            raise SceneError(what, f"must be at most {most}: there are no more", scene.source)
        about = _state_of_mode(scene, system, state)
        x = bend_by_mode(system, x, about, start.mode, start.amplitude)
    with errors_of_key(f"start.{key}"):
        return make_state(len(x), x, state.v, state.t)


def _state_of_mode(scene: Any, system: System, state: State) -> State:
    """Return the state about which the mode of [start] is taken, as `fecloth modes` does."""
    static = scene.equilibrium
    if not static:
        return state
    try:
        with warnings.catch_warnings(category=FeclothWarning, action="ignore"):
            return equilibrium(
                system,
                state,
                load_steps=static.load_steps,
                friction=static.friction,
                tolerance=static.tolerance,
                max_iterations=static.max_iterations,
            )
    except EquilibriumFailed as failure:
        what = f"start.mode = {scene.start.mode}"
        allowed = f"needs the equilibrium without it: {failure.reason}"
        raise SceneError(what, allowed, scene.source, 'Take disturb = "1 mm".') from failure


def _check_start(scene: Any, system: System, state: State, errors_of_key: ErrorsOfKey) -> None:
    """Raise `SceneError` for a term that cannot begin from the start.

    That is a term that refuses the positions (such as contact of a cloth inside an obstacle),
    one whose force is not finite, or one with a force above `LARGEST_FORCE` on a node. Also raise
    it for positions in another unit than the cloth.
    """
    with errors_of_key("start"):
        refuse_start_in_other_units(system.cloth, state.x, where="")
    for i, seam in enumerate(system.seams):
        with errors_of_key(f"seams.{i}"):
            seam.check_start(system, state.x, state.t, where="")
    for name, term in system.named:
        f = np.zeros_like(state.x)  # forces [N], (n, 3)
        with errors_of_key("start"):
            term.check_start(state.x, state.t, where="")  # `errors_of_key` adds it
        with errors_of_key("terms"):
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
    scene: Any, system: System, state: State, steps: StepChoice | Auto, errors_of_key: ErrorsOfKey
) -> None:
    """Raise `SceneError` for a method or a linear solver that this system does not allow.

    Refused are: terms that the method cannot take; explicit and automatic methods on several
    processes; loads that depend on t in a static scene; a mass, a linear solver or a step that
    does not fit the method.
    """
    with errors_of_key("terms"):
        check_terms(system, steps, "terms")
    # A system on several processes is not whole: each process has a part of the cloth.
    if not system.is_whole and (isinstance(steps, Auto) or steps.traits.explicit):
        allowed = "must be an implicit method by name on several processes"
        what = f'time.method = "{scene.time.method.type}"'
        raise SceneError(what, allowed, scene.source, "Take BDF2, or run on one process.")
    if isinstance(steps, LoadSteps):
        _refuse_loads_in_time(scene, system, state)
        return
    with errors_of_key(""):  # it refuses a kind of mass by a message that has the key already
        steps.check(system)
    if scene.solver.linear != "auto" and not steps.traits.explicit:
        # With definiteness = "clamp" the matrix is made symmetric, whatever the terms.
        symmetric = has_symmetric_matrix(system, steps) or scene.solver.definiteness == "clamp"
        with errors_of_key("solver.linear"):
            select.create(scene.solver.linear, symmetric)  # only to refuse an unfit solver
    # what to write to run beyond the stability limit all the same
    insist = f'method = {{ type = "{scene.time.method.type}", beyond_limit = true }}'
    with errors_of_key("time"):
        steps.check_start(system, state, insist)


def _refuse_loads_in_time(scene: Any, system: System, state: State) -> None:
    """Raise `SceneError` for a term whose force changes with t while no node moves.

    The forces at t = 0, 0.37 and 1 must be equal bit for bit. They are compared on a cloth with
    waves of 2 % of its extent along x, y and z, because a load may be zero on a flat cloth.
    """
    still = np.zeros_like(state.x)  # the velocities
    # Each coordinate has its own wave, so that no symmetry of the start remains.
    waves = np.sin(5 * state.x[:, [1, 2, 0]] + 3 * state.x + [1, 2, 3])
    x = state.x + 0.02 * system.cloth.extent * waves
    for name, term in system.named:
        if term.limits_direction or has_own(term, "work_of_clamps"):
            # Contact and clamped bending may depend on t: the obstacles, and the normals of
            # the clamps, may move.
            continue
        forces = np.zeros((3, *x.shape))
        for t, f in zip((0.0, 0.37, 1.0), forces, strict=True):
            term.add_force(x, still, t, f)
        if not np.array_equal(forces[1:], forces[:2], equal_nan=True):
            allowed = "must not depend on t in a scene with [equilibrium]"
            remedy = "Write its value, or use [time]."
            raise SceneError(f"terms: {name}", allowed, scene.source, remedy)


def _check_columns(
    scene: Any, problem: Problem, probes: tuple[Probe, ...], errors_of_key: ErrorsOfKey
) -> None:
    """Raise `SceneError` for a probe that cannot be bound, or a quantity without a column.

    The tables [expect], [interest] and [measured] name these quantities.
    """
    try:
        _ = problem.observer  # made here: that binds all probes, and the columns on request
    except InputError:  # bind the probes one by one, to name the one with the mistake
        for i, probe in enumerate(probes):
            key = "where" if probe.point is None else "point"
            with errors_of_key(f"probes.{i}.{key}"):
                probe.weights(problem.cloth)
        # All probes are valid: the mistake is in a column on request.
        tables = ("interest", "measured", "expect")
        with errors_of_key(next(name for name in tables if getattr(scene, name))):
            raise
    if scene.expect or scene.interest or scene.measured:
        names = sorted(problem.row().keys() - {"t"})
        refuse_unknown(scene.expect, scene.interest, problem.measured, names, scene.source)
