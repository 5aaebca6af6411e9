"""Derivatives of load steps and equilibria by a parameter: along increments of the loads."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fecloth.integrators.derivatives import DerivedStep
from fecloth.integrators.step import UNCOUNTED, Step
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.increment_derivatives import StaticTangent, derive_increment
from fecloth.nonlinear.increments import NO_COURSE, Course, LoadIncrement, SolvedIncrement
from fecloth.simulation.equilibrium import Equilibrium, equilibrium
from fecloth.simulation.load_steps import TERMS_TIME, LoadCourse, close_loads, force_at
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import shift

POLISHING_STEPS = 2  # Newton steps with one K, from an equilibrium that was found to round-off


@dataclass(frozen=True, eq=False)
class DerivedLoads:
    """A load step, or an equilibrium, whose derivatives are taken.

    Without friction and records of terms the end does not depend on the way there: the whole
    step is one increment then.

    Attributes
    ----------
    step, old
        The step, and the state before it.
    path
        Its increments, each with the factor of K at its end.
    tolerance
        Relative error of a derivative over an increment.
    """

    step: Step
    old: State
    path: tuple[tuple[SolvedIncrement, StaticTangent], ...]
    tolerance: float

    @classmethod
    def of(cls, system: System, old: State, step: Step, tolerance: float) -> Self:
        """Return a load step from the state `old`, ready for its derivatives."""
        assert step.solution is not None
        path = step.solution.opening
        if step.earlier is None and not any(term.needs_path for term in system.bound):
            start = State(TERMS_TIME, old.x, np.zeros_like(old.x))
            t = step.state.t
            whole = LoadIncrement(system, start, t, t - old.t, old.t, t)
            path = (SolvedIncrement(whole, step.state.x),)
        tangents = tuple((solved, StaticTangent.at(solved)) for solved in path)
        return cls(step, old, tangents, tolerance)

    @classmethod
    def at_rest(cls, system: System, start: State, rest: Equilibrium, tolerance: float) -> Self:
        """Return an equilibrium from `start`, as one step of all loads, ready for derivatives.

        It is found as exactly as round-off allows, because twin runs differ little: two more
        Newton steps follow, with the K of the derivatives.
        """
        begin = State(start.t, start.x, np.zeros_like(start.x))
        whole = LoadIncrement(
            system,
            begin,
            load=1.0,
            size=1.0,
            begin=start.t,
            end=start.t,
            history=system.start_history(begin),
        )
        tangent = StaticTangent.at(SolvedIncrement(whole, rest.x))
        x = rest.x
        for _ in range(POLISHING_STEPS):
            x = x - tangent.solve(whole.equation(x).residual(x, 0.0)[0])
        path = ((SolvedIncrement(whole, x), tangent),)
        return cls(_resting(system, replace(rest, x=x)), begin, path, tolerance)

    def derive(self, along: Along, sides: Sides) -> DerivedStep:
        """Return the derivatives at the end of the step, and the step at p + ε and p − ε."""
        at = replace(along, memory=None)
        for solved, tangent in self.path:
            derived = derive_increment(solved, at, sides, tangent, self.tolerance)
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
        if self.step.solution is None:
            return _resting(system, at)
        memory: LoadCourse | None = self.step.solution.memory
        history = shift(self.step.earlier, along.history, size)
        if memory is None:
            first = force_at(system, along.shift(self.old, size), history)
        else:
            without_course = LoadCourse(NO_COURSE, memory.force)
            first = shift(without_course, along.memory, size).force
        new = State(self.step.state.t, at.x, at.v)
        return close_loads(over, new, first, Course(np.zeros_like(at.x)))


def find_rest(system: System, start: State, report=lambda *_: None) -> Equilibrium:
    """Return the equilibrium as exactly as round-off allows, because twin runs differ little."""
    rest = equilibrium(system, start, report=report)
    return replace(rest, x=DerivedLoads.at_rest(system, start, rest, 0.0).step.state.x)


def _resting(system: System, state: State) -> Step:
    """Return the step that ends in an equilibrium, whose pins hold the forces there."""
    still = np.zeros_like(state.x)
    return Step(state, state, None, UNCOUNTED, a=still, ends=(system, state))
