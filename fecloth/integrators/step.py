"""A step in time: its begin, its solution and its result, with what all implicit methods share.

An implicit step is opened, from the state, the memory of the method and the history of the
terms; solved, for the unknown q at which R(q) = 0; and closed, from q to the new state, memory
and history. Each part is a function of its own, so that others can evaluate the residual, and
the end of the step, at a q that they have.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear import newton
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.newton import StageEquation
from fecloth.nonlinear.remedies import Remedy
from fecloth.nonlinear.stage import Stage
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.step_difference import StepDifference


class Solution(NamedTuple):
    """How a step was opened, and its unknown: ``method.close(opening, q)`` is the `Step`.

    Attributes
    ----------
    method, opening
        The method, and what its ``open`` returned.
    memory
        The memory with which the step was opened.
    q
        (n, 3) the unknown that solves the step; of an explicit step the acceleration.
    """

    method: Any
    opening: Any
    memory: Any
    q: np.ndarray


@dataclass(frozen=True, eq=False)
class Step:
    """The result of one step.

    The optional fields say which forces moved the cloth; the energy ledger and the reactions of
    the pins need them. Without any, it was the force at `balanced_at`.

    Attributes
    ----------
    state
        The new state.
    balanced_at
        Time, position and velocity at which the method balanced the forces.
    memory
        Input of the next step: a first guess, or a `remembered` record.
    counts
        Newton and linear iterations, residual and seconds.
    over
        The system over the step, where terms act over it: then its force moved the cloth.
    accelerations
        ((state, M⁻¹ f there (n, 3) [m/s²]), …): the mean of these forces moved the cloth.
    ends
        (system, old state): the ledger takes the mean of the forces at both ends of the step,
        and power at the mean of both states. They are evaluated once, and only when needed.
    a
        (n, 3) [m/s²], with `ends`: along free directions the method solved
        M a = f(balanced_at).
    share
        With `ends`: M a is instead the mean of the forces at both ends, with this weight of the
        new one.
    history, earlier
        The records that terms keep, after and before the step (`System.start_history`).
    size
        The size that a choice of steps asked of the method, if `march` asked for another [s].
    first_force
        (n, 3) the force at the begin [N], of a step whose pins do the work of the mean of both
        ends.
    solution
        What was opened and solved, of methods that have `open` and `close`.
    new_force
        (n, 3) the force at the new state [N], where the solution has evaluated it last.
    unstruck
        The new state before impulses of impacts have changed its velocities; None without any.
    works
        Work [J] of these impulses by what moves, of each term; () where nothing touches.
    """

    state: State
    balanced_at: State
    memory: object
    counts: Counts
    over: System | None = None
    accelerations: tuple[tuple[State, np.ndarray], ...] = ()
    ends: tuple[System, State] | None = None
    a: np.ndarray | None = None
    share: float | None = None
    history: History | None = None
    earlier: History | None = None
    size: float | None = None
    first_force: np.ndarray | None = None
    solution: Solution | None = None
    new_force: np.ndarray | None = None
    unstruck: State | None = None
    works: tuple[float, ...] = ()

    @property
    def touches(self) -> bool:
        """Whether a contact pushes at the end of the step."""
        return bool(self.works)

    @property
    def before_impacts(self) -> "Step":
        """The step as the forces alone made it, without the impulses of impacts at its end."""
        return replace(self, state=self.unstruck or self.state)

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
        new = self.new_force
        if new is None:
            new = (self.over or system).force(self.state)
        return system.force(old), new

    def mean_force(self, system: System) -> np.ndarray:
        """Return the force (n, 3) [N] that moved the cloth over the step from `system`.

        It is the mean of the forces at both ends, or of the `accelerations`, or the force at
        `balanced_at`: by what the fields of this step say.
        """
        if self.ends:
            old, new = self.end_forces
            mean: np.ndarray = 0.5 * (old + new)
            return mean
        if self.accelerations:
            mass = system.mass_rows / len(self.accelerations)
            force: np.ndarray = mass * sum(a for _, a in self.accelerations)
            return force
        return (self.over or system).force(self.balanced_at)

    def force_on_pins(self, system: System) -> np.ndarray:
        """(n, 3) force [N] against which the pins do their work over the step."""
        force = self.mean_force(system)
        if self.first_force is not None:
            force = 0.5 * (self.first_force + force)
        return force

    @cached_property
    def solved_force(self) -> np.ndarray:
        """(n, 3) force [N] that equals M a along the free directions; only with `ends`."""
        if self.share is None:
            return (self.over or self._both_ends()[0]).force(self.balanced_at)
        old, new = self.end_forces
        force: np.ndarray = (1 - self.share) * old + self.share * new
        return force

    def _both_ends(self) -> tuple[System, State]:
        """The field `ends`, which this step must have."""
        if self.ends is None:
            raise InputError("Step.ends = None", "must be (system, old state) here", "Step")
        return self.ends


def blend(old: State, new: State, theta: float) -> State:
    """The state old + θ (new − old)."""
    dt = new.t - old.t
    dx = new.x - old.x
    dv = new.v - old.v
    return State(old.t + theta * dt, old.x + theta * dx, old.v + theta * dv)


def prescribed_end(system: System, state: State, dt: float) -> State:
    """Return the state whose held directions follow the pins' motion at the end of a step."""
    x, v = system.constraints.target(state.t, dt, state.x)
    return State(state.t + dt, x, v)


