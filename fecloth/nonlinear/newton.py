"""Newton's iteration for the stage equation M a(q) = f(x(q), v(q), t)."""

from __future__ import annotations

import time

import numpy as np

from fecloth.errors import FeclothError, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import solve_updated
from fecloth.nonlinear import line_search
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.nonlinear.stage import Stage
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import System

# Remedies (shift, definite): J contains (1 + shift) wa M, and clamped tangents if definite.
SHIFTS = (0.0, *(4.0**n for n in range(-1, 8)))
REMEDIES = {
    "none": [(0.0, False)],
    "clamp": [(0.0, True)],
    "on_failure": [(shift, definite) for definite in (False, True) for shift in SHIFTS],
}


class NewtonFailed(FeclothError):
    """The stage equation was not solved; `residual` is what was reached."""

    def __init__(self, reason: str, residual: float, remedy: str):
        self.reason, self.residual, self.remedy = reason, residual, remedy
        super().__init__(reason, residual, remedy)

    def __str__(self) -> str:
        return f"{self.reason} (relative residual {self.residual:.2e}). {self.remedy}"


def solve(system: System, stage: Stage, solver: SolverContext, guess: np.ndarray | None = None):
    """Return the unknown q (n, 3) of a stage, and the `Counts`.

    Newton's direction s = −J⁻¹ R with backtracking: the longest of s, s/2, s/4, … is taken that
    reduces the residual, or the incremental potential Φ(q) = ½ wa q·M q + q·M ã + U(x(q))/wx
    sufficiently (Nocedal and Wright 2006, Numerical Optimization, eq. 3.6a), or, where a term has
    no potential, at whose end the residual does not push back hard: R·s ≤ 0.8 |R₀·s| (after
    Matthies and Strang 1979, who ask for half). The norm of the residual alone would not do: a
    cloth that turns stretches in proportion to the angle squared, and as it is so much stiffer in
    its plane than across, good steps increase the residual.

    If the solver holds a factor for the same weights, its direction is tried first. The full step
    is taken if the residual falls; otherwise a new factor is computed.

    Raises
    ------
    NewtonFailed
        If the tolerance is not met.
    """
    work = _Work(system, stage, solver)
    solver.begin(stage.wx, stage.wa)
    try:
        return _iterate(work, guess)
    except FeclothError:
        solver.factor_reuse.drop()
        raise


def _iterate(work: _Work, guess: np.ndarray | None):
    """Iterate until the tolerance is met; see `solve`."""
    system, stage, options = work.system, work.stage, work.options
    q = np.zeros_like(stage.x) if guess is None else system.constraints.project(guess.copy())
    R = work.first_residual(q)
    norm, goal, remedy = system.sums.norm(R), options.tolerance * work.scale, 0
    for iteration in range(1, options.max_iterations + 1):
        q, R, remedy = work.iterate(q, R, goal, remedy)
        x, inertia = stage.at(q)[0], (1 + work.remedies[remedy][0]) * stage.wa
        floor = round_off(system, work.J, x, inertia) / stage.wx
        norm, goal = system.sums.norm(R), max(options.tolerance * work.scale, floor)
        if norm <= goal:
            work.factor_reuse.end_step(work.reused_solves, work.linear_solver)
            return q, work.counts(iteration, norm)
    reason = f"Newton did not converge in {options.max_iterations} iterations"
    raise NewtonFailed(reason, work.relative(norm), "Take a smaller dt.")


def round_off(system: System, J: BlockMatrix, x: np.ndarray, wa: float) -> float:
    """8 ε ‖J_ii x_i‖ without J's wa M: the error in wx times forces from rounded positions."""
    diagonal = np.einsum("sii->s", J.values[J.pattern.diagonal]) / 3
    stiffness = np.abs(diagonal - wa * system.scalar_mass.diagonal())
    return 8 * float(np.finfo(float).eps) * system.sums.norm(stiffness[:, None] * x)


