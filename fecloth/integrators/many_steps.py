"""Many steps of central differences in one call, without any record."""

from functools import lru_cache
from threading import Lock
from typing import Annotated, Any

import numpy as np

from fecloth import validation
from fecloth.compiled.team import ALONE, number_of_threads
from fecloth.errors import InputError, StepFailed, amount
from fecloth.integrators.explicit import LastForce, acceleration
from fecloth.integrators.fused_forces import compiled_force
from fecloth.integrators.fused_steps import FusedSteps
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import TIME
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System

# Steps whose times, and the motion of the pins in them, are kept as arrays at once.
AT_ONCE = 2**14


@checks_arguments
def many_steps(
    system: System, state: State, dt: Annotated[float, TIME], steps: int, threads: int = 1
) -> State:
    """Take many steps of `CentralDifference` in one call of Python; return the last state.

    It is equal to the state of single steps, to round-off. No energies are added up, and no
    stretches are looked at. The end has v and x of the same time, so the next call continues
    the motion.

    Source: as for `CentralDifference`.

    Parameters
    ----------
    system, state
        What moves, and its start: x (n, 3) [m], v (n, 3) [m/s].
    dt, steps
        Step [s], the same for all, and their number.
    threads
        Number of threads that share the work; the result is the same to the last bit. Where
        other processes keep the cores busy, more threads take longer than one, as they wait for
        each other in each step.

    Raises
    ------
    InputError
        For a term or a pin that needs Python in each step, a consistent mass, or a wrong
        number of threads.
    StepFailed
        If the end is not finite, as beyond the limit on dt (see `critical_dt`); its `state` is
        the start, the only state stored.
    """
    check_system(system, state, "many_steps")
    validation.whole("steps", steps, 1, "many_steps")
    validation.number("dt", dt, 0.0, "many_steps")
    if system.after(state.t).releases:
        what = f"a pin with until = {system.releases[-1]:g} s"
        remedy = "Call it for each of system.replace(pins=...), or use march."
        raise InputError(what, "must not let go between the steps", "many_steps", remedy)
    number_of_threads(threads, "many_steps")
    # the lock: Python threads may call this at once
    fused, lock = _bound(system.after(state.t), threads)
    with lock, np.errstate(over="ignore", invalid="ignore"):
        end = _take_all(fused, state, float(dt), steps)
    if end is None:
        taken = f"{amount(steps, 'step')} of dt = {dt:g} s from t = {state.t:g} s"
        raise StepFailed(
            f"{taken} end at values that are not finite. Take a dt below that of critical_dt.",
            state=state,
        )
    return end


def _take_all(fused: FusedSteps, start: State, dt: float, steps: int) -> State | None:
    """Return the state at the end of all steps, or None if values are not finite.

    The steps are taken in portions of `AT_ONCE`. The held velocities of `start` are set to 0.
    """
    v = fused.system.constraints.hold(start.v, np.zeros_like(start.v))
    state = State(start.t, start.x, v)
    memory: Any = LastForce(acceleration(fused.system, state), state)
    for done in range(0, steps, AT_ONCE):
        times = start.t + dt * np.arange(done, min(done + AT_ONCE, steps) + 1)
        taken = fused.take(state, memory, times, np.full(len(times) - 1, dt))
        if taken is None or taken.step is None:
            return None
        state = taken.step.state
        memory = taken.step.memory
    return state


@lru_cache(maxsize=1)  # it takes as long as 500 steps of 2,000 triangles
def _bound(system: System, threads: int | str) -> tuple[FusedSteps, Lock]:
    """Return the fused steps of a system, and the lock of the one caller that may use them.

    Those of the last system are kept. Raises `InputError` for a system that needs Python in
    each step.
    """
    if threads not in (1, system.threads):
        system = system.replace(threads=threads)
    team = ALONE if threads == 1 else None
    fused = FusedSteps.bind(system, ledger=False, team=team)
    if fused is None:
        raise _refused(system)
    return fused, Lock()


def _refused(system: System) -> InputError:
    """Return the error for a system without compiled steps; it names what needs Python.

    It looks at the same conditions as `FusedSteps.bind`, in the same order as far as possible:
    the mass, a term, and last a pin that rotates.
    """
    remedy = "Use march with CentralDifference()."
    if system.mass_kind != "lumped":
        what = f"mass = {system.mass_kind!r}"
        return InputError(what, "must be 'lumped'", "many_steps", remedy)
    x, v, f = np.zeros((3, len(system.cloth.X), 3))
    t = np.zeros(1)
    for name, term in zip(system.names, system.bound, strict=True):
        if compiled_force(term, x, v, t, f) is None:
            allowed = "must not need Python in each step"
            return InputError(f"term {name}", allowed, "many_steps", remedy)
    rotating = [name for name, (pin, _) in system.constraints.groups.items() if pin.rotate]
    return InputError(f"pin {rotating[0]!r}", "must not rotate", "many_steps", remedy)
