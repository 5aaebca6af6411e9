"""Static equilibrium in load steps, as a choice of steps that `march` takes.

The "time" is the part of the loads that acts, from 0 at the start to 1. So frames, tables,
restart files and probes serve a static scene as they serve a motion.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fecloth.errors import amount
from fecloth.integrators.numerical_dissipation import load_forces
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import UNCOUNTED, Solution, Step
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.increments import NO_COURSE, Course, increase_loads, shake, static_context
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.static_equation import EquilibriumFailed
from fecloth.nonlinear.statistics import Counts
from fecloth.simulation.closing_work import closing_work
from fecloth.simulation.step_times import ChosenSteps, step_times
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.records import remembered

TERMS_TIME = 0.0  # at which loads are evaluated: loads of a static scene do not depend on it


@remembered
@dataclass(frozen=True, eq=False)
class LoadCourse:
    """After a step: what it tells about the next one, and the force on the pins.

    Attributes
    ----------
    course
        Of the increments so far.
    force
        (n, 3) force of all terms [N].
    error
        The error that the iteration left in x [m]; NaN where it is not estimated.
    """

    course: Course
    force: np.ndarray
    error: float = math.nan


@dataclass(frozen=True, eq=False)
class ScaledLoad(BoundTerm):
    """A bound load whose force is multiplied by `factor`.

    Attributes
    ----------
    whole
        The bound load.
    factor
        The part of its force that acts.
    """

    whole: Any
    factor: float

    def add_force(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> None:
        force = np.zeros_like(f)
        self.whole.add_force(x, v, t, force)
        f += self.factor * force


class LoadsFailed(NewtonFailed):
    """A load step without an equilibrium."""

    unit = " of the loads"


@dataclass(frozen=True)
class LoadSteps(ChosenSteps):
    """Equilibria under growing loads, by `increase_loads`.

    The parameters are as for `equilibrium`. The "time" of a step is the part of the loads.
    """

    load_steps: int = 1
    tolerance: float | Literal["auto"] = "auto"
    max_iterations: int = 500
    friction: Literal["laid", "shaken"] = "laid"

    traits = MethodTraits(order=0, theta=1.0, stability=None, chooses_dt=True, has_difference=True)

    @property
    def method(self) -> "LoadSteps":
        """Itself: it has no other method for its steps."""
        return self

    @property
    def dt(self) -> float:  # type: ignore[override]  # None in the base, which fixes no size
        """The part of the loads that a step adds."""
        return 1 / self.load_steps

    def end_times(self, t: float, t_end: float | None, stops: Sequence[float] = ()) -> np.ndarray:
        """Return the part of the loads at the end of every step."""
        return step_times(t, self.dt, t_end, stops)

    def solver(self, system: System, choice: str) -> tuple[SolverContext, str]:
        """Return the direct solver of all steps, and in words why it was chosen."""
        name = choice
        reason = "requested"
        if choice == "auto":
            name = "direct"
            reason = "as for every equilibrium"
        context = static_context(system, self.tolerance, self.max_iterations, name)
        assert context.linear is not None
        return context, f"{context.linear.name} ({reason})"

    def step(
        self, system: System, state: State, horizon: float, solver, memory=None, history=None
    ) -> Step:
        """Find the equilibrium under the part `state.t` + `horizon` of the loads.

        Raises `LoadsFailed`, a `NewtonFailed`, if there is none.
        """
        still = np.zeros_like(state.x)
        start = State(TERMS_TIME, state.x, still)
        load = state.t + horizon
        before = memory or LoadCourse(NO_COURSE, force_at(system, state, history))
        try:
            increase = increase_loads(
                system, start, solver, horizon, (state.t, load), before.course, history
            )
            if self.friction == "shaken" and load > 1 - 1e-9:
                increase = shake(increase, solver)
        except EquilibriumFailed as failure:
            raise LoadsFailed(failure.reason, failure.residual, failure.remedy) from failure
        solved = increase.solved
        new = State(load, solved.x, still)
        step = close_loads(
            increase.over, new, before.force, increase.course, solved.counts, solved.error
        )
        solution = Solution(self, increase.path, memory, solved.x)
        return replace(step, history=increase.history, earlier=history, solution=solution)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Return the energy [J] that the slow motion from one equilibrium to the next takes away.

        The energies and the work in the ledger are for the full loads. The work of moved pins
        is the mean of their forces at both ends times the way. Of a step that was halved, what
        terms with a history dissipated before the last part is in it.
        """
        system_before, system_after = step.around(system)
        before = system_before.energies(old)
        after = system_after.energies(step.state)
        moved = step.state.x - old.x
        work = system.sums.dot(load_forces(system, step.state), moved)
        begin = (old.x, old.t)
        end = (step.state.x, step.state.t)
        for term in (step.over or system).bound:
            work += term.work(step.state.x) - term.dissipation(step.state.x)
            work += term.work_of_clamps(begin, end, (begin, end))
        force = step.force_on_pins(system)[system.constraints.nodes]
        work -= system.sums.dot(force, system.constraints.held_part(moved))
        work += closing_work(system, old, step)
        return sum(before.values()) - sum(after.values()) + work

    def __str__(self) -> str:
        steps = amount(self.load_steps, "load step")
        return f"static equilibrium in {steps}, tolerance {self.tolerance}"


def force_at(system: System, state: State, history: History | None) -> np.ndarray:
    """Return the force (n, 3) [N] of all terms where `state.t` is the part of the loads."""
    return system.with_bound(_scaled(system.with_history(history), state.t)).force(state)


def close_loads(
    over: System,
    new: State,
    first: np.ndarray,
    course: Course = NO_COURSE,
    counts: Counts = UNCOUNTED,
    error: float = math.nan,
) -> Step:
    """Return the step to the equilibrium `new`, whose t is the part of the loads.

    `over` is the system over its last increment, with whole loads; `first` (n, 3) is the force
    of all terms at the begin of the step [N], and `course` and `error` are as in `LoadCourse`.
    """
    over = over.with_bound(_scaled(over, new.t))
    memory = LoadCourse(course, over.force(new), error)
    return Step(new, new, memory, counts, over=over, first_force=first)


def _scaled(system: System, load: float) -> Iterator[Any]:
    """Yield the terms; loads among them act with the factor `load`."""
    for term in system.bound:
        if load != 1.0 and term.load:
            yield ScaledLoad(term, load)
        else:
            yield term
