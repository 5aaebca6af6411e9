"""Many steps of central differences without Python between them, for any terms that are compiled.

The steps are those of `CentralDifference.step`, to the last bit: the kernels of the terms add to
one force in the same order, and the loops over the nodes round each operation by itself. Work,
dissipation and the numerical dissipation of every step are added up, for the energy ledger.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fecloth.compiled_calls import AnyCall, Call, Calls, JoinedCalls, SharedCall, call, join
from fecloth.integrators.explicit import LastForce
from fecloth.integrators.fused_columns import Column, Moves, bind_columns, subtract_from
from fecloth.integrators.step import Step
from fecloth.jit import Array, rounded_kernel
from fecloth.linalg.reductions import dot
from fecloth.nonlinear.statistics import Counts
from fecloth.system.motion_rows import MotionRows
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.team import ALONE, Team
from fecloth.terms.kinematics import fill_extreme_stretches
from fecloth.terms.loops.array_updates import BY_ROWS
from fecloth.thread_meeting import meet, meet_again

STOP = 8  # place in the row of a thread, on another line of the cache than its round


@dataclass(frozen=True)
class Flows:
    """What the energy ledger adds up over steps [J]: see `Ledger`."""

    dissipated: Mapping[str, float]
    work: Mapping[str, float]
    pins: float
    numerical: float


@dataclass(frozen=True, eq=False)
class Taken:
    """Steps that were taken.

    Attributes
    ----------
    number, state, memory
        Of the steps before the last one; where they end.
    step
        The last one; None if a stretch was beyond its limits before.
    flows
        Of all of them.
    """

    number: int
    state: State
    memory: LastForce
    step: Step | None
    flows: Flows


@dataclass(frozen=True, eq=False)
class FusedSteps:
    """A system ready for `take`: its compiled force, and the arrays on which that works.

    Attributes
    ----------
    x, v, a, ahead, f
        (n, 3) positions, velocities, accelerations, the velocities v + dt a that the force of a
        step sees, and the force.
    calls
        Those of `forces`.
    forces, before, after, look
        Calls that add the forces, those at the begin and the end of a step for the columns of the
        ledger, and one that fills `stretches` (2,): the least and the largest.
    columns
        Of the ledger.
    moves
        What the columns need of a step.
    """

    system: System
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    ahead: np.ndarray
    f: np.ndarray
    inverse_mass: np.ndarray
    moves: Moves
    stretches: np.ndarray
    columns: tuple[Column, ...]
    calls: Calls
    forces: JoinedCalls
    before: JoinedCalls
    after: JoinedCalls
    look: JoinedCalls

    @classmethod
    def bind(cls, system: System) -> FusedSteps | None:
        """Return the fused steps of a system, or None where a term or a pin needs Python."""
        if system.mass_kind != "lumped" or not MotionRows.are_known(system.constraints):
            return None
        shape = len(system.cloth.X), 3
        x, v, a, ahead, f, old_x, old_v = np.zeros((7, *shape))
        x[:] = system.rest().x
        moves, stretches = Moves(np.zeros(1), x, old_x, v, old_v, ahead), np.zeros(2)
        columns = bind_columns(system, shape)
        forces = None if columns is None else _force_calls(system, columns, moves, f)
        if columns is None or forces is None:
            return None
        copies: list[AnyCall] = [(copy, (x, old_x))] if columns else []
        ends: list[AnyCall] = [call for column in columns for call in column.at_end(moves)]
        copies += [(copy, (v, old_v))] if ends else []
        cloth = system.cloth
        data = *cloth.shape, cloth.stencil, cloth.gradients, x, stretches
        return cls(
            system,
            x,
            v,
            a,
            ahead,
            f,
            np.repeat(1.0 / system.nodal_mass, 3),
            moves,
            stretches,
            columns,
            forces,
            join(forces),
            join(copies),
            join(ends),
            join([(fill_extreme_stretches, data)]),
        )

    def take(
        self,
        state: State,
        memory: LastForce,
        times: np.ndarray,
        sizes: np.ndarray,
        look: tuple[int, int],
        least: float,
        largest: float,
    ) -> Taken | None:
        """Take steps of the given sizes, the last one so that its `Step` is known.

        Parameters
        ----------
        state, memory
            The start, and what the step before left.
        times, sizes
            (s + 1,) begin and ends of the steps, (s,) their sizes, equal but for round-off [s].
        look
            (phase, period): after step s, from 0 on, the stretches are looked at if
            (s + phase) % period = period − 1; not after the last one.
        least, largest
            Stretches beyond which no further step is taken.

        Returns
        -------
        Taken
            None if a value is not finite: then nothing is known of these steps.
        """
        rows = MotionRows.of(self.system.constraints, times, sizes)
        self.x[:], self.v[:], self.a[:] = state.x, state.v, memory.a
        self.stretches[:], dt = 1.0, float(sizes[0])
        start, pins, most = self._energy_of_kicks(dt), np.zeros(1), len(sizes) - 1
        if self.columns:
            self._start_columns(memory.at)
        number = self._go(rows, slice(0, most), look, least, largest, pins)
        before, left = self._left(rows, number)
        step = None
        if number == most and least <= self.stretches[0] and self.stretches[1] <= largest:
            self._go(rows, slice(most, None), (0, 2), least, largest, pins)
            new, last = self._left(rows, most + 1)
            forces = (left.at, left.a), (last.at, last.a)
            step = Step(new, last.at, last, Counts(), accelerations=forces)
        if not (np.isfinite(self.x).all() and np.isfinite(self.v).all()):
            return None
        numerical = start - self._energy_of_kicks(dt) - sum(c.unrecorded for c in self.columns)
        flows = Flows(
            {column.name: column.dissipated for column in self.columns if column.dissipates},
            {column.name: column.work for column in self.columns if column.supplies},
            float(pins[0]),
            numerical,
        )
        return Taken(number, before, left, step, flows)

    def _go(
        self,
        rows: MotionRows,
        part: slice,
        look: tuple[int, int],
        least: float,
        largest: float,
        pins: np.ndarray,
    ) -> int:
        """Take a part of the steps; return their number.

        With a team they are taken in portions, of which it times each.
        """
        begin, end, _ = part.indices(len(rows.sizes))
        (phase, period), done = look, begin
        while done < end:
            some = slice(done, done + self._team.portion("steps", end - done))
            phase_there = phase + done - begin, period
            done += self._go_on(rows, some, phase_there, least, largest, pins)
            if done < some.stop:
                break
            if not (least <= self.stretches[0] and self.stretches[1] <= largest):
                break
        return done - begin

    def _go_on(
        self,
        rows: MotionRows,
        part: slice,
        look: tuple[int, int],
        least: float,
        largest: float,
        pins: np.ndarray,
    ) -> int:
        """Take a portion of steps; return their number."""
        constraints, team = self.system.constraints, self._team
        moving = slice(None) if len(rows.path) == 1 else part
        held = np.empty((4, len(constraints.nodes), 3))
        data = (
            *(calls.address for calls in (self.before, self.after, self.look)),
            rows.sizes[part],
            self.moves.clock,
            *look,
            self.stretches,
            least,
            largest,
            constraints.nodes,
            np.ascontiguousarray(constraints.projectors),
            rows.path[moving],
            rows.speed[moving],
            self.system.nodal_mass,
            pins,
            held[:3],
            held[3],
            *(self.inverse_mass, self.x, self.v, self.a, self.ahead, self.f),
        )

        def alone() -> int:
            rounds = np.zeros((1, STOP + 1), np.int64)
            return take_steps(self.forces.address, *data, np.zeros(1, np.int64), rounds, 0)

        def together() -> int:
            shared = self.shared_forces
            shared.meeting[:], shared.rounds[:], shared.rounds[:, 0] = 0, 0, 1

            def steps(p: int) -> int:
                return take_steps(shared.calls[p].address, *data, shared.meeting, shared.rounds, p)

            return team.run(steps, shared.meeting)

        return team.do("steps", alone, together, part.stop - part.start, float)

    @property
    def _team(self) -> Team:
        team = self.system.team
        return team if team.shares(len(self.x)) else ALONE

    @cached_property
    def shared_forces(self) -> SharedForces:
        """The calls of `forces` for each thread."""
        return SharedForces.of(self.calls, self.system.team.count)

    def _left(self, rows: MotionRows, number: int) -> tuple[State, LastForce]:
        """The state and the memory after that many steps."""
        x = self.x.copy()
        at = State(float(rows.reached[number - 1]), x, self.ahead.copy())
        return State(float(rows.times[number]), x, self.v.copy()), LastForce(self.a.copy(), at)

    def _energy_of_kicks(self, dt: float) -> float:
        """dt²/8 a·M a of the free directions: M Δv · (Δx/dt − v̄) is its decrease in a step."""
        free = self.system.constraints.project(self.a.copy())
        return 0.125 * dt * dt * dot(self.a * self.system.nodal_mass[:, None], free)

    def _start_columns(self, at: State) -> None:
        """Evaluate the forces of the columns at the first state."""
        self.moves.old_x[:], self.ahead[:], self.f[:] = self.x, at.v, 0.0
        self.forces()
        for column in self.columns:
            column.start()


@dataclass(frozen=True, eq=False)
class SharedForces:
    """Forces for several threads, which meet after each call.

    Attributes
    ----------
    calls
        Of each thread.
    meeting, rounds
        (1,) and (threads, STOP + 1), for `meet`: the round of a thread comes first in its row.
    """

    calls: tuple[JoinedCalls, ...]
    meeting: np.ndarray
    rounds: np.ndarray

    @classmethod
    def of(cls, calls: Calls, threads: int) -> SharedForces:
        """Divide calls among threads; what cannot be divided is for the first thread."""
        meeting, rounds = np.zeros(1, np.int64), np.zeros((threads, STOP + 1), np.int64)
        lists: list[list[Call]] = [[] for _ in range(threads)]
        for each in calls:
            for p, own in enumerate(lists):
                own += _calls_of(each, p, threads)
                own.append((meet_again, (meeting, threads, rounds[p])))
        return cls(tuple(map(join, lists)), meeting, rounds)


def _calls_of(each: AnyCall, p: int, threads: int) -> list[Call]:
    """What thread p does of a call."""
    if isinstance(each, SharedCall):
        return each.of_thread(p)
    function, arguments = each
    if function in BY_ROWS or function in (copy, subtract_from):
        own = (_rows_of(value, p, threads) for value in arguments)
        return [(function, tuple(own))]
    return [each] if p == 0 else []


def _rows_of(value: object, p: int, threads: int) -> object:
    if not isinstance(value, np.ndarray):
        return value
    return value[len(value) * p // threads : len(value) * (p + 1) // threads]


def _force_calls(
    system: System, columns: tuple[Column, ...], moves: Moves, f: Array
) -> Calls | None:
    """The calls that add all forces to f, with those that take out the columns' parts."""
    calls: list[AnyCall] = []
    of_term = {column.name: column for column in columns}
    x, v = moves.x, moves.ahead
    for name, term in zip(system.names, system.bound, strict=True):
        own = compiled_force(term, x, v, f)
        if own is None:
            return None
        column = of_term.get(name)
        if column is None:
            calls += own
            continue
        elastic = compiled_force(term, x, np.zeros_like(v), column.base) if term.has_energy else []
        calls += [(copy, (f, column.base)), *(elastic or []), *own, column.at_force(f, moves)]
    return calls


