"""BDF2, the two-step backward differentiation formula."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from fecloth.integrators.newmark import Newmark, WithMemory
from fecloth.integrators.one_stage import BackwardEuler
from fecloth.integrators.step import UNCOUNTED, Begin, Opening, Step, arrive
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.stage import Stage, hold_stage
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.terms.records import remembered
from fecloth.terms.step_difference import StepDifference

# A step does not resolve an impact if the force of contact changes in it by this part, and if
# that would change the momentum of what it touches by this part.
JUMP = 0.5
KICK = 0.35


@remembered
@dataclass(frozen=True, eq=False)
class Change:
    """Step size [s], Δx and Δv (n, 3) of the last step; with contact, how it ended."""

    dt: float
    dx: np.ndarray
    dv: np.ndarray
    push: np.ndarray | None = None  # (n, 3) force of the contacts at its end [N]
    jumped: bool = False  # whether this has changed within the step by more than half


@dataclass(frozen=True)
class BDF2(WithMemory):
    """x₁ = x₀ + e Δx₋ + b dt v₁,  v₁ = v₀ + e Δv₋ + b dt a₁,  M a₁ = f(x₁, v₁);  q = v₁ − v₀.

    Δx₋ and Δv₋ are the changes of the step before, of size dt/r: e = r²/(1 + 2r) and
    b = (1 + r)/(1 + 2r). Second order, also with steps of changing size, whose ratio r must stay
    below 1 + √2 for stability; A-stable and L-stable at constant steps: fast modes vanish, slow
    ones lose about (ω dt)⁴/4 of their amplitude a step (1.7e-3 at ω dt = 0.3). The first step is
    by the trapezoidal rule, or with contact by backward Euler. Strain rates are the same
    differences of E, so that damping has a potential over the step.
    Keeps linear momentum, loses angular momentum and energy.
    Source: Hairer, Nørsett and Wanner (1993), Solving Ordinary Differential Equations I, III.5.
    """

    # the error constant of constant steps
    traits = replace(
        BackwardEuler.traits, order=2, theta=0.5, error_constant=2 / 9, drift=(2, 1 / 3)
    )

    def stage(self, state: State, dt: float, last: Change) -> Stage:
        """The stage of a step from `state`, after the change that led there."""
        e, h = _coefficients(dt, last)
        x = state.x + e * last.dx + h * state.v
        return Stage(state.t + dt, x, state.v, -e / h * last.dv, h, 1.0, 1.0 / h, x, h)

    def difference(self, state: State, dt: float, last: Change | None) -> StepDifference:
        """The method's rate of y(x): (y₁ − (1 + e) y₀ + e y₋)/(b dt).

        The rate of the first step is the trapezoidal rule's, (y₁ − y₀)/(dt/2) − ẏ₀, with ẏ₀ as
        the difference between x₀ ± dt/2 v₀ that is exact for y quadratic in x.
        """
        x = state.x
        if last is None:
            way = 0.5 * dt * state.v
            past = (1.0, x), (0.5, x + way), (-0.5, x - way)
            return StepDifference(x, dt, 0.5 * dt, past, t=state.t)
        e, h = _coefficients(dt, last)
        return StepDifference(x, dt, h, ((1 + e, x), (-e, x - last.dx)), t=state.t)

    def _take(self, begin: Begin, solver: SolverContext) -> Step:
        """One step.

        A step in which the force of contact jumps, as in an impact, is taken again by backward
        Euler: the memory of the motion before would throw the cloth off.
        """
        step = super()._take(begin, solver)
        last = begin.memory
        after = cast(Change, step.memory)
        if last is None or last.jumped or not after.jumped:
            return step
        again = super()._take(begin._replace(memory=replace(last, jumped=True)), solver)
        return replace(again, counts=step.counts.plus(again.counts))

    def _open(self, begin: Begin, solver: SolverContext | None) -> Opening:
        """Open a step after the one that left this memory; q = v₁ − v₀.

        The first step is a step of another method. With contact it is of first order, which
        leaves this method of second order: the friction and the push at its begin are not to
        be relied on, as a cloth that stands still may be held by any friction below the limit.
        So is the step after a step in which the force of contact jumped.
        """
        system, state, dt, memory, history = begin
        contact = any(term.needs_end for term in system.bound)
        if contact and (memory is None or memory.jumped):
            opening = BackwardEuler()._open(begin._replace(memory=None), solver)
            return replace(opening, memory=memory)
        over = system.over_step(self.difference(state, dt, memory), history)
        if memory is None:
            return Newmark()._open(begin, solver, over)
        end = begin.end
        stage = self.stage(state, dt, memory)
        stage = hold_stage(system, stage, end, stage.a + stage.wa * (end.v - state.v))
        before = system.with_history(history)
        return Opening(self, before, over, stage, state, end, dt, memory, memory.dv, history)

    def close(self, opening: Opening, q: np.ndarray, counts: Counts = UNCOUNTED) -> Step:
        """The step to the unknown q (n, 3): x₁ = x_end + w_end q, v₁ = v₀ + q."""
        stage = opening.stage
        if opening.method is not self:
            return self._close_first(opening, q, counts)
        _, v, a = stage.at(q)
        new, ending = arrive(opening, opening.end.t, stage.x_end + stage.w_end * q, v)
        forces = ending | {"ends": (opening.system, opening.begin), "a": a, "share": 1.0}
        return Step(new, new, _memory(opening, new), counts, **forces)

    def _close_first(self, opening: Opening, q: np.ndarray, counts: Counts) -> Step:
        """The first step, by the method that opened it; its memory and reactions are of this."""
        step: Step = opening.method.close(opening, q, counts)
        memory = _memory(opening, step.state)
        if step.ends:
            return replace(step, memory=memory)
        a = (step.state.v - opening.begin.v) / opening.dt
        before = opening.system.with_history(opening.history)
        return replace(step, memory=memory, ends=(before, opening.begin), a=a, share=1.0)


def _coefficients(dt: float, last: Change) -> tuple[float, float]:
    """Return e and b dt."""
    r = dt / last.dt
    return r**2 / (1 + 2 * r), (1 + r) / (1 + 2 * r) * dt


def _memory(opening: Opening, new: State) -> Change:
    old = opening.begin
    last = opening.memory
    change = Change(new.t - old.t, new.x - old.x, new.v - old.v)
    pairs = zip(opening.system.bound, opening.over.bound, strict=True)
    contacts = [over for term, over in pairs if term.needs_end]
    if not contacts:
        return change
    push = np.zeros_like(new.x)
    size = opening.system.sums.norm
    for contact in contacts:
        contact.add_force(new.x, new.v, new.t, push)
    before = push if last is None else last.push
    changed = size(push - before)
    touched = (push != 0.0) | (before != 0.0)
    stopped = size(opening.system.mass_times(old.v) * touched.any(axis=1, keepdims=True))
    jumped = changed > JUMP * max(size(push), size(before)) and change.dt * changed > KICK * stopped
    return replace(change, push=push, jumped=bool(jumped))
