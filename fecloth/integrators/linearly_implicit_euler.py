"""The linearly implicit Euler method: one linear solve a step."""

import time
from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import IndefiniteMatrix
from fecloth.integrators.one_stage import BackwardEuler, StageMethod
from fecloth.integrators.step import UNCOUNTED, Begin, OpensSteps, Solution, Step, arrive
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import Updates, solve_updated
from fecloth.linalg.protocol import remainder
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import History, System

# Relative residual of the linear equation with the tolerance "auto". Where small errors do not
# grow, it leaves errors below 1e-5 of the motion, a thousandth of the method's own error in time.
RESIDUAL_OF_AUTO = 1e-4


@dataclass(frozen=True, eq=False)
class LinearOpening:
    """A step of `LinearlyImplicitEuler` that is open: its residual is linear in q.

    The unknown q (n, 3) [m/s] is Δv of the free directions.

    Attributes
    ----------
    system, over, begin, end, dt, guess, history
        As in `Opening`.
    held
        (n, 3) Δv of the held directions that moves x to its prescribed end [m/s].
    definite
        Whether K and D are clamped, so that the tangent is positive definite.
    """

    system: System
    over: System
    begin: State
    end: State
    dt: float
    guess: np.ndarray | None
    history: History | None
    held: np.ndarray
    definite: bool = False

    @property
    def inertial(self) -> np.ndarray:
        """(n, 3) Δv of the held directions in the inertial force: v₁ − v₀ of the pins [m/s]."""
        dv = np.zeros_like(self.begin.v)
        constraints = self.over.constraints
        dv[constraints.nodes] = constraints.held_part(self.end.v - self.begin.v)
        return dv

    def residual(self, q: np.ndarray) -> np.ndarray:
        """R(q) = M Δv/dt − f(x₀, v₀) + dt K (v₀ + Δv) + D Δv along the free directions.

        Return it (n, 3) [N]. In M Δv and in K (v₀ + Δv) the Δv of the held directions differ:
        see `inertial` and `held`. K includes the parts of low rank c u uᵀ, `System.dense`.
        """
        matrix = BlockMatrix.zeros(self.over.pattern, self.over.team)
        return self.residual_by(self.assemble(matrix), q, self.over.dense(self.begin))

    def assemble(self, J: BlockMatrix) -> BlockMatrix:
        """Write dt K + D at the begin of the step to J, without parts of low rank; return J."""
        return self.over.assemble(J, self.begin, wx=self.dt, wv=1.0, definite=self.definite)

    def residual_by(self, A: BlockMatrix, q: np.ndarray, dense: Updates) -> np.ndarray:
        """R(q) as `residual`, with A = dt K + D and the parts of low rank of K."""
        system = self.over
        begin = self.begin
        v = begin.v + (q + self.held)
        a = (q + self.inertial) / self.dt
        f = system.force(begin) - system.mass_times(a)
        if any(term.velocity_dependent for term in system.bound):  # A v has D v₀ + D Δv
            D = BlockMatrix.zeros(system.pattern, system.team)
            f += system.assemble(D, begin, wv=1.0, definite=self.definite) @ begin.v
        for c, u in dense:
            f -= self.dt * c * system.sums.dot(u, v) * u
        free: np.ndarray = system.constraints.reduce(-remainder(A, f, v))
        return free

    def tangent(self, q: np.ndarray, J: BlockMatrix) -> BlockMatrix:
        """Write ∂R/∂q = M/dt + D + dt K at the begin of the step to J, and return J.

        It is along the free directions, without parts of low rank, and does not depend on q.
        """
        return self.complete(self.assemble(J))

    def complete(self, J: BlockMatrix) -> BlockMatrix:
        """Add M/dt to J = dt K + D, in place, along the free directions; return J."""
        system = self.over
        return system.project(system.add_tangents(J, self.begin, wa=1.0 / self.dt))


