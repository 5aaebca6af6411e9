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
        """Return the stage of a step of BDF2 from `state`; the unknown is q = v₁ − v₀.

        `last` are the changes in the step before.
        """
        e, b_dt = _coefficients(dt, last)
        x = state.x + e * last.dx + b_dt * state.v  # x₁ with q = 0
        return Stage(
            t=state.t + dt,
            x=x,
            v=state.v,
            a=-e / b_dt * last.dv,
            wx=b_dt,
            wv=1.0,
            wa=1.0 / b_dt,
            x_end=x,
            w_end=b_dt,
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
        e, b_dt = _coefficients(dt, last)
        both_before = (1 + e, x), (-e, x - last.dx)
        return StepDifference(x, dt, b_dt, both_before, t=state.t)

    def _take(self, begin: Begin, solver: SolverContext) -> Step:
        """Take one step; if the force of contact jumps in it, take it again by backward Euler.

        In an impact the memory of the motion before would throw the cloth off. The counts of
        the step are then the sums of both.
        """
        step = super()._take(begin, solver)
        memory = begin.memory
        new_memory = cast(Change, step.memory)
        was_backward_euler = memory is None or memory.jumped  # with contact, see `_open`
        if was_backward_euler or not new_memory.jumped:
            return step
        # `_open` takes backward Euler after a memory that has jumped
        marked = begin._replace(memory=replace(memory, jumped=True))
        again = super()._take(marked, solver)
        return replace(again, counts=step.counts.plus(again.counts))

    def _open(self, begin: Begin, solver: SolverContext | None) -> Opening:
        """Open a step after the step that left the memory of `begin`; q = v₁ − v₀.

        The first step is a step of the trapezoidal rule. With contact it is a step of backward
        Euler, and so is the step after a step in which the force of contact jumped: they do
        not depend on the force at their begin. That force is not known, as a cloth that stands
        still may be held by any friction below the limit. BDF2 remains of second order with one
        step of first order. `solver` serves the trapezoidal rule only.
        """
        system, state, dt, memory, history = begin
        has_contact = any(term.needs_end for term in system.bound)
        if has_contact and (memory is None or memory.jumped):
            opening = BackwardEuler()._open(begin._replace(memory=None), solver)
            return replace(opening, memory=memory)  # `close` compares the force with this memory
        over = system.over_step(self.difference(state, dt, memory), history)
        if memory is None:
            return Newmark()._open(begin, solver, over)
        end = begin.end
        stage = self.stage(state, dt, memory)
        a_held = stage.a + stage.wa * (end.v - state.v)  # a₁ where the pins prescribe v₁
        stage = hold_stage(system, stage, end, a_held)
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
        return Step(new, new, _make_memory(opening, new), counts, **forces)

    def _close_first(self, opening: Opening, q: np.ndarray, counts: Counts) -> Step:
        """Close the first step by the method that opened it, with the memory of BDF2."""
        step: Step = opening.method.close(opening, q, counts)
        memory = _make_memory(opening, step.state)
        if step.ends:
            return replace(step, memory=memory)
        a = (step.state.v - opening.begin.v) / opening.dt
        before = opening.system.with_history(opening.history)
        return replace(step, memory=memory, ends=(before, opening.begin), a=a, share=1.0)


def _coefficients(dt: float, last: Change) -> tuple[float, float]:
    """The coefficients e and b dt of a step of size dt [s]."""
    r = dt / last.dt
    return r**2 / (1 + 2 * r), (1 + r) / (1 + 2 * r) * dt


def _make_memory(opening: Opening, new: State) -> Change:
    """Return the changes in the step from `opening` to the state `new`, the next memory.

    With contact the memory also has the force of the contacts in the new state, and whether it
    has jumped since the last step, see `FORCE_JUMP` and `MOMENTUM_JUMP`.
    """
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
    # in the first step the force before is not known: it counts as unchanged
    old_push = push if last is None else last.push
    change_of_push = norm(push - old_push)
    is_pushed = (push != 0.0) | (old_push != 0.0)
    is_touched = is_pushed.any(axis=1, keepdims=True)  # (n, 1)
    momentum = norm(opening.system.mass_times(old.v) * is_touched)
    force_jumps = change_of_push > FORCE_JUMP * max(norm(push), norm(old_push))
    momentum_jumps = change.dt * change_of_push > MOMENTUM_JUMP * momentum
    return replace(change, push=push, jumped=bool(force_jumps and momentum_jumps))
