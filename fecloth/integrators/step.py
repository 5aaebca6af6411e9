"""The result of one step, and the held directions at its end."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.errors import InputError
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import History, System


@dataclass(frozen=True, eq=False)
class Step:
    """The result of one step.

    The optional fields say which forces moved the cloth; the energy ledger and the reactions of
    the pins need them. Without any, it was the force at `balanced_at`.
    """

    state: State
    balanced_at: State  # time, position and velocity at which the method balanced the forces
    # input of the next step: the solved unknown as a first guess, or a record of past values
    # (see `remembered`)
    memory: object
    counts: Counts  # Newton and linear iterations, residual, seconds
    # the system over the step, where terms act over it: its force moved the cloth
    over: System | None = None
    # ((state, M⁻¹ f there (n, 3) [m/s²]), …): the step was by the mean of these forces
    accelerations: tuple[tuple[State, np.ndarray], ...] = ()
    # (system, old state): the ledger takes the mean of the forces at both ends of the step, and
    # power at the mean of both states. They are evaluated once, and only when needed.
    ends: tuple[System, State] | None = None
    # (n, 3) [m/s²] with `ends`: along free directions the method solved M a = f(balanced_at)
    a: np.ndarray | None = None
    # with `ends`: M a is instead the mean of the forces at both ends, with this weight of the
    # new one
    share: float | None = None
    # the records that terms keep, after and before the step (`System.start_history`); None
    # without any
    history: History | None = None
    earlier: History | None = None
    # the size [s] that a choice of steps asked of the method, if it was not that of `march`
    size: float | None = None

    def around(self, system: System) -> tuple[System, System]:
        """The system with the history of its terms before, and after the step."""
        return system.with_history(self.earlier), system.with_history(self.history)

    @cached_property
    def stages(self) -> tuple[State, ...]:
        """States at which the ledger evaluates the power of the forces, with equal weights."""
        if self.ends:
            return (blend(self.ends[1], self.state, 0.5),)
        return tuple(at for at, _ in self.accelerations) or (self.balanced_at,)

    @cached_property
    def end_forces(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) forces [N] at both ends."""
        system, old = self._both_ends()
        return system.force(old), (self.over or system).force(self.state)

    def mean_force(self, system: System) -> np.ndarray:
        """(n, 3) force [N] that moved the cloth over the step."""
        if self.ends:
            old, new = self.end_forces
            mean: np.ndarray = 0.5 * (old + new)
            return mean
        if self.accelerations:
            mass = system.nodal_mass[:, None] / len(self.accelerations)
            force: np.ndarray = mass * sum(a for _, a in self.accelerations)
            return force
        return (self.over or system).force(self.balanced_at)

    @cached_property
    def solved_force(self) -> np.ndarray:
        """(n, 3) the force [N] that equals M a along the free directions, of a step with `ends`."""
        if self.share is None:
            return (self.over or self._both_ends()[0]).force(self.balanced_at)
        return (1 - self.share) * self.end_forces[0] + self.share * self.end_forces[1]

    def _both_ends(self) -> tuple[System, State]:
        if self.ends is None:
            raise InputError("Step.ends = None", "must be (system, old state) here", "Step")
        return self.ends


def blend(old: State, new: State, theta: float) -> State:
    """old + θ (new − old)."""
    dt, dx, dv = new.t - old.t, new.x - old.x, new.v - old.v
    return State(old.t + theta * dt, old.x + theta * dx, old.v + theta * dv)


def prescribed_end(system: System, state: State, dt: float) -> State:
    """Return the state whose held directions follow the pins' motion at the end of a step."""
    x, v = system.constraints.target(state.t, dt, state.x)
    return State(state.t + dt, x, v)


def set_prescribed(system: System, state: State, end: State) -> State:
    """Return the state with its held directions exactly at the prescribed `end`."""
    hold = system.constraints.hold
    return State(state.t, hold(state.x, end.x), hold(state.v, end.v))
