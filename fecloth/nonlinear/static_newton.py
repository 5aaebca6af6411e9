"""Newton's iteration for a static equilibrium, and its failures."""

from __future__ import annotations

import numpy as np

from fecloth.errors import FeclothError, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import solve_updated
from fecloth.nonlinear import line_search
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import principal_stretches

GROWTH = 4.0  # of the shift, from one attempt to the next
ATTEMPTS = 30
FAR = 10.0  # extents of the cloth: a mean displacement beyond this means that no pin holds it


class EquilibriumFailed(FeclothError):
    """No equilibrium was found; `state` is the best one reached, with its `residual`.

    With load steps, `state` balances the loads times `load`, the largest factor solved, and
    `residual` is that of the last attempt at a larger one.
    """

    def __init__(self, reason: str, residual: float, state: State, remedy: str, load=1.0):
        self.reason, self.residual, self.state, self.remedy = reason, residual, state, remedy
        self.load = load
        super().__init__(reason, residual, remedy)

    def __str__(self) -> str:
        return f"equilibrium: {self.reason} (relative residual {self.residual:.2e}). {self.remedy}"


class Search:
    """The matrix, the solver and the scales of one Newton iteration for equilibrium."""

    def __init__(self, system: System, start: State, solver):
        self.system, self.start, self.solver = system, start, solver
        self.J = system.assemble(BlockMatrix.zeros(system.pattern), start, wx=1.0)
        self.extent = float(np.ptp(system.cloth.X, axis=0).max())
        self.load = 1.0  # factor on the terms that are loads
        self.resume = 0.0  # the first shift to try if the exact tangent fails
        self.has_potential = all(
            term.has_energy or (term.dissipative and not hasattr(term, "supply"))
            for term in system.bound
        )  # at v = 0 a purely dissipative term has no force and needs no potential

    def choose_first_shift(self, f):
        """σ at which the mean acceleration moves the cloth by a tenth of its extent."""
        mass = self.system.nodal_mass.sum()
        mean = np.linalg.norm(f, axis=1).sum() / mass
        self.resume = 10 * mean / self.extent

    def state(self, x) -> State:
        return State(self.start.t, x, np.zeros_like(x))

    def terms(self):
        """Yield each term and its load factor."""
        for term in self.system.bound:
            yield term, self.load if getattr(term, "load", False) else 1.0

    def forces(self, x):
        """f of the free directions (n, 3), and Σ ‖f_term‖ of them."""
        project, total, scale = self.system.constraints.project, np.zeros_like(x), 0.0
        still = np.zeros_like(x)
        for term, factor in self.terms():
            f = np.zeros_like(x)
            term.add_force(x, still, self.start.t, f)
            f *= factor
            total += project(f)
            scale += self.system.sums.norm(f)
        return total, float(scale)

    def relative(self, x, f) -> float:
        _, scale = self.forces(x)
        return float(self.system.sums.norm(f) / scale) if scale else 0.0

    def potential(self, x) -> float:
        t = self.start.t
        return sum(k * term.energy(x, t) for term, k in self.terms() if term.has_energy)

    def iterate(self, x, f, goal):
        """Return the next x, f and Σ ‖f_term‖, the shift, and the fraction of Newton's step."""
        shift = 0.0
        for _ in range(ATTEMPTS):
            try:
                result = self.search(x, f, self.direction(x, f, shift), goal)
            except SolveFailed as failure:  # IndefiniteMatrix, or singular within round-off
                result, reason = None, str(failure)
            else:
                reason = "no step along Newton's direction is an improvement"
            if result:
                self.resume = shift / GROWTH or self.resume
                return *result[:3], shift, result[3]
            shift = GROWTH * shift or self.resume
        raise self.failure(reason, x, f)

    def direction(self, x, f, shift):
        """s = (K + σ M)⁻¹ f, with the definite K where σ > 0."""
        system, t, still = self.system, self.start.t, np.zeros_like(x)
        system.assemble(self.J, self.state(x), wa=shift)
        dense, project = [], system.constraints.project
        for term, factor in self.terms():
            term.add_tangent(x, still, t, factor, 0.0, self.J, shift > 0)
            if hasattr(term, "dense"):
                c, u = term.dense(x, t)
                dense.append((factor * c, project(u)))
        self.solver.prepare(system.project(self.J))
        step, _ = solve_updated(self.solver, dense, f, 1e-8)
        return project(step)

    def search(self, x, f, step, goal):
        """Return the new x, f, Σ ‖f_term‖ and step fraction; None without improvement."""

        def at(x):
            f, scale = self.forces(x)
            return -f, f, scale

        first = min(1.0, self.extent / np.linalg.norm(step, axis=1).max())
        potential = self.potential if self.has_potential else None
        result = line_search.find_step(self.system.sums, at, x, -f, step, goal, potential, first)
        return result and (result[1], *result[2][1:], result[0])

    def check_travel(self, x, f):
        way = (x - self.start.x).mean(axis=0)
        distance = float(np.linalg.norm(way))
        if distance > FAR * self.extent:
            towards = ", ".join(f"{c:.2g}" for c in way / distance)
            reason = f"nothing holds the cloth: it went {distance:.3g} m along ({towards})"
            raise self.failure(reason, x, f, "Pin it, or take the load away.")

    def load_step_failure(self, failure, x, reached):
        """Return the error for loads that cannot be increased further."""
        reason = f"load stepping ended at {reached:.4g} of the loads: {failure.reason}"
        state = self.state(x)
        return EquilibriumFailed(reason, failure.residual, state, failure.remedy, reached)

    def failure(self, reason, x, f, remedy=""):
        stretches = principal_stretches(self.system.cloth, x)
        slack = int((stretches.max(axis=1) < 1 - 1e-9).sum())
        if slack:
            reason += f"; {slack} of {len(stretches)} triangles are slack in every direction"
        if not remedy:
            remedy = (
                "Give the cloth bending stiffness, let the loads grow in more load_steps, start "
                "from a state nearer to the equilibrium, or find one by marching with damping."
            )
        return EquilibriumFailed(reason, self.relative(x, f), self.state(x), remedy)
