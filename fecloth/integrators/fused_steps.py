"""Many steps of central differences without Python between them, for any terms that are compiled.

The steps are those of `CentralDifference.step`, to the last bit: the kernels of the terms add to
one force in the same order, and the loops over the nodes round each operation by itself. Work,
dissipation and the numerical dissipation of every step are added up, for the energy ledger.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.compiled.calls import AnyCall, Calls, JoinedCalls, join
from fecloth.compiled.team import ALONE, Team
from fecloth.integrators.explicit import LastForce
from fecloth.integrators.fused_columns import Column, Moves, bind_columns
from fecloth.integrators.fused_forces import SharedForces, force_calls
from fecloth.integrators.fused_loops import STOP, copy, take_steps
from fecloth.integrators.step import Step
from fecloth.linalg.reductions import dot
from fecloth.nonlinear.statistics import Counts
from fecloth.system.motion_rows import MotionRows
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import fill_extreme_stretches


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
        forces = None if columns is None else force_calls(system, columns, moves, f)
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