def compiled_force(term: Any, x: np.ndarray, v: np.ndarray, f: np.ndarray) -> Calls | None:
    """Return the calls of a term's force, or None where it needs Python.

    A class that overrides `add_force` alone has inherited the calls of another force.
    """
    kinds = type(term).__mro__
    force = next(kind for kind in kinds if "add_force" in vars(kind))
    calls = next((kind for kind in kinds if "force_calls" in vars(kind)), None)
    if calls is None or not issubclass(calls, force):
        return None
    found: Calls | None = term.force_calls(x, v, 0.0, f)
    return found


@rounded_kernel
def copy(a: Array, b: Array) -> None:
    """b (n, 3) = a."""
    a, b = a.reshape(-1), b.reshape(-1)
    for i in range(len(a)):
        b[i] = a[i]


@rounded_kernel
def drift(x: Array, v: Array, a: Array, dt: float, ahead: Array, f: Array) -> None:
    """As `explicit.move` with a share of ½, in place; f = 0."""
    x, v, a = x.reshape(-1), v.reshape(-1), a.reshape(-1)
    ahead, f = ahead.reshape(-1), f.reshape(-1)
    for i in range(len(x)):
        dv = dt * a[i]
        x[i] += dt * (v[i] + 0.5 * dv)
        ahead[i] = v[i] + dv
    for i in range(len(f)):  # by itself: the compiler vectorises loops over few arrays
        f[i] = 0.0


