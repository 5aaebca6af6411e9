"""Time integrators: each is the rule that takes one step, a few lines on the stage equation.

A method knows nothing of the terms; `integrators.protocol` says what it offers. `StageMethod` and
`WithMemory` are base classes for your own methods, as in studies/examples.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from fecloth.errors import IndefiniteMatrix
from fecloth.integrators.numerical_dissipation import bend
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Step, arrival, held
from fecloth.linalg.low_rank_update import solve_updated
from fecloth.linalg.reductions import dot
from fecloth.nonlinear import newton
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.stage import Stage, prescribed
from fecloth.nonlinear.statistics import Counts
from fecloth.system.system import State, System


class StageMethod:
    """Base class of a method with one stage; a subclass supplies `traits` and `stage`.

    `traits.theta` says where between old and new state the forces are balanced: over a step with
    free nodes M Δv · v_θ = f · Δx with v_θ = v + θ Δv, so that for energies quadratic in x the
    method dissipates (θ − ½)(Δv·M Δv + Δx·K Δx) by itself.
    """

    traits: MethodTraits

    def stage(self, state: State, dt: float) -> Stage:
        """The stage of a step from `state` over `dt` [s], and the end of the step, linear in q."""
        raise NotImplementedError

    def weights(self, dt: float) -> tuple[float, float, float]:
        """(wx, wv, wa) of J = wa M + wv D + wx K."""
        nothing = np.zeros((0, 3))
        stage = self.stage(State(0.0, nothing, nothing), dt)
        return stage.wx, stage.wv, stage.wa

    def step(
        self, system: System, state: State, dt: float, solver: SolverContext, memory=None
    ) -> Step:
        """One step from `state` over `dt` [s]."""
        end = arrival(system, state, dt)
        stage = prescribed(system, self.stage(state, dt), state, dt, end)
        q, counts = newton.solve(system, stage, solver, memory)
        x, v, a = stage.at(q)
        new = State(state.t + dt, stage.x_end + stage.w_end * q, state.v + dt * a)
        return Step(held(system, new, end), State(stage.t, x, v), q, counts)

    def numerical(self, system: System, old: State, step: Step) -> float:
        """Energy [J] that the method itself took in a step: (θ − ½)(Δv·M Δv + Δx·K Δx).

        Δx·K Δx is the change of the conservative force along Δx: exact for energies quadratic
        in x.
        """
        theta = self.traits.theta
        if theta == 0.5:
            return 0.0
        dv = step.state.v - old.v
        kinetic = dot(dv, system.scalar_mass @ dv)
        return (theta - 0.5) * (kinetic + bend(system, old, step.state))


@dataclass(frozen=True)
class BackwardEuler(StageMethod):
    """M (v₁ − v₀)/dt = f(x₁, v₁), x₁ = x₀ + dt v₁; unknown q = v₁ − v₀.

    First order, A-stable and L-stable: an undamped mode of frequency ω loses the factor
    1/√(1 + ω²dt²) of its amplitude in each step. Keeps linear momentum, loses angular momentum
    and energy. For energies quadratic in x it dissipates ½ Δv·M Δv + ½ Δx·K Δx a step.
    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eq. 4.
    """

    traits = MethodTraits(order=1, theta=1.0, error_constant=1 / 2)

    def stage(self, state: State, dt: float) -> Stage:
        x, zero = state.x + dt * state.v, np.zeros_like(state.v)
        return Stage(state.t + dt, x, state.v, zero, dt, 1.0, 1.0 / dt, x, dt)


@dataclass(frozen=True)
class ImplicitMidpoint(StageMethod):
    """M (v₁ − v₀)/dt = f((x₀ + x₁)/2, (v₀ + v₁)/2), x₁ = x₀ + dt (v₀ + v₁)/2; q = v₁ − v₀.

    Second order, A-stable, no damping of linear modes of any frequency. Symplectic; keeps linear
    and angular momentum to the Newton tolerance, and the energy of a linear problem; on
    nonlinear problems the energy can grow at steps that do not resolve the fast modes.
    Source: Hairer, Lubich and Wanner (2006), Geometric Numerical Integration, section I.1, eq. 1.7.
    """

    traits = MethodTraits(order=2, error_constant=1 / 12)

    def stage(self, state: State, dt: float) -> Stage:
        x, zero = state.x + 0.5 * dt * state.v, np.zeros_like(state.v)
        end = state.x + dt * state.v
        return Stage(state.t + 0.5 * dt, x, state.v, zero, 0.25 * dt, 0.5, 1.0 / dt, end, 0.5 * dt)


@dataclass(frozen=True)
class LinearlyImplicitEuler:
    """(M + dt D + dt² K) Δv = dt f(x₀, v₀) − dt² K v₀, x₁ = x₀ + dt (v₀ + Δv).

    One linear solve a step: the first Newton iterate of backward Euler. First order; on linear
    problems it is backward Euler, A-stable and L-stable, and damps like it. Keeps linear momentum,
    loses angular momentum, and energy unless it fails: at large steps on a stiff cloth in
    compression the linearisation does, without notice.
    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eq. 6 (their ∂f/∂x is −K).
    """

    traits = MethodTraits(order=1, theta=1.0, error_constant=1 / 2)

    def weights(self, dt: float) -> tuple[float, float, float]:
        """(wx, wv, wa), scaled as backward Euler's."""
        return dt, 1.0, 1.0 / dt

    def step(
        self, system: System, state: State, dt: float, solver: SolverContext, memory=None
    ) -> Step:
        """One step from `state` over `dt` [s]; the linear system is solved to Newton's tolerance.

        The exact tangent is used unless it is found to be indefinite and the options allow the
        clamped one.
        """
        end = arrival(system, state, dt)
        definite = solver.options.definiteness == "clamp"
        try:
            dv, counts = _velocity_change(system, state, dt, solver, end, definite, memory)
        except IndefiniteMatrix:
            if definite or solver.options.definiteness == "none":
                raise
            dv, counts = _velocity_change(system, state, dt, solver, end, True, memory)
        v = state.v + dv
        new = held(system, State(state.t + dt, state.x + dt * v, v), end)
        at_stage = State(new.t, new.x, v)  # the velocity that moved x, also at the pins
        return Step(new, at_stage, dv, counts)

    numerical = StageMethod.numerical


