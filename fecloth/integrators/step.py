"""One step of a method: its result, and where the pins put the held directions at its end."""

from __future__ import annotations

from dataclasses import dataclass

from fecloth.nonlinear.statistics import Counts
from fecloth.system.system import State, System


@dataclass(frozen=True, eq=False)
class Step:
    """The result of one step.

    Attributes
    ----------
    state
        The new state.
    stage
        Time, position and velocity at which the method balanced the forces.
    q
        What the next step starts from: the unknown that was found, a good first guess, or the
        method's memory.
    counts
        Newton and linear iterations, residual, seconds.
    """

    state: State
    stage: State
    q: object
    counts: Counts


def arrival(system: System, state: State, dt: float) -> State:
    """Where the pins' motion puts the held directions at the end of a step."""
    x, v = system.constraints.target(state.t, dt, state.x)
    return State(state.t + dt, x, v)


def held(system: System, state: State, end: State) -> State:
    """The state with its held directions at the prescribed end, exactly."""
    hold = system.constraints.hold
    return State(state.t, hold(state.x, end.x), hold(state.v, end.v))
