"""Derivatives of a load step by a parameter: along its increments if terms remember the way."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fecloth.integrators.derivatives import DerivedStep
from fecloth.integrators.step import Step
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.increment_derivatives import StaticTangent, derive_increment
from fecloth.nonlinear.increments import LoadIncrement, SolvedIncrement
from fecloth.simulation.load_steps import TERMS_TIME, LoadRate, close_loads, force_at
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import shift


@dataclass(frozen=True, eq=False)
class DerivedLoads:
    """A load step whose derivatives are taken: its increments, with the factor of K at each end.

    Without friction and records of terms the end does not depend on the way there: the whole
    step is one increment then.

    Attributes
    ----------
    step, old
        The load step, and the state before it.
    path
        Its increments, each with the factor of K at its end.
    """

    step: Step
    old: State
    path: tuple[tuple[SolvedIncrement, StaticTangent], ...]

    @classmethod
    def of(cls, system: System, old: State, step: Step) -> Self:
        """Return a load step from the state `old`, ready for its derivatives."""
        assert step.solution is not None
        path = step.solution.opening
        if step.earlier is None and not any(term.needs_path for term in system.bound):
            start = State(TERMS_TIME, old.x, np.zeros_like(old.x))
            t = step.state.t
            whole = LoadIncrement(system, start, t, t - old.t, old.t, t)
            path = (SolvedIncrement(whole, step.state.x),)
        return cls(step, old, tuple((solved, StaticTangent.at(solved)) for solved in path))

    def derive(self, along: Along, sides: Sides) -> DerivedStep:
        """Return the derivatives at the end of the step, and the step at p + ε and p − ε."""
        at = replace(along, memory=None)
        for solved, tangent in self.path:
            derived = derive_increment(solved, at, sides, tangent)
            at = derived.end
        steps = [
            self._close(along, system, size, over, state)
            for (system, size), over, state in zip(
                sides.signed, derived.over, derived.states, strict=True
            )
        ]
        memories = steps[0].memory, steps[1].memory
        end = Along.between(steps[0].state, steps[1].state, 2 * sides.size, memories)
        return DerivedStep(replace(end, history=at.history), (steps[0], steps[1]))

    def _close(self, along: Along, system: System, size: float, over: System, at: State) -> Step:
        """Return the step to the equilibrium `at` over its last increment, `over`."""
        memory: LoadRate | None = None
        if self.step.solution:
            memory = self.step.solution.memory
        history = shift(self.step.earlier, along.history, size)
        if memory is None:
            first = force_at(system, along.shift(self.old, size), history)
        else:
            first = shift(memory, along.memory, size).force
        new = State(self.step.state.t, at.x, at.v)
        return close_loads(over, new, first, np.zeros_like(at.x))
