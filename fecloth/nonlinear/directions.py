"""Newton's directions: J s = −R for the matrix of a remedy, and what the solves cost."""

import time
from dataclasses import dataclass, field

import numpy as np

from fecloth.errors import SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import solve_updated
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.equation import Equation
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.remedies import Remedy

# Relative residual of solves whose matrix is not the exact one, with contact, and of refined
# directions. The error of such a matrix is larger, so that a sharper solve gains nothing.
ROUGH_RESIDUAL = 0.1
MOST_REFINEMENTS = 30  # iterations of conjugate gradients; each costs a solve with the factor


@dataclass
class Costs:
    """What the solves cost so far; `Counts` explains the figures.

    Attributes
    ----------
    linear
        Iterations of the linear solver.
    modified
        Matrices with clamped tangents or with mass added.
    factorisations
        Matrices that were assembled.
    reused_solves
        Solves with the factor of an earlier matrix.
    seconds
        Of assembly, factorisation and solution [s].
    """

    linear: int = 0
    modified: int = 0
    factorisations: int = 0
    reused_solves: int = 0
    seconds: dict[str, float] = field(
        default_factory=lambda: {"assemble": 0.0, "factor": 0.0, "solve": 0.0}
    )


class Directions:
    """The directions of one iteration: its matrix, its linear solver, and what they cost.

    `goal` is the relative residual at which the iteration ends. The `exact` remedy is the first
    one, the exact matrix if the equation allows it.
    """

    def __init__(self, equation: Equation, context: SolverContext, goal: float):
        self.equation = equation
        self.system = equation.system
        self.options = context.options
        self.factor_reuse = context.factor_reuse
        self.linear_solver, self.matrix = context.matrix_solver()
        self.goal = goal
        self.exact = equation.remedies.order[0]
        self.costs = Costs()
        # where and with which remedy the matrix was filled
        self._filled: tuple[Point | None, Remedy] = (None, self.exact)

    def find(self, point: Point, remedy: Remedy) -> np.ndarray:
        """The direction s = −J⁻¹ R (n, 3) at a point, from a new matrix with a remedy.

        Raise `SolveFailed` where the matrix has no factor or the solver does not converge. The
        factor, if there is one, is recorded for reuse.
        """
        begin = time.perf_counter()
        self.factor_reuse.key = None  # the old factor is lost, also if this fails
        self._fill_matrix(point, remedy)
        self.costs.modified += remedy.definite or remedy.shift > 0
        self.costs.factorisations += 1
        self.costs.seconds["assemble"] += time.perf_counter() - begin
        self.linear_solver.prepare(self.equation.couple(point.y, remedy, self.matrix))
        # With contact, a matrix with a remedy is not exact: a sharper solve gains nothing.
        is_rough = self.equation.takes_short_solves and remedy != self.exact
        least_rtol = ROUGH_RESIDUAL if is_rough else 0.0
        step = self._solve(point, least_rtol, is_new_factor=True)
        self.factor_reuse.record_factor(self.equation.key(remedy), self.linear_solver)
        return step

    def _fill_matrix(self, point: Point, remedy: Remedy) -> None:
        """Fill the matrix of a point with a remedy.

        Where it holds the same tangents with less mass, only the mass that is missing is added.
        """
        filled_at, filled_with = self._filled
        self._filled = point, remedy
        has_tangents = filled_at is point and filled_with.definite == remedy.definite
        may_add = self.system.mass_kind == "lumped" and self.system.is_whole
        if not (has_tangents and may_add):
            self.equation.assemble(point.y, remedy, self.matrix)
            return
        mass_weight = self.equation.mass_weight
        self.system.add_mass(self.matrix, mass_weight(remedy) - mass_weight(filled_with))

    def find_with_old_factor(self, point: Point, remedy: Remedy) -> np.ndarray | None:
        """The direction −J⁻¹ R (n, 3) with the factor of an earlier J.

        None if reuse is not allowed now, if no factor of this remedy is held, or if the factor
        is too poor. Such a factor is forgotten.
        """
        key = self.equation.key(remedy)
        may_reuse = self.options.reuse and point.norm > 0
        if not (may_reuse and self.factor_reuse.is_usable(key, self.linear_solver)):
            return None
        try:
            step = self._solve(point)
        except SolveFailed:  # a factor too poor for refinement
            self.factor_reuse.drop()
            return None
        self.costs.reused_solves += 1
        return step

    def refine(self, point: Point, step: np.ndarray) -> np.ndarray:
        """The direction of the exact matrix, where `step` is the one of a definite matrix.

        With the definite matrix alone wrinkled sheets converge slowly. So K s = −R is solved
        with the exact matrix K by conjugate gradients, preconditioned by the factor that made
        `step`. A direction p without positive curvature, p·K p ≤ 0, ends them and is the result
        (Nocedal and Wright 2006, algorithm 7.1).
        """
        K = BlockMatrix.zeros(self.matrix.pattern, self.system.team)
        self.equation.assemble(point.y, self.exact, K)
        K = self.equation.couple(point.y, self.exact, K)
        updates = self.equation.updates(point.y)
        dot = self.system.sums.dot
        project = self.system.constraints.project
        step = project(step)
        s = np.zeros_like(step)  # the solution so far
        r = -point.R  # its residual
        z = step  # the residual, preconditioned
        p = step  # the direction of the search
        rz = dot(r, z)
        for _ in range(MOST_REFINEMENTS):
            q = project(K @ p + sum(c * dot(u, p) * u for c, u in updates))
            curvature = dot(p, q)
            if curvature <= 0:
                return self.system.constraints.followers.follow(p)
            s = s + rz / curvature * p
            r = r - rz / curvature * q
            if self.system.sums.norm(r) <= ROUGH_RESIDUAL * point.norm:
                break
            solved, _ = solve_updated(self.linear_solver, updates, r, ROUGH_RESIDUAL)
            z = project(solved)
            rz_before = rz
            rz = dot(r, z)
            p = z + rz / rz_before * p
        return self.system.constraints.followers.follow(s)

    def _solve(
        self, point: Point, least_rtol: float = 0.0, is_new_factor: bool = False
    ) -> np.ndarray:
        """−J⁻¹ R (n, 3) for the prepared J, in the free directions; add up what it costs.

        The relative residual of the solve is the largest of the option `forcing`, of
        `least_rtol`, and of half of what the goal of the iteration needs; but at most a half.
        """
        rtol_of_goal = 0.5 * (self.goal * point.scale) / point.norm
        rtol = min(0.5, max(self.options.forcing, rtol_of_goal, least_rtol))
        updates = self.equation.updates(point.y)
        step, infos = solve_updated(self.linear_solver, updates, -point.R, rtol)
        self.costs.linear += sum(info.iterations for info in infos)
        if is_new_factor:  # a factor that is used again has been counted
            self.costs.seconds["factor"] += infos[0].seconds_factor
        self.costs.seconds["solve"] += sum(info.seconds_solve for info in infos)
        return self.system.constraints.expand(step)
