"""Many steps of central differences without Python between them, for compiled terms.

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

from fecloth.compiled.calls import AnyCall, Call, Calls, JoinedCalls, join
from fecloth.compiled.team import ALONE, Team
from fecloth.compiled.threads import ONLY, Member
from fecloth.integrators.explicit import LastForce
from fecloth.integrators.fused_forces import (
    Column,
    Moves,
    SharedForces,
    bind_columns,
    force_calls,
)
from fecloth.integrators.fused_loops import Fields, Held, Pauses, copy, take_steps
from fecloth.integrators.step import Step
from fecloth.linalg.reductions import dot
from fecloth.nonlinear.statistics import Counts
from fecloth.system.motion_rows import MotionRows
from fecloth.system.sewn_nodes import SewnNodes, follow_rows
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import fill_extreme_stretches

# The phase and the period of looks at stretches, for a look after no step: see `Pauses`.
NO_LOOK = 0, 2**62


@dataclass(frozen=True)
class Flows:
    """What the energy ledger adds up over steps [J]: see `Ledger`.

    Attributes
    ----------
    dissipated, work
        Dissipated energy, and work of the loads, by the names of the terms.
    pins
        Work of the pins.
    numerical
        Numerical dissipation.
    impacts
        What impacts have taken.
    """

    dissipated: Mapping[str, float]
    work: Mapping[str, float]
    pins: float
    numerical: float
    impacts: float = 0.0


@dataclass(frozen=True, eq=False)
class Taken:
    """Steps that were taken.

    Attributes
    ----------
    number
        Number of the steps before the last one.
    state, memory
        Where these steps end, and their memory.
    step
        The last step; None if a stretch was beyond its limits before.
    flows
        What all steps add to the ledger, the last one too.
    """

    number: int
    state: State
    memory: LastForce
    step: Step | None
    flows: Flows


@dataclass(frozen=True, eq=False)
class FusedSteps:
    """A system ready for `take`: its compiled force, and the arrays on which it works.

    Attributes
    ----------
    system
        What moves.
    team
        The threads that share the work.
    fields, moves
        The arrays that steps change, and those of them that the columns need.
    stretches
        (2,) the least and the largest stretch.
    columns
        The columns of the energy ledger.
    calls
        The calls that add the forces.
    forces
        The same calls, joined.
    before, after
        The calls at the begin and at the end of a step for the columns, joined.
    look
        The call that fills `stretches`.
    """

    system: System
    team: Team
    fields: Fields
    moves: Moves
    stretches: np.ndarray
    columns: tuple[Column, ...]
    calls: Calls
    forces: JoinedCalls
    before: JoinedCalls
    after: JoinedCalls
    look: JoinedCalls

    @classmethod
    def bind(cls, system: System, ledger: bool = True, team: Team | None = None) -> Self | None:
        """Return the fused steps of a system, or None if they cannot be compiled.

        That is so where a term or a pin needs Python in each step, and without a lumped mass.
        With `ledger` the columns of the energy ledger are added up; otherwise the `Flows` have
        no work and no dissipation of terms. The threads are the threads of the system, unless a
        `team` is given.
        """
        if system.mass_kind != "lumped" or not MotionRows.can_evaluate(system.constraints):
            return None
        fields = _make_fields(system)
        moves = Moves(
            size=np.zeros(1),
            t=np.zeros(1),
            x=fields.x,
            old_x=np.zeros_like(fields.x),
            v=fields.v,
            old_v=np.zeros_like(fields.v),
            ahead=fields.ahead,
        )
        columns = bind_columns(system, fields.x.shape) if ledger else ()
        if columns is None:
            return None
        forces = force_calls(system, columns, moves, fields.f)
        if forces is None:
            return None
        after: list[AnyCall] = [call for column in columns for call in column.at_end(moves)]
        before: list[AnyCall] = []
        if columns:  # all columns need the displacement over the step
            before.append((copy, (moves.x, moves.old_x)))
        if after:  # only the calls at the end need the old velocity
            before.append((copy, (moves.v, moves.old_v)))
        followers = system.constraints.followers
        if isinstance(followers, SewnNodes):
            x, ahead, v = (
                (follow_rows, (*followers.rows, y)) for y in (fields.x, fields.ahead, fields.v)
            )
            forces = [x, ahead, *forces, *followers.gather_calls(fields.f)]
            after.insert(0, v)
        stretches = np.zeros(2)
        return cls(
            system=system,
            team=team or system.team,
            fields=fields,
            moves=moves,
            stretches=stretches,
            columns=columns,
            calls=forces,
            forces=join(forces),
            before=join(before),
            after=join(after),
            look=join([_stretch_call(system, fields.x, stretches)]),
        )

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
        """Take steps of the given sizes, the last one by itself, so that its `Step` is known.

        Parameters
        ----------
        state, memory
            The begin of the first step, and the memory of the step before.
        times
            (s + 1,) the begin and the ends of the steps [s].
        sizes
            (s,) the sizes of the steps, which are equal but for round-off [s].
        look
            (phase, period): the stretches are looked at after step s, from 0 on, if
            (s + phase) % period = period − 1, but not after the last step.
        least, largest
            Stretches beyond which no further step is taken.

        Returns
        -------
        Taken or None
            The steps that were taken: fewer than asked for if a stretch is beyond the limits,
            and then without the last `Step`. None if x or v is not finite at the end: then
            nothing is known of these steps.
        """
        rows = MotionRows.evaluate(self.system.constraints, times, sizes)
        held = self._make_held(rows)
        dt = float(sizes[0])
        before_last = len(sizes) - 1
        self._begin_at(state, memory)
        energy_at_begin = self._energy_of_kicks(dt)
        pauses = self._make_pauses(look, least, largest)
        number = self._go(rows, held, slice(0, before_last), pauses)
        end, end_memory = self._read_end(rows, number)
        step = None
        if not pauses.stop[0]:
            no_pauses = self._make_pauses(NO_LOOK, least, largest)
            self._go(rows, held, slice(before_last, len(sizes)), no_pauses)
            new, new_memory = self._read_end(rows, len(sizes))
            forces = (end_memory.at, end_memory.a), (new_memory.at, new_memory.a)
            step = Step(
                state=new,
                balanced_at=new_memory.at,
                memory=new_memory,
                counts=Counts(),
                accelerations=forces,
            )
        if not self._is_finite:
            return None
        unrecorded = sum(column.unrecorded for column in self.columns)
        flows = Flows(
            dissipated={c.name: c.dissipated for c in self.columns if c.dissipates},
            work={c.name: c.work for c in self.columns if c.supplies},
            pins=float(held.work[0]),
            numerical=energy_at_begin - self._energy_of_kicks(dt) - unrecorded,
        )
        return Taken(number=number, state=end, memory=end_memory, step=step, flows=flows)

    @property
    def _is_finite(self) -> bool:
        return bool(np.isfinite(self.fields.x).all() and np.isfinite(self.fields.v).all())

    def _begin_at(self, state: State, memory: LastForce) -> None:
        """Write a state and its memory to the arrays, and set all sums to zero.

        With columns the forces are evaluated where the step before had evaluated them: the sums
        are by the trapezoidal rule, and need the force at the begin.
        """
        fields = self.fields
        fields.x[:] = state.x
        fields.v[:] = state.v
        fields.a[:] = memory.a
        if self.columns:
            self.moves.old_x[:] = state.x
            self.moves.t[0] = memory.at.t
            fields.ahead[:] = memory.at.v
            fields.f[:] = 0.0
            self.forces()
        for column in self.columns:
            column.start()
        self.stretches[:] = 1.0  # within all limits, until they are looked at

    def _make_held(self, rows: MotionRows) -> Held:
        """Return the nodes that are held, with the motion of the pins in all steps, `rows`."""
        constraints = self.system.constraints
        count = len(constraints.nodes)
        return Held(
            at=constraints.nodes,
            P=np.ascontiguousarray(constraints.projectors),
            path=rows.path,
            speed=rows.speed,
            old=np.empty((3, count, 3)),
            target=np.empty((count, 3)),
            work=np.zeros(1),
        )

    def _make_pauses(self, look: tuple[int, int], least: float, largest: float) -> Pauses:
        """Return what the first thread does between steps, with the parameters of `take`."""
        phase, period = look
        return Pauses(
            before=self.before.address,
            after=self.after.address,
            look=self.look.address,
            phase=phase,
            period=period,
            least=least,
            largest=largest,
            size=self.moves.size,
            t=self.moves.t,
            stretches=self.stretches,
            stop=np.zeros(1, np.int64),
        )

    def _go(self, rows: MotionRows, held: Held, steps: slice, pauses: Pauses) -> int:
        """Take a range of the steps, in portions that the team times; return their number."""
        begin = steps.start
        number = steps.stop - begin
        done = 0
        while done < number and not pauses.stop[0]:
            end = done + self._team.portion("steps", number - done)
            pauses_in_portion = pauses._replace(phase=pauses.phase + done)  # it counts from 0 on
            portion = slice(begin + done, begin + end)
            done += self._take_portion(rows, held.over(portion), portion, pauses_in_portion)
        return done

    def _take_portion(self, rows: MotionRows, held: Held, steps: slice, pauses: Pauses) -> int:
        """Take a portion of the steps on one thread or on all, as the team decides.

        Return the number of steps taken: fewer than those of the portion if a stretch is beyond
        its limits.
        """
        team = self._team
        sizes = rows.sizes[steps]
        ends = rows.reached[steps]

        def take(forces: int, member: Member) -> int:
            return take_steps(forces, sizes, ends, pauses, held, self.fields, member)

        def alone() -> int:
            return take(self.forces.address, ONLY)

        def together() -> int:
            shared = self.shared_forces
            shared.start()
            addresses = [calls.address for calls in shared.calls]
            members = shared.members
            # thread p calls `take` with the address of its own part of the forces
            return team.run(lambda p: take(addresses[p], members[p]), members[0].meeting)

        return team.do("steps", alone, together, float)

    @property
    def _team(self) -> Team:
        """The threads that share the steps: one alone for a small cloth."""
        if self.team.shares(len(self.fields.mass)):
            return self.team
        return ALONE

    @cached_property
    def shared_forces(self) -> SharedForces:
        """The forces, divided among the threads of the team."""
        return SharedForces.divide(self.calls, self.team.count)

    def _read_end(self, rows: MotionRows, number: int) -> tuple[State, LastForce]:
        """Copies of the state and the memory, after that number of steps."""
        fields = self.fields
        x = fields.x.copy()
        at = State(float(rows.reached[number - 1]), x, fields.ahead.copy())
        state = State(float(rows.times[number]), x, fields.v.copy())
        return state, LastForce(fields.a.copy(), at)

    def _energy_of_kicks(self, dt: float) -> float:
        """dt²/8 a·M a of the free directions [J].

        Its decrease in a step is M Δv · (Δx/dt − v̄), see `explicit_dissipation`.
        """
        a = self.fields.a
        mass = self.fields.mass
        free = self.system.constraints.project(a.copy())
        return 0.125 * dt * dt * dot(a * mass[:, None], free)


def _make_fields(system: System) -> Fields:
    """Return the arrays for the steps of a system, with x at rest and all else zero."""
    x = np.zeros((len(system.cloth.X), 3))  # contiguous, as the kernels need it
    x[:] = system.rest().x
    mass = system.nodal_mass
    return Fields(
        x=x,
        v=np.zeros_like(x),
        a=np.zeros_like(x),
        ahead=np.zeros_like(x),
        f=np.zeros_like(x),
        mass=mass,
        inverse_mass=np.repeat(system.inverse_mass, 3),
    )


def _stretch_call(system: System, x: np.ndarray, stretches: np.ndarray) -> Call:
    """The call that writes the least and the largest stretch at x to `stretches` (2,)."""
    cloth = system.cloth
    return fill_extreme_stretches, (*cloth.shape, cloth.stencil, cloth.gradients, x, stretches)