@dataclass(frozen=True)
class LinearlyImplicitEuler(OpensSteps):
    """(M + dt D + dt² K) Δv = dt f(x₀, v₀) − dt² K v₀, x₁ = x₀ + dt (v₀ + Δv).

    One linear solve a step: the first Newton iterate of backward Euler. First order. On linear
    problems it is backward Euler: A-stable and L-stable, with the same damping. Keeps linear
    momentum, loses angular momentum, and loses energy unless the linearisation fails. At large
    steps on a stiff cloth in compression it fails without notice.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eq. 6 (their ∂f/∂x is −K).
    """

    traits = replace(
        BackwardEuler.traits,
        has_difference=False,
        gains=True,
        solves=False,
        studied=("stability", "tune"),
    )

    def _open(self, begin: Begin, solver: object) -> LinearOpening:
        """Open a step, whose unknown q is Δv of the free directions."""
        system, state, dt, memory, history = begin
        end = begin.end
        needed_v = (end.x - state.x) / dt  # moves x to its prescribed end
        held = system.constraints.correction(needed_v - state.v)
        return LinearOpening(
            system=system,
            over=begin.over,
            begin=state,
            end=end,
            dt=dt,
            guess=memory,
            history=history,
            held=held,
        )

    def close(self, opening: LinearOpening, q: np.ndarray, counts: Counts = UNCOUNTED) -> Step:
        """Close the step with the velocity change q (n, 3): v₁ = v₀ + q, x₁ = x₀ + dt v₁."""
        begin = opening.begin
        dt = opening.dt
        dv = q + opening.held
        v = begin.v + dv
        new, ending = arrive(opening, begin.t + dt, begin.x + dt * v, v)
        at_stage = State(new.t, new.x, v)  # the velocity that moved x, also at the pins
        return Step(new, at_stage, dv, counts, **ending)

    def _take(self, begin: Begin, solver: SolverContext) -> Step:
        """Take one step, with the exact tangent, or the clamped one if that is indefinite.

        With ``definiteness="clamp"`` the tangent is clamped at once, with "none" never: then
        `IndefiniteMatrix` is raised.
        """
        definite = solver.options.definiteness == "clamp"
        opening = replace(self.open(*begin), definite=definite)
        try:
            dv, counts = _velocity_change(opening, solver)
        except IndefiniteMatrix:
            if definite or solver.options.definiteness == "none":
                raise
            opening = replace(opening, definite=True)
            dv, counts = _velocity_change(opening, solver)
        step = self.close(opening, dv, counts)
        return replace(step, solution=Solution(self, opening, begin.memory, dv))

    numerical = StageMethod.numerical


def _velocity_change(opening: LinearOpening, solver: SolverContext) -> tuple[np.ndarray, Counts]:
    """Solve the linearised step; return Δv (n, 3) [m/s] of the free directions, and the counts.

    The guess is Δv of the last step. Raises `IndefiniteMatrix` or `SolveFailed` as the solver.
    """
    began = time.perf_counter()
    system = opening.over
    begin = opening.begin
    dt = opening.dt
    linear, J = solver.matrix_solver()
    dense = system.dense(begin)
    b = -opening.residual_by(opening.assemble(J), np.zeros_like(begin.v), dense)
    opening.complete(J)
    seconds = {"assemble": time.perf_counter() - began}
    solver.begin(dt, 1.0 / dt, begin.x)
    linear.prepare(J)
    constraints = system.constraints
    guess = opening.guess
    if guess is not None:
        guess = constraints.project(guess.copy())
    updates = [(dt * c, constraints.reduce(u)) for c, u in dense]
    options = solver.options
    rtol = RESIDUAL_OF_AUTO if options.tolerance == "auto" else options.tolerance
    free, infos = solve_updated(linear, updates, b, rtol, guess)
    seconds["factor"] = infos[0].seconds_factor
    seconds["solve"] = sum(info.seconds_solve for info in infos)
    iterations = sum(info.iterations for info in infos)
    return constraints.followers.follow(free), Counts(
        newton=1,
        linear=iterations,
        modified=int(opening.definite),
        factorisations=1,
        residual=infos[0].residual,
        seconds=seconds,
    )
