"""The linearly implicit Euler method: one linear solve a step."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from fecloth.errors import IndefiniteMatrix
from fecloth.integrators.one_stage import StageMethod
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Step, prescribed_end, set_prescribed
from fecloth.linalg.low_rank_update import solve_updated
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True)
class LinearlyImplicitEuler:
    """(M + dt D + dt² K) Δv = dt f(x₀, v₀) − dt² K v₀, x₁ = x₀ + dt (v₀ + Δv).

    One linear solve a step: the first Newton iterate of backward Euler. First order; on linear
    problems it is backward Euler, A-stable and L-stable, and damps like it. Keeps linear momentum,
    loses angular momentum, and energy unless it fails: at large steps on a stiff cloth in
    compression the linearisation does, without notice.
    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eq. 6 (their ∂f/∂x is −K).
    """

    traits = MethodTraits(order=1, theta=1.0, error_constant=1 / 2, drift=(1, 1 / 2))

    def step(
        self,
        system: System,
        state: State,
        dt: float,
        solver: SolverContext,
        memory: np.ndarray | None = None,
    ) -> Step:
        """One step from `state` over `dt` [s]; the linear system is solved to Newton's tolerance.

        The exact tangent is used unless it is found to be indefinite and the options allow the
        clamped one.
        """
        end = prescribed_end(system, state, dt)
        definite = solver.options.definiteness == "clamp"
        try:
            dv, counts = _velocity_change(system, state, dt, solver, end, definite, memory)
        except IndefiniteMatrix:
            if definite or solver.options.definiteness == "none":
                raise
            dv, counts = _velocity_change(system, state, dt, solver, end, True, memory)
        v = state.v + dv
        new = set_prescribed(system, State(state.t + dt, state.x + dt * v, v), end)
        at_stage = State(new.t, new.x, v)  # the velocity that moved x, also at the pins
        return Step(new, at_stage, dv, counts)

    numerical = StageMethod.numerical


def _velocity_change(
    system: System,
    state: State,
    dt: float,
    solver: SolverContext,
    end: State,
    definite: bool,
    guess: np.ndarray | None,
) -> tuple[np.ndarray, Counts]:
    """Δv from the linearised step, and the counts."""
    begin = time.perf_counter()
    (linear, J), nodes = solver.matrix_solver(), system.constraints.nodes
    dv, inertial = np.zeros((2, *state.v.shape))  # of the held directions: what moves x, and v
    dv[nodes] = system.constraints.held_part((end.x - state.x) / dt - state.v)
    inertial[nodes] = system.constraints.held_part(end.v - state.v)
    system.assemble(J, state, wx=dt, definite=definite)
    dense = system.dense(state)
    b = system.force(state) - J @ state.v - _times(system, dense, dt, state.v)
    system.add_tangents(J, state, wv=1.0, definite=definite)
    b -= J @ dv + _times(system, dense, dt, dv) + system.scalar_mass @ (inertial / dt)
    system.add_tangents(J, state, wa=1.0 / dt)
    system.project(J)
    seconds = {"assemble": time.perf_counter() - begin}
    solver.begin(dt, 1.0 / dt, state.x)
    linear.prepare(J)
    project, rtol = system.constraints.project, solver.options.residual
    start = None if guess is None else project(guess.copy())
    updates = [(dt * c, project(u)) for c, u in dense]
    free, infos = solve_updated(linear, updates, project(b), rtol, start)
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


def _times(
    system: System, dense: list[tuple[float, np.ndarray]], wx: float, v: np.ndarray
) -> np.ndarray:
    """wx Σ c u (u · v)."""
    return sum((wx * c * system.sums.dot(u, v) * u for c, u in dense), np.zeros_like(v))
