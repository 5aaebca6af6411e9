"""Static equilibrium in load steps, as a choice of steps that `march` takes.

The "time" is the part of the loads that acts, from 0 at the start to 1. So frames, tables,
restart files and probes serve a static scene as they serve a motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fecloth.errors import amount
from fecloth.integrators.numerical_dissipation import load_forces
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import UNCOUNTED, Solution, Step
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.increments import increase_loads, shake, static_context
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.nonlinear.static_equation import EquilibriumFailed
from fecloth.nonlinear.statistics import Counts
from fecloth.simulation.step_times import ChosenSteps, step_times
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.records import remembered

TERMS_TIME = 0.0  # at which loads are evaluated: loads of a static scene do not depend on it


@remembered
@dataclass(frozen=True, eq=False)
class LoadRate:
    """After a step: where the next one begins its search, and the force on the pins."""

    # (n, 3) ∂x/∂(part of the loads) [m], beyond where the pins carry the cloth
    rate: np.ndarray | float
    force: np.ndarray  # (n, 3) of all terms [N]


@dataclass(frozen=True, eq=False)
class ScaledLoad(BoundTerm):
    """A bound load whose force is multiplied by `factor`."""

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
    """Equilibria under growing loads, by `increase_loads`; arguments as for `equilibrium`."""

    load_steps: int = 1
    tolerance: float | Literal["auto"] = "auto"
    max_iterations: int = 500
    friction: Literal["laid", "shaken"] = "laid"  # inside the fabric; shaken: at the end it is gone

    traits = MethodTraits(order=0, theta=1.0, stability=None, chooses_dt=True, has_difference=True)

    @property
    def method(self) -> "LoadSteps":
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
        name = "direct" if choice == "auto" else choice
        context = static_context(system, self.tolerance, self.max_iterations, name)
        assert context.linear is not None
        reason = "as for every equilibrium" if choice == "auto" else "requested"
        return context, f"{context.linear.name} ({reason})"

    def step(
        self, system: System, state: State, horizon: float, solver, memory=None, history=None
    ) -> Step:
        """Find the equilibrium under `state.t` + `horizon` of the loads, or `NewtonFailed`."""
        still = np.zeros_like(state.x)
        start = State(TERMS_TIME, state.x, still)
        load = state.t + horizon
        rate = memory.rate if memory else 0.0
        first = memory.force if memory else force_at(system, state, history)
        try:
            increase = increase_loads(
                system, start, solver, horizon, (state.t, load), rate, history
            )
            if self.friction == "shaken" and load > 1 - 1e-9:
                increase = shake(increase, solver)
        except EquilibriumFailed as failure:
            raise LoadsFailed(failure.reason, failure.residual, failure.remedy) from failure
        solved = increase.solved
        over = increase.over
        step = close_loads(over, State(load, solved.x, still), first, increase.rate, solved.counts)
        solution = Solution(self, increase.path, memory, solved.x)
        return replace(step, history=increase.history, earlier=history, solution=solution)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Energy [J] that the slow motion from one equilibrium to the next takes away.

        The energies and the work in the ledger are for the full loads. The work of moved pins
        is the mean of their forces at both ends times the way. Of a step that was halved, what
        terms with a history dissipated before the last part is in it.
        """
        system_before, system_after = step.around(system)
        before = system_before.energies(old)
        after = system_after.energies(step.state)
        work = system.sums.dot(load_forces(system, step.state), step.state.x - old.x)
        begin = (old.x, old.t)
        end = (step.state.x, step.state.t)
        for term in (step.over or system).bound:
            work += term.work(step.state.x) - term.dissipation(step.state.x)
            work += term.work_of_clamps(begin, end, (begin, end))
        held = system.constraints.held_part
        at = system.constraints.nodes
        work -= system.sums.dot(step.force_on_pins(system)[at], held(step.state.x - old.x))
        return sum(before.values()) - sum(after.values()) + work

    def __str__(self) -> str:
        steps = amount(self.load_steps, "load step")
        return f"static equilibrium in {steps}, tolerance {self.tolerance}"


def force_at(system: System, state: State, history: History | None) -> np.ndarray:
    """(n, 3) force [N] of all terms where `state.t` is the part of the loads."""
    return system.with_bound(_scaled(system.with_history(history), state.t)).force(state)


def close_loads(
    over: System,
    new: State,
    first: np.ndarray,
    rate: np.ndarray | float = 0.0,
    counts: Counts = UNCOUNTED,
) -> Step:
    """The step to the equilibrium `new`, whose t is the part of the loads, from a force `first`."""
    # `over` is the system over its last increment, with whole loads.
    over = over.with_bound(_scaled(over, new.t))
    return Step(new, new, LoadRate(rate, over.force(new)), counts, over=over, first_force=first)


def _scaled(system: System, load: float) -> Iterator[Any]:
    """Yield the terms; loads among them act with the factor `load`."""
    for term in system.bound:
        scales = load != 1.0 and term.load
        yield ScaledLoad(term, load) if scales else term
