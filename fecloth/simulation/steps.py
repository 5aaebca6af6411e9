"""Steps in time: one step from a state, and the loop over steps.

The loop takes a method and step sizes that are chosen already. What it needs from outside is in
a `Plan`; what a step begins from is a `Place`. `fc.march` makes the plan.
"""

import math
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fecloth.errors import SolveFailed, StepFailed
from fecloth.integrators import protocol
from fecloth.integrators.step import Step
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.statistics import Counts
from fecloth.simulation.step_history import StepHistory, needs_history
from fecloth.simulation.step_times import EARLIER, SAME_TIME, SMALLER, coarse_clock
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.kinematics import largest_stretch, principal_stretches
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True, eq=False)
class Memory:
    """The data, beside the state, from which `march` continues bit for bit.

    Attributes
    ----------
    step
        Number of steps so far.
    start
        Time at which the first of them began [s].
    method_memory
        What the method keeps from its last step: `Step.memory`.
    history
        What Newton's iteration knows of the last steps.
    term_history
        What terms keep from the last step: `Step.history`.
    """

    step: int
    start: float
    method_memory: object
    history: StepHistory = field(default_factory=StepHistory)
    term_history: History | None = None


@dataclass(frozen=True, eq=False)
class StepInfo:
    """One step of `march` and its figures.

    Attributes
    ----------
    step
        Number of the step, from 1.
    old
        The state before the step.
    result
        The `Step` of the method; its `state` is the state after the step.
    memory
        Continues `march` from here.
    is_part
        Whether it is a part of a step of dt, which was divided because it failed.
    skipped
        The steps since the step that was yielded before, if these were taken in one call; see
        `fused_march`.
    """

    step: int
    old: State
    result: Step
    memory: Memory
    is_part: bool = False
    skipped: Any = None

    @property
    def t(self) -> float:
        """Time at the end of the step [s]."""
        return self.result.state.t

    @property
    def dt(self) -> float:
        """The size of the step [s], by the times of its states."""
        return self.t - self.old.t

    @property
    def counts(self) -> Counts:
        """Newton and linear iterations, relative residual, seconds of assembly and solve."""
        if self.skipped is None:
            return self.result.counts
        return Counts(seconds={"force": self.skipped.seconds}).plus(self.result.counts)

    @property
    def size(self) -> float:
        """The size [s] for which the method was asked, which differs from `dt` by round-off."""
        return self.result.size or self.dt

    @property
    def number(self) -> int:
        """Number of the steps since the step that was yielded before."""
        if self.skipped:
            return 1 + self.skipped.number
        return 1


@dataclass(frozen=True, eq=False)
class Plan:
    """What is the same for all steps of a march.

    Attributes
    ----------
    system
        What moves.
    method
        Takes the steps, each to the next of the targets at most.
    solver
        Linear solver and options of the nonlinear solve.
    targets
        (k,) times at which steps must end, in order [s]; the last one is the end.
    first
        Number of the first step.
    most_stretch
        A step that leaves a triangle stretched by more has failed.
    check_every
        Number of steps between two looks at the stretches.
    """

    system: System
    method: protocol.StepChoice
    solver: SolverContext
    targets: np.ndarray
    first: int
    most_stretch: float
    check_every: int = 1

    def next_target(self, t: float) -> float:
        """Return the first target after the time t [s]."""
        return float(self.targets[np.searchsorted(self.targets, t, side="right")])

    @property
    def t_end(self) -> float:
        """The end of the march [s]."""
        return float(self.targets[-1])


@dataclass(frozen=True, eq=False)
class Place:
    """What a step begins from.

    Attributes
    ----------
    state
        The state before the step.
    memory
        What the steps before it have left.
    checked
        The last state whose stretches were looked at: a failed step reports it.
    """

    state: State
    memory: Memory
    checked: State


def steps(plan: Plan, place: Place) -> Generator[tuple[State, StepInfo], Any, Place]:
    """Take steps to the end of the plan, and yield each new state with its `StepInfo`.

    Return the place at the end.

    Raises
    ------
    StepFailed
        If a step does not converge, makes a value that is not finite or stretches a triangle
        beyond `most_stretch`; its `state` is the last one that was checked.
    """
    while place.state.t < plan.t_end:
        place, info = take(plan, place)
        yield place.state, info
    return place


