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
    """How a step was opened, and its unknown: ``method.close(opening, q)`` is the `Step`."""

    method: Any
    opening: Any  # of `method.open`
    memory: Any  # the memory with which the step was opened
    # (n, 3) the unknown that solves it; of an explicit step the acceleration
    q: np.ndarray


@dataclass(frozen=True, eq=False)
class Step:
    """The result of one step.

    The optional fields say which forces moved the cloth; the energy ledger and the reactions of
    the pins need them. Without any, it was the force at `balanced_at`.
    """

    state: State
    balanced_at: State  # time, position and velocity at which the method balanced the forces
    memory: object  # input of the next step: a first guess, or a `remembered` record
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
    # with `ends`: M a is instead the mean of both ends' forces, with this weight of the new one
    share: float | None = None
    # the records that terms keep, after and before the step (`System.start_history`)
    history: History | None = None
    earlier: History | None = None
    # the size [s] that a choice of steps asked of the method, if it was another than in `march`
    size: float | None = None
    # (n, 3) [N] the force at the begin, of a step whose pins do the work of the mean of both
    # ends
    first_force: np.ndarray | None = None
    # what was opened and solved, of methods that have `open` and `close`
    solution: Solution | None = None

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
            mass = system.mass_rows / len(self.accelerations)
            force: np.ndarray = mass * sum(a for _, a in self.accelerations)
            return force
        return (self.over or system).force(self.balanced_at)

    def force_on_pins(self, system: System) -> np.ndarray:
        """(n, 3) force [N] against which the pins do their work over the step."""
        force = self.mean_force(system)
        return force if self.first_force is None else 0.5 * (self.first_force + force)

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


UNCOUNTED = Counts()  # of a step that is closed at a q which it did not solve for


@dataclass(frozen=True, eq=False)
class Opening:
    """An implicit step that is open: ``method.open(system, state, dt, memory, history)``.

    The unknown q (n, 3) gives x = x̃ + wx q, v = ṽ + wv q and a = ã + wa q at the `stage`. The
    step is solved where `residual` vanishes, and ``method.close(opening, q)`` is the `Step` to
    any q.
    """

    method: Any  # whose step it is; the first step of BDF2 is a step of another method
    # The system, and the system over the step.
    system: System
    over: System
    stage: Stage  # the affine maps of q, with what the pins prescribe
    # The state at the begin, and at the end the state of the held directions.
    begin: State
    end: State
    dt: float  # size of the step [s]
    memory: Any = None  # what the method remembers of the step before; None in the first step
    guess: np.ndarray | None = None  # a first guess of q; None for zero
    # The records that terms keep, at the begin of the step; None without any.
    history: History | None = None

    @cached_property
    def equation(self) -> StageEquation:
        """The equation of the step, with exact tangents."""
        return StageEquation(self.over, self.stage, "none")

    def residual(self, q: np.ndarray) -> np.ndarray:
        """R(q) = M a − f(x, v, t) along the free directions, (n, 3) [N]."""
        return self.equation.residual(q, 1.0)[0]

    def tangent(self, q: np.ndarray, J: BlockMatrix) -> BlockMatrix:
        """∂R/∂q = wa M + wv D + wx K along the free directions, in place of what J held.

        What terms couple outside the pattern of J is in a matrix of its own, which is returned
        then. Without what `System.dense` gives.
        """
        exact = Remedy(0.0, False)
        self.equation.assemble(q, exact, J)
        return self.equation.couple(q, exact, J)


def arrive(opening: Any, t: float, x: np.ndarray, v: np.ndarray) -> tuple[State, dict[str, Any]]:
    """The state at the end of a step, held where pins prescribe, and the `ending` of the step."""
    new = set_prescribed(opening.system, State(t, x, v), opening.end)
    return new, ending(opening, new)


def ending(opening: Any, new: State) -> dict[str, Any]:
    """The fields that the `Step` to the state `new` has of its opening, of any kind."""
    history = opening.over.commit(new, opening.history)
    return {"over": opening.over, "history": history, "earlier": opening.history}


class Begin(NamedTuple):
    """What a step begins with."""

    system: System
    state: State
    dt: float  # size of the step [s]
    memory: Any = None  # what the method remembers of the step before; None in the first step
    history: History | None = None  # the records that terms keep; None without any

    @property
    def end(self) -> State:
        return prescribed_end(self.system, self.state, self.dt)

    @property
    def over(self) -> System:
        """The system over the step, of a method without a difference for rates."""
        difference = StepDifference.between(self.state.x, self.dt, self.state.t)
        return self.system.over_step(difference, self.history, rates=False)


class OpensSteps:
    """Base of methods whose step is opened, solved and closed; a subclass has the first two."""

    _open: Any  # of a `Begin` and the solver: the step, open
    close: Any  # of that and the unknown: the `Step`

    def open(
        self,
        system: System,
        state: State,
        dt: float,
        memory: Any = None,
        history: History | None = None,
        solver: SolverContext | None = None,
    ) -> Any:
        """Open a step from `state` over `dt` [s] after the step that left this memory."""
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
        q, counts = newton.solve(opening.over, opening.stage, solver, opening.guess, begin.dt)
        step: Step = self.close(opening, q, counts)
        return replace(step, solution=Solution(self, opening, begin.memory, q))
