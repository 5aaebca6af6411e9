"""Static equilibrium: positions at which the forces of all terms balance, f(x, v = 0, t) = 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import linear
from .blocks import BlockMatrix
from .errors import FeclothError, InputError, SolveFailed
from .newton import round_off
from .system import State, System
from .terms.membrane import principal_stretches

GROWTH = 4.0  # of the shift, from one attempt to the next
ATTEMPTS, HALVINGS = 30, 12
FAR = 10.0  # extents of the cloth: whoever moves farther is held by nothing


@dataclass(frozen=True)
class Iteration:
    """What one Newton iteration did.

    Attributes
    ----------
    number
        From 1.
    residual
        ‖f‖ of the free directions after it, relative to Σ ‖f_term‖.
    shift
        σ of the tangent K + σ M it took [1/s²]; 0 is the exact tangent.
    length
        Part of Newton's step that was taken, at most 1.
    """

    number: int
    residual: float
    shift: float
    length: float


class EquilibriumFailed(FeclothError):
    """No equilibrium was found; `state` is the best that was reached, `residual` its own."""

    def __init__(self, reason: str, residual: float, state: State, remedy: str):
        self.reason, self.residual, self.state, self.remedy = reason, residual, state, remedy
        super().__init__(reason, residual, remedy)

    def __str__(self) -> str:
        return f"equilibrium: {self.reason} (relative residual {self.residual:.2e}). {self.remedy}"


def equilibrium(
    system: System,
    state: State,
    *,
    tolerance: float = 1e-9,
    max_iterations: int = 200,
    solver: str = "direct",
    report: Callable[[Iteration], None] = lambda iteration: None,
) -> State:
    """The equilibrium that Newton's iteration reaches from `state`, at the loads of its time.

    Each iteration solves (K + σ M) s = f with the tangent K = −∂f/∂x of all terms. σ is zero where
    K is positive definite and its step leads somewhere: near the solution the convergence is
    quadratic. Elsewhere each term's tangent is made positive semi-definite, and σ grows until the
    step is an improvement (after Nocedal and Wright 2006, Numerical Optimization, algorithm 3.3,
    who add σ alone): a flat cloth without stress has no stiffness across, and σ M stands in for
    it. With the exact K + σ M a sheet squeezed by a fifth took twice the iterations. The first σ
    moves the cloth by about a tenth of its extent under its load. Of s, s/2, s/4, … the longest is
    taken that reduces the residual, or the potential sufficiently (their eq. 3.6a), or, where a
    force has no potential, at whose end the residual does not push back hard (after Matthies and
    Strang 1979). No node moves by more than the extent of the cloth in one iteration.

    A compressed cloth has many equilibria, and which one is found depends on the start; a flat
    start without any load across stays flat. If the last `Iteration` had a shift, the tangent is
    not positive definite near the solution: it may be unstable, or not the only one around.

    Parameters
    ----------
    system, state
        What is to be balanced and where to start; pins hold their nodes where `state` has them,
        slides their held directions, and its velocity is not used.
    tolerance
        On ‖f‖ of the free directions over Σ ‖f_term‖ at the same positions. No less is asked for
        than the round-off of the forces themselves, 8 ε ‖K_ii x_i‖.
    max_iterations
        Beyond it `EquilibriumFailed` is raised.
    solver
        "direct", "pardiso" or "superlu".
    report
        Called with each `Iteration`.

    Returns
    -------
    State
        At the same time, with v = 0.

    Raises
    ------
    EquilibriumFailed
        If the cloth moves away as nothing holds it, or the iteration ends before the tolerance;
        the message says how many triangles are slack, which is the usual cause.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    >>> sag = -fc.equilibrium(system, system.rest()).x[:, 2].min()
    >>> print(f"{1000 * sag:.0f} mm")
    38 mm
    """
    if not 0 < tolerance < 1:
        raise InputError(f"tolerance = {tolerance!r}", "must lie in (0, 1)", "equilibrium")
    if max_iterations < 1:
        raise InputError(f"max_iterations = {max_iterations!r}", "must be >= 1", "equilibrium")
    if solver not in ("direct", "pardiso", "superlu"):
        allowed = "must be direct, pardiso or superlu"
        raise InputError(f"solver = {solver!r}", allowed, "equilibrium")
    start = State(state.t, state.x.copy(), np.zeros_like(state.x))
    work = _Work(system, start, linear.named(solver, system.symmetric))
    x = start.x
    f, scale = work.forces(x)
    work.choose_first_shift(f)
    goal = max(tolerance * scale, round_off(system, work.J, x, 0.0))
    for number in range(1, max_iterations + 1):
        if np.linalg.norm(f) <= goal:
            return work.state(x)
        x, f, scale, shift, length = work.iterate(x, f, goal)
        goal = max(tolerance * scale, round_off(system, work.J, x, shift))
        relative = float(np.linalg.norm(f) / scale) if scale else 0.0
        report(Iteration(number, relative, shift, length))
        work.refuse_to_travel(x, f)
    if np.linalg.norm(f) <= goal:
        return work.state(x)
    raise work.failed(f"no convergence in {max_iterations} iterations", x, f)


class _Work:
    """The matrix, the solver and the scales of one search."""

    def __init__(self, system: System, start: State, solver):
        self.system, self.start, self.solver = system, start, solver
        self.J = system.assemble(BlockMatrix.zeros(system.pattern), start, wx=1.0)
        self.extent = float(np.ptp(system.cloth.X, axis=0).max())
        self.resume = 0.0  # the first shift to try where the exact tangent will not do
        self.has_potential = all(
            term.has_energy or (term.dissipative and not hasattr(term, "supply"))
            for term in system.bound
        )  # at v = 0 what only dissipates has no force, and so needs no potential

    def choose_first_shift(self, f):
        """σ at which the mean acceleration moves the cloth by a tenth of its extent."""
        mass = self.system.nodal_mass.sum()
        mean = np.linalg.norm(f, axis=1).sum() / mass
        self.resume = 10 * mean / self.extent

    def state(self, x) -> State:
        return State(self.start.t, x, np.zeros_like(x))

    def forces(self, x):
        """f of the free directions (n, 3), and Σ ‖f_term‖ of them."""
        project, total, scale = self.system.constraints.project, np.zeros_like(x), 0.0
        still = np.zeros_like(x)
        for term in self.system.bound:
            f = np.zeros_like(x)
            term.add_force(x, still, self.start.t, f)
            total += project(f)
            scale += np.linalg.norm(f)
        return total, float(scale)

    def relative(self, x, f) -> float:
        _, scale = self.forces(x)
        return float(np.linalg.norm(f) / scale) if scale else 0.0

    def potential(self, x) -> float:
        bound = self.system.bound
        return sum(term.energy(x, self.start.t) for term in bound if term.has_energy)

    def iterate(self, x, f, goal):
        """The next x, f and Σ ‖f_term‖, the shift and the part of the step that were taken."""
        shift = 0.0
        for _ in range(ATTEMPTS):
            try:
                found = self.search(x, f, self.direction(x, f, shift), goal)
            except SolveFailed as failure:  # IndefiniteMatrix, or singular within round-off
                found, reason = None, str(failure)
            else:
                reason = "no step along Newton's direction is an improvement"
            if found:
                self.resume = shift / GROWTH or self.resume
                return *found[:3], shift, found[3]
            shift = GROWTH * shift or self.resume
        raise self.failed(reason, x, f)

    def direction(self, x, f, shift):
        """s = (K + σ M)⁻¹ f, with the definite K where σ > 0."""
        system, at = self.system, self.state(x)
        system.project(system.assemble(self.J, at, 1.0, 0.0, shift, shift > 0))
        self.solver.prepare(self.J)
        project = system.constraints.project
        dense = [(c, project(u)) for c, u in system.dense(at)]
        step, _ = linear.updated(self.solver, dense, f, 1e-8)
        return project(step)

    def search(self, x, f, step, goal):
        """The new x, its f and Σ ‖f_term‖, the part of the step; None if none is better."""
        slope = float(np.vdot(f, step))  # work of the forces along the step
        if not slope > 0:
            return None
        longest = np.linalg.norm(step, axis=1).max()
        first = min(1.0, self.extent / longest)
        norm, potential = np.linalg.norm(f), None
        for length in first * 0.5 ** np.arange(HALVINGS):
            trial = x + length * step
            f_trial, scale = self.forces(trial)
            norm_trial = np.linalg.norm(f_trial)
            if not np.isfinite(norm_trial):
                continue
            if norm_trial <= max(goal, (1 - 1e-4 * length) * norm):
                return trial, f_trial, scale, float(length)
            if self.has_potential:
                potential = self.potential(x) if potential is None else potential
                if self.potential(trial) <= potential - 1e-4 * length * slope:
                    return trial, f_trial, scale, float(length)
            elif np.vdot(f_trial, step) >= -0.8 * slope:
                return trial, f_trial, scale, float(length)
        return None

    def refuse_to_travel(self, x, f):
        way = (x - self.start.x).mean(axis=0)
        distance = float(np.linalg.norm(way))
        if distance > FAR * self.extent:
            towards = ", ".join(f"{c:.2g}" for c in way / distance)
            reason = f"nothing holds the cloth: it went {distance:.3g} m along ({towards})"
            raise self.failed(reason, x, f, "Pin it, or take the load away.")

    def failed(self, reason, x, f, remedy=""):
        stretches = principal_stretches(self.system.cloth, x)
        slack = int((stretches.max(axis=1) < 1 - 1e-9).sum())
        if slack:
            reason += f"; {slack} of {len(stretches)} triangles are slack in every direction"
        if not remedy:
            remedy = (
                "Give the cloth bending stiffness, start from a state nearer to the equilibrium, "
                "or find one by marching with damping."
            )
        return EquilibriumFailed(reason, self.relative(x, f), self.state(x), remedy)
