"""Many steps of central differences without Python between them, for any terms that are compiled.

The steps are the steps of `CentralDifference.step`, to the last bit: the kernels of the terms
add to one force in the same order, and the loops over the nodes round each operation by
itself. Work, dissipation and the numerical dissipation of every step are added up, for the
energy ledger.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from fecloth.compiled.calls import AnyCall, Calls, JoinedCalls, join
from fecloth.compiled.team import ALONE, Team
from fecloth.compiled.threads import ONLY
from fecloth.integrators.explicit import LastForce
from fecloth.integrators.fused_forces import Column, Moves, SharedForces, bind_columns, force_calls
from fecloth.integrators.fused_loops import Fields, Held, Pauses, copy, take_steps
from fecloth.integrators.step import Step
from fecloth.linalg.reductions import dot
from fecloth.nonlinear.statistics import Counts
from fecloth.system.constraints import MotionRows
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import fill_extreme_stretches

NO_LOOK = 0, 2**62  # at stretches: after no step


@dataclass(frozen=True)
class Flows:
    """What the energy ledger adds up over steps [J]: see `Ledger`."""

    dissipated: Mapping[str, float]
    work: Mapping[str, float]
    pins: float
    numerical: float


@dataclass(frozen=True, eq=False)
class Taken:
    """Steps that were taken."""

    # Of the steps before the last one; where they end.
    number: int
    state: State
    memory: LastForce
    step: Step | None  # the last one; None if a stretch was beyond its limits before
    flows: Flows  # of all of them


@dataclass(frozen=True, eq=False)
class FusedSteps:
    """A system ready for `take`: its compiled force, and the arrays on which that works."""

    system: System
    # The threads, and the arrays that steps change.
    team: Team
    fields: Fields
    moves: Moves  # what the columns need of a step
    stretches: np.ndarray
    columns: tuple[Column, ...]  # of the ledger
    calls: Calls  # the calls of `forces`
    # Calls that add the forces, calls at the begin and the end of a step for the columns of the
    # ledger, and one that fills `stretches` (2,): the least and the largest.
    forces: JoinedCalls
    before: JoinedCalls
    after: JoinedCalls
    look: JoinedCalls

    @classmethod
    def bind(cls, system: System, ledger: bool = True, team: Team | None = None) -> Self | None:
        """Return the fused steps of a system, or None where a term or a pin needs Python.

        With `ledger` the columns of the energy ledger are added up; otherwise `flows` has none.
        The threads are the threads of the system, unless a `team` is given.
        """
        if system.mass_kind != "lumped" or not MotionRows.can_evaluate(system.constraints):
            return None
        shape = (len(system.cloth.X), 3)
        mass = system.nodal_mass
        x, v, a, ahead, f, old_x, old_v = np.zeros((7, *shape))
        x[:] = system.rest().x
        moves = Moves(np.zeros(1), x, old_x, v, old_v, ahead)
        stretches = np.zeros(2)
        columns = bind_columns(system, shape) if ledger else ()
        if columns is None:
            forces = None
        else:
            forces = force_calls(system, columns, moves, f)
        if columns is None or forces is None:
            return None
        copies: list[AnyCall] = [(copy, (x, old_x))] if columns else []
        ends: list[AnyCall] = [call for column in columns for call in column.at_end(moves)]
        copies += [(copy, (v, old_v))] if ends else []
        cloth = system.cloth
        data = *cloth.shape, cloth.stencil, cloth.gradients, x, stretches
        look = join([(fill_extreme_stretches, data)])
        fields = Fields(x, v, a, ahead, f, mass, np.repeat(1.0 / mass, 3))
        joined = join(forces), join(copies), join(ends), look
        return cls(system, team or system.team, fields, moves, stretches, columns, forces, *joined)

    def take(
        self,
        state: State,
        memory: LastForce,
        times: np.ndarray,
        sizes: np.ndarray,
        look: tuple[int, int] = NO_LOOK,
        least: float = 0.0,
        largest: float = np.inf,
    ) -> Taken | None:
        """Take steps of the given sizes, the last one so that its `Step` is known.

        `times` (s + 1,) are the begin and the ends of the steps [s], `sizes` (s,) are equal
        but for round-off. With `look` = (phase, period) the stretches are looked at after step
        s, from 0 on, if (s + phase) % period = period − 1, but not after the last one. Beyond
        the stretches `least` and `largest` no further step is taken. The result is None if a
        value is not finite: then nothing is known of these steps.
        """
        rows = MotionRows.evaluate(self.system.constraints, times, sizes)
        held = self._held(rows)
        dt = float(sizes[0])
        most = len(sizes) - 1
        self._begin_at(state, memory)
        start = self._energy_of_kicks(dt)
        pauses = self._pauses(look, least, largest)
        number = self._go(sizes[:most], held.over(slice(0, most)), pauses)
        before, left = self._left(rows, number)
        step = None
        if not pauses.stop[0]:
            never = self._pauses(NO_LOOK, least, largest)
            self._go(sizes[most:], held.over(slice(most, None)), never)
            new, last = self._left(rows, most + 1)
            forces = (left.at, left.a), (last.at, last.a)
            step = Step(new, last.at, last, Counts(), accelerations=forces)
        if not self._is_finite:
            return None
        numerical = start - self._energy_of_kicks(dt) - sum(c.unrecorded for c in self.columns)
        flows = Flows(
            {column.name: column.dissipated for column in self.columns if column.dissipates},
            {column.name: column.work for column in self.columns if column.supplies},
            float(held.work[0]),
            numerical,
        )
        return Taken(number, before, left, step, flows)

    @property
    def _is_finite(self) -> bool:
        return bool(np.isfinite(self.fields.x).all() and np.isfinite(self.fields.v).all())

    def _begin_at(self, state: State, memory: LastForce) -> None:
        """Take over a state, and the forces of the columns at it."""
        fields = self.fields
        fields.x[:] = state.x
        fields.v[:] = state.v
        fields.a[:] = memory.a
        if self.columns:
            self.moves.old_x[:] = state.x
            fields.ahead[:] = memory.at.v
            fields.f[:] = 0.0
            self.forces()
        for column in self.columns:
            column.start()
        self.stretches[:] = 1.0

    def _held(self, rows: MotionRows) -> Held:
        """The nodes that are held, over all of the steps."""
        nodes = self.system.constraints.nodes
        projectors = self.system.constraints.projectors
        before = np.empty((4, len(nodes), 3))
        fixed = nodes, np.ascontiguousarray(projectors), rows.path, rows.speed
        return Held(*fixed, before[:3], before[3], np.zeros(1))

    def _pauses(self, look: tuple[int, int], least: float, largest: float) -> Pauses:
        calls = self.before.address, self.after.address, self.look.address
        arrays = self.moves.clock, self.stretches, np.zeros(1, np.int64)
        return Pauses(*calls, *look, least, largest, *arrays)

    def _go(self, sizes: np.ndarray, held: Held, pauses: Pauses) -> int:
        """Take steps, with a team in portions of which it times each; return their number."""
        done = 0
        while done < len(sizes) and not pauses.stop[0]:
            end = done + self._team.portion("steps", len(sizes) - done)
            there = held.over(slice(done, end)), pauses._replace(phase=pauses.phase + done)
            done += self._go_on(sizes[done:end], *there)
        return done

    def _go_on(self, sizes: np.ndarray, held: Held, pauses: Pauses) -> int:
        data = (sizes, pauses, held, self.fields)
        team = self._team

        def alone() -> int:
            return take_steps(self.forces.address, *data, ONLY)

        def together() -> int:
            shared = self.shared_forces
            shared.start()
            addresses = [calls.address for calls in shared.calls]
            members = shared.members
            return team.run(
                lambda p: take_steps(addresses[p], *data, members[p]), members[0].meeting
            )

        return team.do("steps", alone, together, float)

    @property
    def _team(self) -> Team:
        if self.team.shares(len(self.fields.mass)):
            return self.team
        return ALONE

    @cached_property
    def shared_forces(self) -> SharedForces:
        return SharedForces.divide(self.calls, self.team.count)

    def _left(self, rows: MotionRows, number: int) -> tuple[State, LastForce]:
        x, v, a, ahead = (array.copy() for array in self.fields[:4])
        at = State(float(rows.reached[number - 1]), x, ahead)
        return State(float(rows.times[number]), x, v), LastForce(a, at)

    def _energy_of_kicks(self, dt: float) -> float:
        """dt²/8 a·M a of the free directions: M Δv · (Δx/dt − v̄) is its decrease in a step."""
        a = self.fields.a
        mass = self.fields.mass
        free = self.system.constraints.project(a.copy())
        return 0.125 * dt * dt * dot(a * mass[:, None], free)