@rounded_kernel
def turn(f: Array, inverse_mass: Array, dt: float, v: Array, a: Array) -> None:
    """As `explicit.divide` and `explicit.kick`, in place: the new a takes the place of the old."""
    f, v, a = f.reshape(-1), v.reshape(-1), a.reshape(-1)
    for i in range(len(f)):
        b = f[i] * inverse_mass[i]
        v[i] += 0.5 * dt * (a[i] + b)
        a[i] = b


@rounded_kernel
def set_rows(at: Array, P: Array, target: Array, y: Array) -> None:
    """As `constraints._set_held`, with a row of `target` for each of the nodes `at`."""
    for n in range(len(at)):
        i = at[n]
        d1, d2, d3 = y[i, 0] - target[n, 0], y[i, 1] - target[n, 1], y[i, 2] - target[n, 2]
        for k in range(3):
            y[i, k] = target[n, k] + (P[n, k, 0] * d1 + P[n, k, 1] * d2 + P[n, k, 2] * d3)


@rounded_kernel
def pin_work(
    at: Array, P: Array, mass: Array, dt: float, old: Array, x: Array, v: Array, a: Array
) -> float:
    """Σ m (Δv · v̄ − ā · Δx) along held directions; `old` (3, c, 3) are x, v and a before."""
    total = 0.0
    for n in range(len(at)):
        i = at[n]
        for k in range(3):
            held_v, held_x = 0.0, 0.0
            for j in range(3):
                out = (1.0 if j == k else 0.0) - P[n, k, j]
                held_v += out * (0.5 * (v[i, j] + old[1, n, j]))
                held_x += out * (x[i, j] - old[0, n, j])
            mean = 0.5 * (a[i, k] + old[2, n, k])
            total += mass[i] * ((v[i, k] - old[1, n, k]) * held_v - mean * held_x)
    return total


