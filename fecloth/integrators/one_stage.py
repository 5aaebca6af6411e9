"""Implicit methods with one stage: their base class, backward Euler and the midpoint rule."""

from dataclasses import dataclass

import numpy as np

from fecloth.integrators.numerical_dissipation import (
    barrier_dissipation,
    stiffness_product,
    work_beyond_dissipation,
)
from fecloth.integrators.protocol import ALL_STUDIES, MethodTraits
from fecloth.integrators.step import UNCOUNTED, Begin, Opening, OpensSteps, Step, arrive
from fecloth.nonlinear.stage import Stage, prescribed
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.step_difference import StepDifference


class StageMethod(OpensSteps):
    """Base class of a method with one stage; a subclass supplies `traits` and `stage`.

    The memory is the unknown of the last step, the first guess of the next one.

    `traits.theta` says where between old and new state the forces are balanced: over a step with
    free nodes M Δv · v_θ = f · Δx with v_θ = v + θ Δv, so that for energies quadratic in x the
    numerical dissipation is (θ − ½)(Δv·M Δv + Δx·K Δx).
    """

    traits: MethodTraits

    def stage(self, state: State, dt: float) -> Stage:
        """The stage of a step from `state` over `dt` [s], and the end of the step, linear in q."""
        raise NotImplementedError

    def difference(self, state: State, dt: float) -> StepDifference:
        """The method's rate of y(x) over a step from `state`: for y = x the stage's velocity."""
        return self.stage(state, dt).difference(state, dt)

    def over_step(
        self, system: System, state: State, dt: float, history: History | None = None
    ) -> System:
        """The system with the forces over a step from `state`, whose terms have this history."""
        rates = self.traits.has_difference
        if history is None and not rates:
            return system
        return system.over_step(self.difference(state, dt), history, rates)

    def _open(self, begin: Begin, solver: object) -> Opening:
        """Its unknown q is the unknown of `stage`."""
        system, state, dt, memory, history = begin
        end = begin.end
        stage = prescribed(system, self.stage(state, dt), state, dt, end)
        records = () if history is None else (history,)  # which an older class may not take
        over = self.over_step(system, state, dt, *records)
        return Opening(self, system, over, stage, state, end, dt, memory, memory, history)

    def close(self, opening: Opening, q: np.ndarray, counts: Counts = UNCOUNTED) -> Step:
        """The step to the unknown q (n, 3): x₁ = x_end + w_end q, v₁ = v₀ + dt a."""
        stage = opening.stage
        begin = opening.begin
        dt = opening.dt
        x, v, a = stage.at(q)
        at = begin.t + dt, stage.x_end + stage.w_end * q, begin.v + dt * a
        new, ending = arrive(opening, *at)
        return Step(new, State(stage.t, x, v), q, counts, **ending)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Numerical dissipation [J] of a step: (θ − ½)(Δv·M Δv + Δx·K Δx).

        Δx·K Δx is the change of the conservative force along Δx: exact for energies quadratic
        in x. Added is the work against damping over the step beyond what that dissipates.
        """
        theta = self.traits.theta
        if theta == 0.5:
            return 0.0
        dv = step.state.v - old.v
        kinetic = system.sums.dot(dv, system.mass_times(dv))
        lost = (theta - 0.5) * (kinetic + stiffness_product(system, old, step))
        lost += work_beyond_dissipation(system, old, step)
        return lost + barrier_dissipation(system, old, step)


@dataclass(frozen=True)
class BackwardEuler(StageMethod):
    """M (v₁ − v₀)/dt = f(x₁, v₁), x₁ = x₀ + dt v₁; unknown q = v₁ − v₀.

    First order, A-stable and L-stable: an undamped mode of frequency ω loses the factor
    1/√(1 + ω²dt²) of its amplitude in each step. Keeps linear momentum, loses angular momentum
    and energy. For energies quadratic in x it dissipates ½ Δv·M Δv + ½ Δx·K Δx a step. Strain
    rates are (E₁ − E₀)/dt, so that damping has a potential over the step.
    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eq. 4.
    """

    traits = MethodTraits(
        order=1,
        theta=1.0,
        error_constant=1 / 2,
        drift=(1, 1 / 2),
        has_difference=True,
        at_infinity=0.0,
        studied=ALL_STUDIES,
    )

    def stage(self, state: State, dt: float) -> Stage:
        x = state.x + dt * state.v
        zero = np.zeros_like(state.v)
        return Stage(state.t + dt, x, state.v, zero, dt, 1.0, 1.0 / dt, x, dt)

    def difference(self, state: State, dt: float) -> StepDifference:
        """The method's rate of y(x): (y(x₁) − y(x₀))/dt."""
        return StepDifference.between(state.x, dt, state.t)


@dataclass(frozen=True)
class ImplicitMidpoint(StageMethod):
    """M (v₁ − v₀)/dt = f((x₀ + x₁)/2, (v₀ + v₁)/2), x₁ = x₀ + dt (v₀ + v₁)/2; q = v₁ − v₀.

    Second order, A-stable, no damping of linear modes of any frequency. Symplectic; keeps
    linear and angular momentum to the Newton tolerance, and the energy of a linear problem; on
    nonlinear problems the energy can grow at steps that do not resolve the fast modes. Source:
    Hairer, Lubich and Wanner (2006), Geometric Numerical Integration, section I.1, eq. 1.7.
    """

    traits = MethodTraits(
        order=2, error_constant=1 / 12, drift=(2, 1 / 12), gains=True, studied=ALL_STUDIES
    )

    def stage(self, state: State, dt: float) -> Stage:
        x = state.x + 0.5 * dt * state.v
        zero = np.zeros_like(state.v)
        end = state.x + dt * state.v
        return Stage(state.t + 0.5 * dt, x, state.v, zero, 0.25 * dt, 0.5, 1.0 / dt, end, 0.5 * dt)
