"""BDF2, the two-step backward differentiation formula."""

from dataclasses import dataclass, replace

import numpy as np

from fecloth.integrators.impacts import Struck, after_impacts, with_forces
from fecloth.integrators.newmark import Newmark, WithMemory
from fecloth.integrators.one_stage import BackwardEuler
from fecloth.integrators.step import UNCOUNTED, Begin, Opening, Step, arrive
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.stage import Stage, hold_stage
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.terms.records import remembered
from fecloth.terms.step_difference import StepDifference


@remembered
@dataclass(frozen=True, eq=False)
class Change:
    """The memory of BDF2: the changes in the last step.

    Attributes
    ----------
    dt
        Size of that step [s].
    dx, dv
        (n, 3) Δx [m] and Δv [m/s]: of a cloth that has always moved as it does after the impacts.
    by_impacts
        (n, 3) the part of Δx [m] by which this differs from what the cloth has moved; None for 0.
    """

    dt: float
    dx: np.ndarray
    dv: np.ndarray
    by_impacts: np.ndarray | None = None


@dataclass(frozen=True)
class FirstStep(BackwardEuler):
    """x₁ = x₀ + dt (v₀ + v₁)/2,  M (v₁ − v₀)/dt = f(x₁, v₁): the first step with contact.

    It does not depend on the force at its begin: that force is not known, as a cloth that stands
    still may be held by any friction below the limit. A constant acceleration is exact, of a
    cloth that is free and of one that sticks to what accelerates.
    """

    def stage(self, state: State, dt: float) -> Stage:
        """Return the stage at the end of the step for q = v₁ − v₀."""
        stage = super().stage(state, dt)
        return replace(stage, wx=0.5 * dt, w_end=0.5 * dt)

    def difference(self, state: State, dt: float) -> StepDifference:
        """The rate of the trapezoidal rule."""
        return BDF2().difference(state, dt, None)


@dataclass(frozen=True)
class BDF2(WithMemory):
    """x₁ = x₀ + e Δx₋ + b dt v₁,  v₁ = v₀ + e Δv₋ + b dt a₁,  M a₁ = f(x₁, v₁);  q = v₁ − v₀.

    Δx₋ and Δv₋ are the changes of the step before, of size dt/r: e = r²/(1 + 2r) and
    b = (1 + r)/(1 + 2r). Second order, also with steps of changing size, whose ratio r must stay
    below 1 + √2 for stability; A-stable and L-stable at constant steps: fast modes vanish, slow
    ones lose about (ω dt)⁴/4 of their amplitude a step (1.7e-3 at ω dt = 0.3). The first step is
    by the trapezoidal rule, or with contact by `FirstStep`. Strain rates are the same
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

        After impacts, with their part J of Δx₋, y₋ is y(x₀ − Δx₋ + J), where the cloth has been,
        less (y(x₀ + J) − y(x₀ − J))/2, the change of y along J that is exact for y quadratic in x:
        a strain of straight ways that turn a triangle is none that it ever had.
        The rate of the first step is the trapezoidal rule's, (y₁ − y₀)/(dt/2) − ẏ₀, with ẏ₀ as
        the difference between x₀ ± dt/2 v₀ that is exact for y quadratic in x.
        """
        x = state.x
        if last is None:
            half_step = 0.5 * dt * state.v
            past = (1.0, x), (0.5, x + half_step), (-0.5, x - half_step)
            return StepDifference(x, dt, 0.5 * dt, past, t=state.t)
        e, b_dt = _coefficients(dt, last)
        jump = last.by_impacts
        if jump is None:
            both_before = (1 + e, x), (-e, x - last.dx)
            return StepDifference(x, dt, b_dt, both_before, t=state.t)
        by_jump = (0.5 * e, x + jump), (-0.5 * e, x - jump)
        both_before = (1 + e, x), (-e, x - last.dx + jump)
        return StepDifference(x, dt, b_dt, (*both_before, *by_jump), t=state.t)

    def _open(self, begin: Begin, solver: SolverContext | None) -> Opening:
        """Open a step after the step that left the memory of `begin`; q = v₁ − v₀.

        The first step is a step of the trapezoidal rule, or with contact a `FirstStep`: BDF2
        remains of second order with one step of first order. `solver` serves the trapezoidal
        rule only.
        """
        system, state, dt, memory, history = begin
        if any(term.needs_end for term in system.bound):
            _ = system.factor_of_mass  # which the copies of the system share
            if memory is None:
                return FirstStep()._open(begin, solver)
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
        struck = after_impacts(opening, new)
        memory = _make_memory(opening, struck)
        forces["history"] = with_forces(ending["history"], struck)
        return Step(struck.state, new, memory, counts, unstruck=new, works=struck.works, **forces)

    def _close_first(self, opening: Opening, q: np.ndarray, counts: Counts) -> Step:
        """Close the first step by the method that opened it, with the memory of BDF2."""
        step: Step = opening.method.close(opening, q, counts)
        new = step.unstruck or step.state
        memory = _make_memory(opening, after_impacts(opening, new))
        if step.ends:
            return replace(step, memory=memory)
        a = (new.v - opening.begin.v) / opening.dt
        before = opening.system.with_history(opening.history)
        return replace(step, memory=memory, ends=(before, opening.begin), a=a, share=1.0)


def _coefficients(dt: float, last: Change) -> tuple[float, float]:
    """The coefficients e and b dt of a step of size dt [s]."""
    r = dt / last.dt
    return r**2 / (1 + 2 * r), (1 + r) / (1 + 2 * r) * dt


def _make_memory(opening: Opening, struck: Struck) -> Change:
    """Return the changes in the step from `opening`, the next memory.

    They are the changes of a cloth that has always moved as it does after the impacts. So the
    stroke is taken out of the change of velocity. The force of the impacts has moved the cloth by
    h (stroke − beyond), where the stroke over the whole step moves it by dt stroke: the change of
    position gets the difference. Changes of pairs have no sum, so that momentum is kept.
    """
    old = opening.begin
    new = struck.state
    dt = new.t - old.t
    h = opening.stage.w_end
    dx = new.x - old.x
    jump = None
    if struck.stroke.any():
        jump = (dt - h) * struck.stroke + h * struck.beyond
        dx = dx + jump
    return Change(dt, dx, new.v - old.v - struck.stroke, jump)