def set_prescribed(system: System, state: State, end: State) -> State:
    """Return the state with its held directions exactly at the prescribed `end`."""
    hold = system.constraints.hold
    return State(state.t, hold(state.x, end.x), hold(state.v, end.v))


# The counts of a step that is closed with a given q: nothing was solved.
UNCOUNTED = Counts()


@dataclass(frozen=True, eq=False)
class Opening:
    """An implicit step that is open: ``method.open(system, state, dt, memory, history)``.

    The unknown q (n, 3) gives x = x̃ + wx q, v = ṽ + wv q and a = ã + wa q at the `stage`. The
    step is solved where `residual` vanishes. For any q, ``method.close(opening, q)`` is the
    `Step` with it.

    Attributes
    ----------
    method
        The method of the step. The first step of BDF2 is a step of another method.
    system, over
        The system, and the system over the step.
    stage
        The affine maps of q, with what the pins prescribe.
    begin, end
        The state at the begin, and at the end the state of the held directions.
    dt
        Size of the step [s].
    memory
        What the method remembers of the step before; None in the first step.
    guess
        (n, 3) a first guess of q; None for zero.
    history
        The records that terms keep, at the begin of the step; None without any.
    """

    method: Any
    system: System
    over: System
    stage: Stage
    begin: State
    end: State
    dt: float
    memory: Any = None
    guess: np.ndarray | None = None
    history: History | None = None

    @cached_property
    def equation(self) -> StageEquation:
        """The equation of the step, with exact tangents."""
        return StageEquation(self.over.with_exact_tangents(), self.stage, "none")

    def residual(self, q: np.ndarray) -> np.ndarray:
        """R(q) = M a − f(x, v, t) along the free directions, (n, 3) [N]."""
        return self.equation.residual(q, 1.0)[0]

    def tangent(self, q: np.ndarray, J: BlockMatrix) -> BlockMatrix:
        """Write ∂R/∂q = wa M + wv D + wx K along the free directions to J, and return it.

        Where terms couple nodes outside the pattern of J, a new matrix is returned. The parts of
        low rank, `System.dense`, are not included.
        """
        exact = Remedy(0.0, False)
        self.equation.assemble(q, exact, J)
        return self.equation.couple(q, exact, J)


def arrive(opening: Any, t: float, x: np.ndarray, v: np.ndarray) -> tuple[State, dict[str, Any]]:
    """The state at the end of a step, with its held directions as prescribed, and its `ending`."""
    new = set_prescribed(opening.system, State(t, x, v), opening.end)
    return new, ending(opening, new)


def ending(opening: Any, new: State) -> dict[str, Any]:
    """The fields of the `Step` to the state `new` that follow from its opening."""
    history = opening.over.commit(new, opening.history)
    return {"over": opening.over, "history": history, "earlier": opening.history}


class Begin(NamedTuple):
    """The arguments of a step.

    Attributes
    ----------
    system, state
        What moves, and the state at the begin.
    dt
        Size of the step [s].
    memory
        What the method remembers of the step before; None in the first step.
    history
        The records that terms keep; None without any.
    """

    system: System
    state: State
    dt: float
    memory: Any = None
    history: History | None = None

    @property
    def end(self) -> State:
        """The state of the held directions at the end of the step."""
        return prescribed_end(self.system, self.state, self.dt)

    @property
    def over(self) -> System:
        """The system over the step, of a method without a difference for rates."""
        difference = StepDifference.between(self.state.x, self.dt, self.state.t)
        return self.system.over_step(difference, self.history, rates=False)


class OpensSteps:
    """Base of methods whose step is opened, solved and closed.

    A subclass supplies ``_open(begin, solver)``, which returns an opening, and
    ``close(opening, q)``, which returns the `Step` with the unknown q.
    """

    _open: Any
    close: Any

    def open(
        self,
        system: System,
        state: State,
        dt: float,
        memory: Any = None,
        history: History | None = None,
        solver: SolverContext | None = None,
    ) -> Any:
        """Open a step from `state` over `dt` [s], after the step that left this memory."""
        return self._open(Begin(system, state, dt, memory, history), solver)

    def step(
        self,
        system: System,
        state: State,
        dt: float,
        solver: Any = None,
        memory: Any = None,
        history: History | None = None,
    ) -> Step:
        """One step from `state` over `dt` [s]."""
        return self._take(Begin(system, state, dt, memory, history), solver)

    def _take(self, begin: Begin, solver: SolverContext) -> Step:
        """Open a step, solve it by Newton's iteration, and close it."""
        opening = self.open(*begin, solver)
        q, counts = newton.solve(
            opening.over, opening.stage, solver, guess=opening.guess, dt=begin.dt
        )
        step: Step = self.close(opening, q, counts)
        joined = solver.last_stage.joined
        solved = step.unstruck or step.state
        return replace(
            step,
            solution=Solution(self, opening, begin.memory, q),
            new_force=joined.force_at(solved) if joined and step.ends else None,
        )
