"""Newton's iteration for the stage equation M a(q) = f(x(q), v(q), t); it knows no method."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from .blocks import BlockMatrix
from .errors import FeclothError, IndefiniteMatrix, InputError
from .stage import Stage
from .system import State, System

DEFINITENESS = ("none", "clamp", "on_failure")


@dataclass(frozen=True)
class Newton:
    """How the stage equation is solved.

    Parameters
    ----------
    tolerance
        On the residual ‖M a − f‖ of the free directions, relative to the forces of the step:
        ‖M a‖ plus the sum over the terms of ‖f_term‖ at the first iterate. No less is asked for
        than the round-off of the forces themselves, 8 ε ‖K_ii x_i‖: a cloth at rest without any
        load has no other force.
    max_iterations
        Beyond it the step has failed.
    forcing
        Relative residual that an iterative linear solver is asked for in each iteration.
    definiteness
        "none": the exact tangent; "clamp": every term's tangent made positive semi-definite;
        "on_failure": exact, and clamped from the iteration on in which the exact one was not
        positive definite or its direction did not reduce the residual.
    """

    tolerance: float = 1e-6
    max_iterations: int = 40
    forcing: float = 1e-2
    definiteness: str = "on_failure"

    def __post_init__(self):
        if not 1e-13 <= self.tolerance < 1:
            raise InputError(f"tolerance = {self.tolerance!r}", "must lie in [1e-13, 1)", "Newton")
        if not 0 < self.forcing < 1:
            raise InputError(f"forcing = {self.forcing!r}", "must lie in (0, 1)", "Newton")
        if self.max_iterations < 1:
            raise InputError(f"max_iterations = {self.max_iterations!r}", "must be >= 1", "Newton")
        if self.definiteness not in DEFINITENESS:
            allowed = f"must be one of {', '.join(DEFINITENESS)}"
            raise InputError(f"definiteness = {self.definiteness!r}", allowed, "Newton")


class NewtonFailed(FeclothError):
    """The stage equation was not solved; `residual` is what was reached."""

    def __init__(self, reason: str, residual: float, remedy: str):
        self.reason, self.residual, self.remedy = reason, residual, remedy
        super().__init__(f"{reason} (relative residual {residual:.2e}). {remedy}")


@dataclass(frozen=True)
class Counts:
    """What one solve took; `residual` is relative to the forces of the step."""

    newton: int = 0
    linear: int = 0
    clamped: int = 0
    residual: float = 0.0
    seconds: dict = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Solver:
    """What a step needs to solve its equations: a linear solver, a matrix to fill, the options."""

    linear: object
    matrix: BlockMatrix
    options: Newton


def solve(system: System, stage: Stage, solver: Solver, guess: np.ndarray | None = None):
    """The unknown q (n, 3) of a stage, and the `Counts`.

    Newton with backtracking. The full step is taken where it reduces the residual; else the step
    is halved until the incremental potential Φ(q) = ½ wa q·M q + q·M ã + U(x(q))/wx decreases
    (Nocedal and Wright 2006, Numerical Optimization, eq. 3.4), or, where a term has no
    potential, until the residual does.

    Raises
    ------
    NewtonFailed
        If the tolerance is not met.
    """
    options, work = solver.options, _Work(system, stage, solver)
    q = np.zeros_like(stage.x) if guess is None else system.constraints.project(guess.copy())
    R, scale = work.first_residual(q)
    norm, goal = np.linalg.norm(R), options.tolerance * scale
    definite = options.definiteness == "clamp"
    for iteration in range(1, options.max_iterations + 1):
        try:
            forcing = min(0.5, max(options.forcing, 0.5 * goal / max(norm, 1e-300)))
            step = work.direction(q, R, forcing, definite)
            goal = max(options.tolerance * scale, work.round_off(q))
            found = work.search(q, R, norm, step, goal)
        except IndefiniteMatrix as failure:
            found, reason = None, str(failure)
        else:
            reason = "no step along Newton's direction reduces the residual"
        if found is None:
            if definite or options.definiteness == "none":
                raise NewtonFailed(reason, norm / max(scale, 1e-300), _remedy(options.definiteness))
            definite = True
            continue
        q, R, norm = found
        if norm <= goal:
            return q, work.counts(iteration, norm / scale if scale else 0.0)
    raise NewtonFailed(
        f"Newton did not converge in {options.max_iterations} iterations",
        norm / scale,
        "Take a smaller dt.",
    )


def _remedy(definiteness):
    if definiteness == "none":
        return 'Use definiteness = "on_failure", or a smaller dt.'
    return "Take a smaller dt."


class _Work:
    """The arrays and counters of one solve."""

    def __init__(self, system, stage, solver):
        self.system, self.stage, self.linear_solver = system, stage, solver.linear
        self.J = solver.matrix
        self.linear = self.clamped = 0
        self.seconds = {"assemble": 0.0, "factor": 0.0, "solve": 0.0}
        self.has_potential = all(term.has_energy for term in system.bound)

    def counts(self, iterations, residual):
        return Counts(iterations, self.linear, self.clamped, residual, self.seconds)

    def first_residual(self, q):
        """R at the first iterate, and the scale of the forces of the step."""
        x, v, a = self.stage.at(q)
        inertia = self.system.scalar_mass @ a
        R, scale = inertia.copy(), np.linalg.norm(inertia)
        for term in self.system.bound:
            f = np.zeros_like(x)
            term.add_force(x, v, self.stage.t, f)
            R -= f
            scale += np.linalg.norm(f)
        return self.system.constraints.project(R), scale

    def residual(self, q):
        x, v, a = self.stage.at(q)
        f = self.system.force(State(self.stage.t, x, v))
        return self.system.constraints.project(self.system.scalar_mass @ a - f)

    def direction(self, q, R, forcing, definite):
        """−J⁻¹ R."""
        stage, begin = self.stage, time.perf_counter()
        if not R.any():
            return np.zeros_like(R)
        x, v, _ = stage.at(q)
        at = State(stage.t, x, v)
        self.system.assemble(self.J, at, stage.wx, stage.wv, stage.wa, definite)
        self.system.project(self.J)
        self.clamped += definite
        self.seconds["assemble"] += time.perf_counter() - begin
        return self._solved(-R, forcing)

    def round_off(self, q):
        """8 ε ‖K_ii x_i‖: what the rounding of positions alone does to the forces."""
        stage, J = self.stage, self.J
        diagonal = np.einsum("sii->s", J.values[J.pattern.diagonal]) / 3
        stiffness = np.abs(diagonal - stage.wa * self.system.nodal_mass) / stage.wx
        x, _, _ = stage.at(q)
        return 8 * np.finfo(float).eps * np.linalg.norm(stiffness[:, None] * x)

    def _solved(self, b, forcing):
        self.linear_solver.prepare(self.J)
        step, info = self.linear_solver.solve(b, rtol=forcing)
        self.linear += info.iterations
        self.seconds["factor"] += info.seconds_factor
        self.seconds["solve"] += info.seconds_solve
        return step

    def search(self, q, R, norm, step, goal, shrink=0.5, halvings=12):
        """The new q, its residual and norm; None if no step along the direction is good."""
        slope = float(np.vdot(R, step))  # Φ' along the direction; negative for a descent
        potential = None
        alpha = 1.0
        for _ in range(halvings):
            trial = q + alpha * step
            R_trial = self.residual(trial)
            norm_trial = np.linalg.norm(R_trial)
            if norm_trial <= max(goal, (1 - 1e-4 * alpha) * norm):
                return trial, R_trial, norm_trial
            if self.has_potential and slope < 0 and np.isfinite(norm_trial):
                potential = self.potential(q) if potential is None else potential
                if self.potential(trial) <= potential + 1e-4 * alpha * slope:
                    return trial, R_trial, norm_trial
            alpha *= shrink
        return None

    def potential(self, q):
        """Φ(q) = ½ wa q·M q + q·M ã + U(x(q)) / wx."""
        stage = self.stage
        x, _, _ = stage.at(q)
        inertia = self.system.scalar_mass @ (0.5 * stage.wa * q + stage.a)
        energy = sum(term.energy(x, stage.t) for term in self.system.bound)
        return float(np.vdot(q, inertia)) + energy / stage.wx