def _velocity_change(system, state, dt, solver, end, definite, guess):
    """Δv from the linearised step, and the counts."""
    begin = time.perf_counter()
    J, nodes = solver.matrix, system.constraints.nodes
    dv, inertial = np.zeros((2, *state.v.shape))  # of the held directions: what moves x, and v
    dv[nodes] = system.constraints.held((end.x - state.x) / dt - state.v)
    inertial[nodes] = system.constraints.held(end.v - state.v)
    system.assemble(J, state, wx=dt, definite=definite)
    dense = system.dense(state)
    b = system.force(state) - J @ state.v - _times(dense, dt, state.v)
    system.add_tangents(J, state, wv=1.0, definite=definite)
    b -= J @ dv + _times(dense, dt, dv) + system.scalar_mass @ (inertial / dt)
    system.add_tangents(J, state, wa=1.0 / dt)
    system.project(J)
    seconds = {"assemble": time.perf_counter() - begin}
    solver.begin(dt, 1.0 / dt)
    solver.linear.prepare(J)
    project, rtol = system.constraints.project, solver.options.tolerance
    start = None if guess is None else project(guess.copy())
    updates = [(dt * c, project(u)) for c, u in dense]
    free, infos = solve_updated(solver.linear, updates, project(b), rtol, start)
    seconds["factor"] = infos[0].seconds_factor
    seconds["solve"] = sum(info.seconds_solve for info in infos)
    iterations = sum(info.iterations for info in infos)
    return free + dv, Counts(
        newton=1,
        linear=iterations,
        modified=int(definite),
        factorisations=1,
        residual=infos[0].residual,
        seconds=seconds,
    )


def _times(dense, wx, v):
    """wx Σ c u (u · v)."""
    return sum((wx * c * dot(u, v) * u for c, u in dense), np.zeros_like(v))