@rounded_kernel
def take_steps(
    forces: int,
    before: int,
    after: int,
    look: int,
    sizes: Array,
    clock: Array,
    phase: int,
    period: int,
    stretches: Array,
    least: float,
    largest: float,
    at: Array,
    P: Array,
    path: Array,
    speed: Array,
    mass: Array,
    pins: Array,
    old: Array,
    target: Array,
    inverse_mass: Array,
    x: Array,
    v: Array,
    a: Array,
    ahead: Array,
    f: Array,
    meeting: Array,
    rounds: Array,
    thread: int,
) -> int:
    """Take the steps in place; return their number: fewer if a stretch is beyond its limits.

    Each thread calls it with its number and its own `forces`, and moves its own nodes; `rounds` has
    a row for each thread. The first thread does what needs all nodes.
    """
    threads = len(rounds)
    begin, end = len(x) * thread // threads, len(x) * (thread + 1) // threads
    own, of_x = slice(begin, end), slice(3 * begin, 3 * end)
    round_ = rounds[thread]
    for s in range(len(sizes)):
        dt, row = sizes[s], min(s, len(path) - 1)
        if thread == 0 and rounds[0, STOP] == 0:
            clock[0] = dt
            call(before)
            for n in range(len(at)):
                for k in range(3):
                    i = at[n]
                    old[0, n, k], old[1, n, k], old[2, n, k] = x[i, k], v[i, k], a[i, k]
                    target[n, k] = x[i, k] + path[row, n, k]
        round_[0] = meet(meeting, threads, round_[0])
        if rounds[0, STOP] != 0:
            return s
        drift(x[own], v[own], a[own], dt, ahead[own], f[own])
        round_[0] = meet(meeting, threads, round_[0])
        if len(at) > 0:
            if thread == 0:
                set_rows(at, P, target, x)
                set_rows(at, P, speed[row], ahead)
            round_[0] = meet(meeting, threads, round_[0])
        call(forces)
        turn(f[own], inverse_mass[of_x], dt, v[own], a[own])
        round_[0] = meet(meeting, threads, round_[0])
        if thread == 0:
            set_rows(at, P, speed[row], v)
            pins[0] += pin_work(at, P, mass, dt, old, x, v, a)
            call(after)
            if (s + phase) % period == period - 1:
                call(look)
                if not (stretches[0] >= least and stretches[1] <= largest):
                    rounds[0, STOP] = 1
    return len(sizes)
