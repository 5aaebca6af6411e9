"""Implicit methods with one stage: their base class, backward Euler and the midpoint rule."""

from dataclasses import dataclass, replace

import numpy as np

from fecloth.integrators.impacts import after_impacts, with_forces
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
        """The `Stage` of a step from `state` over `dt` [s]: all of it is linear in q."""
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
        """Open a step from the state of `begin`; its unknown q is the unknown of `stage`.

        The memory, the q of the last step, is the first guess.
        """
        system, state, dt, memory, history = begin
        end = begin.end
        stage = prescribed(system, self.stage(state, dt), state, dt, end)
        # A method written for an older version may have an `over_step` without a history.
        records = () if history is None else (history,)
        over = self.over_step(system, state, dt, *records)
        return Opening(
            method=self,
            system=system,
            over=over,
            stage=stage,
            begin=state,
            end=end,
            dt=dt,
            memory=memory,
            guess=memory,
            history=history,
        )

    def close(self, opening: Opening, q: np.ndarray, counts: Counts = UNCOUNTED) -> Step:
        """Close the step with the unknown q (n, 3): x₁ = x_end + w_end q, v₁ = v₀ + dt a."""
        stage = opening.stage
        begin = opening.begin
        dt = opening.dt
        x, v, a = stage.at(q)
        x_end = stage.x_end + stage.w_end * q
        new, ending = arrive(opening, t=begin.t + dt, x=x_end, v=begin.v + dt * a)
        return Step(new, State(stage.t, x, v), memory=q, counts=counts, **ending)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Numerical dissipation [J] of a step: (θ − ½)(Δv·M Δv + Δx·K Δx).

        Δx·K Δx is the change of the conservative force along Δx: exact for energies quadratic
        in x. `work_beyond_dissipation` and `barrier_dissipation` are added. For θ = ½ it is 0.
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
        """Return the stage at the end of the step, x = x₁, v = v₁, for q = v₁ − v₀."""
        x = state.x + dt * state.v  # x₁ with q = 0
        return Stage(
            t=state.t + dt,
            x=x,
            v=state.v,
            a=np.zeros_like(state.v),
            wx=dt,
            wv=1.0,
            wa=1.0 / dt,
            x_end=x,
            w_end=dt,
        )

    def difference(self, state: State, dt: float) -> StepDifference:
        """The method's rate of y(x): (y(x₁) − y(x₀))/dt."""
        return StepDifference.between(state.x, dt, state.t)

    def close(self, opening: Opening, q: np.ndarray, counts: Counts = UNCOUNTED) -> Step:
        """Close the step with the unknown q (n, 3), and let impacts change its velocities."""
        step = super().close(opening, q, counts)
        struck = after_impacts(opening, step.state)
        return replace(
            step,
            state=struck.state,
            unstruck=step.state,
            works=struck.works,
            history=with_forces(step.history, struck),
        )


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
        """Return the stage in the middle of the step, for q = v₁ − v₀.

        There x = x₀ + dt/2 v₀ + dt/4 q and v = v₀ + q/2.
        """
        return Stage(
            t=state.t + 0.5 * dt,
            x=state.x + 0.5 * dt * state.v,
            v=state.v,
            a=np.zeros_like(state.v),
            wx=0.25 * dt,
            wv=0.5,
            wa=1.0 / dt,
            x_end=state.x + dt * state.v,
            w_end=0.5 * dt,
        )
