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

# A step does not resolve an impact if the force of contact changes in it by more than this share
# of the larger of both forces, …
FORCE_JUMP = 0.5
# … and if this change would take more than this share of the momentum of the nodes in contact.
MOMENTUM_JUMP = 0.35


@remembered
@dataclass(frozen=True, eq=False)
class Change:
    """The memory of BDF2: the changes in the last step.

    Attributes
    ----------
    dt
        Size of that step [s].
    dx, dv
        (n, 3) Δx [m] and Δv [m/s].
    push
        (n, 3) force of the contacts at its end [N]; None without contact.
    jumped
        Whether this force has jumped within the step, as in an impact.
    """

    dt: float
    dx: np.ndarray
    dv: np.ndarray
    push: np.ndarray | None = None
    jumped: bool = False


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
        return Stage(
            t=state.t + dt,
            x=x,
            v=state.v,
            a=-e / h * last.dv,
            wx=h,
            wv=1.0,
            wa=1.0 / h,
            x_end=x,
            w_end=h,
        )

    def difference(self, state: State, dt: float, last: Change | None) -> StepDifference:
        """The method's rate of y(x): (y₁ − (1 + e) y₀ + e y₋)/(b dt).

        The rate of the first step is the trapezoidal rule's, (y₁ − y₀)/(dt/2) − ẏ₀, with ẏ₀ as
        the difference between x₀ ± dt/2 v₀ that is exact for y quadratic in x.
        """
        x = state.x
        if last is None:
            half_step = 0.5 * dt * state.v
            past = (1.0, x), (0.5, x + half_step), (-0.5, x - half_step)
            return StepDifference(x, dt, 0.5 * dt, past, t=state.t)
        e, h = _coefficients(dt, last)
        return StepDifference(x, dt, h, ((1 + e, x), (-e, x - last.dx)), t=state.t)

    def _take(self, begin: Begin, solver: SolverContext) -> Step:
        """One step; a step in which the force of contact jumps is taken again by backward Euler.

        In an impact the memory of the motion before would throw the cloth off.
        """
        step = super()._take(begin, solver)
        last = begin.memory
        after = cast(Change, step.memory)
        if last is None or last.jumped or not after.jumped:
            return step
        again = super()._take(begin._replace(memory=replace(last, jumped=True)), solver)
        return replace(again, counts=step.counts.plus(again.counts))

    def _open(self, begin: Begin, solver: SolverContext | None) -> Opening:
        """Open a step after the step that left this memory; q = v₁ − v₀.

        The first step is a step of the trapezoidal rule. With contact it is a step of backward
        Euler, and so is the step after a step in which the force of contact jumped: they do
        not depend on the force at their begin. That force is not known, as a cloth that stands
        still may be held by any friction below the limit. BDF2 remains of second order with one
        step of first order.
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
        return Opening(
            method=self,
            system=before,
            over=over,
            stage=stage,
            begin=state,
            end=end,
            dt=dt,
            memory=memory,
            guess=memory.dv,
            history=history,
        )

    def close(self, opening: Opening, q: np.ndarray, counts: Counts = UNCOUNTED) -> Step:
        """Close the step with the unknown q (n, 3): x₁ = x_end + w_end q, v₁ = v₀ + q."""
        stage = opening.stage
        if opening.method is not self:
            return self._close_first(opening, q, counts)
        _, v, a = stage.at(q)
        new, ending = arrive(opening, opening.end.t, stage.x_end + stage.w_end * q, v)
        forces = ending | {"ends": (opening.system, opening.begin), "a": a, "share": 1.0}
        return Step(new, new, _memory(opening, new), counts, **forces)

    def _close_first(self, opening: Opening, q: np.ndarray, counts: Counts) -> Step:
        """Close the first step by the method that opened it, with the memory of BDF2."""
        step: Step = opening.method.close(opening, q, counts)
        memory = _memory(opening, step.state)
        if step.ends:
            return replace(step, memory=memory)
        a = (step.state.v - opening.begin.v) / opening.dt
        before = opening.system.with_history(opening.history)
        return replace(step, memory=memory, ends=(before, opening.begin), a=a, share=1.0)


def _coefficients(dt: float, last: Change) -> tuple[float, float]:
    """The coefficients e and b dt of a step of size dt [s]."""
    r = dt / last.dt
    return r**2 / (1 + 2 * r), (1 + r) / (1 + 2 * r) * dt


def _memory(opening: Opening, new: State) -> Change:
    """The changes in the step from an opening to a new state."""
    old = opening.begin
    last = opening.memory
    change = Change(new.t - old.t, new.x - old.x, new.v - old.v)
    pairs = zip(opening.system.bound, opening.over.bound, strict=True)
    contacts = [over for term, over in pairs if term.needs_end]
    if not contacts:
        return change
    push = np.zeros_like(new.x)
    norm = opening.system.sums.norm
    for contact in contacts:
        contact.add_force(new.x, new.v, new.t, push)
    before = push if last is None else last.push
    changed = norm(push - before)
    is_touched = (push != 0.0) | (before != 0.0)
    momentum = norm(opening.system.mass_times(old.v) * is_touched.any(axis=1, keepdims=True))
    force_jumps = changed > FORCE_JUMP * max(norm(push), norm(before))
    momentum_jumps = change.dt * changed > MOMENTUM_JUMP * momentum
    return replace(change, push=push, jumped=bool(force_jumps and momentum_jumps))