def take(plan: Plan, place: Place, known: Step | None = None) -> tuple[Place, StepInfo]:
    """Take one step; `known` is the result of the method where it has been computed already."""
    old = place.state
    before = place.memory
    number = before.step + 1
    target = plan.next_target(old.t)
    horizon = target - old.t
    result = known or _solve(plan, place, horizon)
    if number == plan.first:
        protocol.check_step(result, protocol.method_of(plan.method))
    new = _end_at_target(result.state, target, horizon)
    is_due = number % plan.check_every == 0
    check_stretch = is_due or new.t == plan.t_end
    problem = _find_coarse_clock(old.t, new.t, target) or find_problem(plan, new, check_stretch)
    if problem:
        raise step_failed(plan.system, place.checked, number, new.t - old.t, problem)
    history = before.history
    if needs_history(plan.solver, plan.method.traits):
        history = history.after(plan.system, plan.method.traits, old, new)
    memory = Memory(number, before.start, result.memory, history, result.history)
    if new is not result.state:
        result = replace(result, state=new)
    is_part = plan.method.dt is not None and new.t < target
    info = StepInfo(number, old, result, memory, is_part)
    checked = new if is_due else place.checked
    return Place(new, memory, checked), info


def _solve(plan: Plan, place: Place, horizon: float) -> Step:
    """Return the step of the method, at most as far as the horizon [s]."""
    state = place.state
    memory = place.memory
    solver = plan.solver
    if needs_history(solver, plan.method.traits):
        solver = memory.history.inform(solver, plan.system, plan.method.traits, state)
    try:
        return protocol.take_step(
            plan.method,
            plan.system,
            state,
            horizon,
            solver,
            memory.method_memory,
            memory.term_history,
        )
    except (NewtonFailed, SolveFailed) as failure:
        raise step_failed(plan.system, state, memory.step + 1, horizon, failure) from failure


def _end_at_target(state: State, target: float, horizon: float) -> State:
    """Return the state with t exactly at the target if it differs by round-off only."""
    if 0.0 < abs(target - state.t) <= SAME_TIME * horizon:
        return replace(state, t=target)
    return state


@dataclass(frozen=True)
class Problem:
    """The reason of a failed step, with the attributes of `NewtonFailed`."""

    reason: str
    residual: float = math.nan
    remedy: str = SMALLER


def _find_coarse_clock(t: float, end: float, target: float) -> Problem | None:
    """Return why a step from t to `end` [s] cannot be trusted: the time t is too coarse for it.

    A step that ends at the target is as long as it was meant to be.
    """
    words = coarse_clock(end, end - t) if end < target else ""
    if words:
        return Problem(words, remedy=EARLIER)
    return None


def find_problem(plan: Plan, state: State, check_stretch: bool) -> Problem | None:
    """Return why a state cannot be trusted: a value that is not finite, or a huge stretch."""
    if not (np.isfinite(state.x).all() and np.isfinite(state.v).all()):
        return Problem("a position or velocity is not finite")
    if not check_stretch:
        return None
    stretch = largest_stretch(plan.system.cloth, state.x)
    if stretch <= plan.most_stretch:
        return None
    beyond = f"beyond {plan.most_stretch:g}"
    return Problem(f"a triangle is stretched to {stretch:.3g} times, {beyond}")


def step_failed(system: System, state: State, number: int, dt: float, cause: Any) -> StepFailed:
    """Return the error of a step of dt [s], with the most strained triangle of its start."""
    stretches = principal_stretches(system.cloth, state.x)
    strains = np.abs(np.log(np.maximum(stretches, np.finfo(float).tiny)))
    triangle, which = np.unravel_index(np.argmax(strains), strains.shape)
    return StepFailed(
        getattr(cause, "reason", str(cause)),
        step=number,
        t=state.t,
        dt=dt,
        residual=getattr(cause, "residual", math.nan),
        stretch=float(stretches[triangle, which]),
        triangle=int(triangle),
        state=state,
        remedy=getattr(cause, "remedy", SMALLER),
        unit=getattr(cause, "unit", " s"),
    )