class _Work:
    """The arrays and counters of one solve."""

    def __init__(self, system: System, stage: Stage, solver: SolverContext):
        self.system, self.stage, self.factor_reuse = system, stage, solver.factor_reuse
        self.linear_solver, self.J = solver.matrix_solver()
        self.options: Newton = solver.options
        self.scale = 0.0
        self.remedies = REMEDIES[solver.options.definiteness]
        self.linear = self.modified = self.factorisations = self.reused_solves = 0
        self.seconds = {"assemble": 0.0, "factor": 0.0, "solve": 0.0}
        self.has_potential = all(term.has_energy and not term.dissipative for term in system.bound)

    def counts(self, iterations, norm):
        counted = self.linear, self.modified, self.relative(norm), self.seconds
        return Counts(iterations, *counted, self.factorisations)

    def relative(self, norm):
        return float(norm / self.scale) if self.scale else 0.0

    def first_residual(self, q):
        """Return R at the first iterate; set `scale` to the sum of the forces there."""
        x, v, a = self.stage.at(q)
        inertia = self.system.scalar_mass @ a
        R, self.scale = inertia.copy(), self.system.sums.norm(inertia)
        for term in self.system.bound:
            f = np.zeros_like(x)
            term.add_force(x, v, self.stage.t, f)
            R -= f
            self.scale += self.system.sums.norm(f)
        return self.system.constraints.project(R)

    def residual(self, q):
        x, v, a = self.stage.at(q)
        f = self.system.force(State(self.stage.t, x, v))
        return self.system.constraints.project(self.system.scalar_mass @ a - f)

    def iterate(self, q, R, goal, last):
        """Return q, R and the remedy's index after an iteration; `last` is the index before."""
        result = self.iterate_with_old_factor(q, R, goal, self.remedies[max(last - 1, 0)])
        if result:
            return *result, max(last - 1, 0)
        for number in self.remedies_to_try(last):
            result, reason = self.attempt(q, R, goal, self.remedies[number])
            if result:
                return *result, number
        remedy = "Take a smaller dt."
        if self.options.definiteness == "none":
            remedy = 'Use definiteness = "on_failure", or a smaller dt.'
        raise NewtonFailed(reason, self.relative(self.system.sums.norm(R)), remedy)

    def remedies_to_try(self, last):
        """Return the indices of the remedies to try, starting one below the last successful one.

        After a clamped tangent, try the exact one and then the clamped ones.
        """
        clamped = [n for n, (_, definite) in enumerate(self.remedies) if definite]
        if last and last in clamped:
            return [0, *clamped]
        return range(max(last - 1, 0), len(self.remedies))

    def iterate_with_old_factor(self, q, R, goal, remedy):
        """Return q and R after an iteration with an earlier factor; None without one or success."""
        key, norm = self.key(*remedy), self.system.sums.norm(R)
        is_usable = self.options.reuse and norm > 0
        if not (is_usable and self.factor_reuse.is_usable(key, self.linear_solver)):
            return None
        try:
            trial = q + self.solve_linear(self.state(q), R, goal)
        except SolveFailed:  # a factor too poor for refinement
            self.factor_reuse.drop()
            return None
        self.reused_solves += 1
        R_trial = self.residual(trial)
        norm_trial = self.system.sums.norm(R_trial)
        to_go = goal / norm_trial if norm_trial else 1.0
        self.factor_reuse.record_iteration(norm_trial / norm, to_go, self.linear_solver)
        return (trial, R_trial) if norm_trial < norm else None

    def key(self, shift, definite=False):
        """Return the quantities that identify the matrix of a factor."""
        stage = self.stage
        system = self.system.constraints  # which the system over a step shares
        return system, stage.wx, stage.wv, (1 + shift) * stage.wa, definite

    def state(self, q):
        x, v, _ = self.stage.at(q)
        return State(self.stage.t, x, v)

    def attempt(self, q, R, goal, remedy):
        """Return ((q, R), reason) for one iteration with a remedy; None for (q, R) if it fails."""
        try:
            step = self.direction(q, R, goal, *remedy)
        except SolveFailed as failure:  # IndefiniteMatrix, or singular within round-off
            return None, str(failure)
        return self.search(q, R, step, goal), "no step along Newton's direction is an improvement"

    def direction(self, q, R, goal, shift, definite=False):
        """s = −J⁻¹ R with J = (1 + shift) wa M + wv D + wx K; K and D as they are, or definite."""
        begin = time.perf_counter()
        if not R.any():
            return np.zeros_like(R)
        key = self.key(shift, definite)
        at, (_, *weights, _) = self.state(q), key
        self.factor_reuse.key = None  # from here on the matrix is another one, also if this fails
        self.system.assemble(self.J, at, *weights, definite)
        self.system.project(self.J)
        self.modified += definite or shift > 0
        self.seconds["assemble"] += time.perf_counter() - begin
        norm = self.system.sums.norm(R)
        if not np.isfinite(norm):
            raise NewtonFailed("the forces are not finite", float(norm), "Take a smaller dt.")
        self.factorisations += 1
        self.linear_solver.prepare(self.J)
        step = self.solve_linear(at, R, goal, new=True)
        self.factor_reuse.record_factor(key, self.linear_solver)
        return step

    def solve_linear(self, at, R, goal, new=False):
        """Return −J⁻¹ R for the prepared J."""
        forcing = min(0.5, max(self.options.forcing, 0.5 * goal / self.system.sums.norm(R)))
        project = self.system.constraints.project
        dense = [(self.stage.wx * c, project(u)) for c, u in self.system.dense(at)]
        step, infos = solve_updated(self.linear_solver, dense, -R, forcing)
        self.linear += sum(info.iterations for info in infos)
        self.seconds["factor"] += infos[0].seconds_factor if new else 0.0
        self.seconds["solve"] += sum(info.seconds_solve for info in infos)
        return step

    def search(self, q, R, step, goal):
        """Return the new q and its residual; None without improvement along the direction."""
        potential = self.potential if self.has_potential else None
        result = line_search.find_step(
            self.system.sums, lambda q: (self.residual(q),), q, R, step, goal, potential
        )
        return result and (result[1], *result[2])

    def potential(self, q):
        """Φ(q) = ½ wa q·M q + q·M ã + U(x(q)) / wx."""
        stage = self.stage
        x, _, _ = stage.at(q)
        inertia = self.system.scalar_mass @ (0.5 * stage.wa * q + stage.a)
        energy = sum(term.energy(x, stage.t) for term in self.system.bound)
        return self.system.sums.dot(q, inertia) + energy / stage.wx
