"""The equation of an implicit step, M a(q) = f(x(q), v(q), t), and its solution."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fecloth.errors import FeclothError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.equation import (
    Unsolved,
    admit,
    has_limits,
    largest_step,
    measure_round_off,
)
from fecloth.nonlinear.error_left import ErrorLeft
from fecloth.nonlinear.iteration import iterate
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.remedies import Remedies, Remedy
from fecloth.nonlinear.stage import Stage
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import System

MULTIPLES = (0.0, *(4.0**n for n in range(-1, 8)))  # of wa M, added to the matrix
REMEDIES = {
    "none": (Remedy(0.0, False),),
    "clamp": (Remedy(0.0, True),),
    "on_failure": tuple(Remedy(each, definite) for definite in (False, True) for each in MULTIPLES),
}


class NewtonFailed(Unsolved):
    """The stage equation was not solved; `residual` is what was reached."""


@dataclass(frozen=True, eq=False)
class StageEquation:
    """R = M a − f at the unknown q of a stage, with J = wa M + wv D + wx K."""

    system: System
    stage: Stage
    definiteness: str

    longest = float("inf")
    explores = False

    @property
    def wx(self) -> float:
        return self.stage.wx

    @property
    def remedies(self) -> Remedies:
        """The remedies of the option `definiteness`; their shift σ is a multiple of wa.

        With a potential, tangents are clamped before mass is added. Without one nothing would
        keep the iteration from a valley in which it then creeps.
        """
        clamps = self.definiteness == "on_failure" and self.potential
        return Remedies(REMEDIES[self.definiteness], clamped=len(MULTIPLES) if clamps else None)

    @property
    def takes_short_solves(self) -> bool:
        """Whether a term limits directions, and the forces have a potential to be lowered."""
        return has_limits(self.system) and self.potential is not None

    @property
    def potential(self) -> Callable[[np.ndarray], float] | None:
        """Φ(q) = ½ wa q·M q + q·M ã + U(x)/wx + ½ v·C v/wv, where each force has a U or is −C v."""
        terms = [term for term in self.system.bound if not term.damps_linearly]
        has_one = all(term.has_energy and not term.velocity_dependent for term in terms)
        if has_one:
            return self.incremental_potential
        return None

    def incremental_potential(self, q: np.ndarray) -> float:
        stage, (x, v, _), terms = self.stage, self.stage.at(q), self.system.bound
        inertia = self.system.scalar_mass @ (0.5 * stage.wa * q + stage.a)
        energy = sum(b.energy(x, stage.t) for b in terms if b.has_energy)
        power = sum(b.power(x, v, stage.t) for b in terms if b.damps_linearly)
        potential = energy / stage.wx + (0.5 * power / stage.wv if power else 0.0)
        return self.system.sums.dot(q, inertia) + potential

    def state(self, q: np.ndarray) -> State:
        x, v, _ = self.stage.at(q)
        return State(self.stage.t, x, v)

    def largest_step(self, q: np.ndarray, step: np.ndarray) -> float:
        return largest_step(self.system, self.stage.at(q)[0], self.wx * step, self.stage.t)

    def residual(self, q: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
        """M a − f of the free directions, and ‖M a‖ + Σ ‖f_term‖ at the first iterate."""
        (x, v, a), system = self.stage.at(q), self.system
        inertia = system.scalar_mass @ a
        if scale:
            R = inertia - system.force(State(self.stage.t, x, v))
            return system.constraints.project(R), scale
        R = inertia.copy()
        scale = system.force_size(inertia)
        for term in system.bound:
            f = np.zeros_like(x)
            term.add_force(x, v, self.stage.t, f)
            R -= f
            scale += system.force_size(f)
        return system.constraints.project(R), scale

    def push(self, q: np.ndarray) -> float:
        """‖f‖ of the forces of contact, or ‖M a‖ if that is more; 0 where nothing touches [N]."""
        (x, v, a), system, f = self.stage.at(q), self.system, np.zeros_like(q)
        for term in system.bound:
            if term.limits_direction:
                term.add_force(x, v, self.stage.t, f)
        forces = f, system.scalar_mass @ a
        if f.any():
            return max(map(system.sums.norm, forces))
        return 0.0

    def round_off(self, q: np.ndarray) -> float:
        """The round-off of the forces; the inertia, linear in q, has little."""
        change = measure_round_off(self.system.force, self.state(q))
        return self.system.sums.norm(self.system.constraints.project(change))

    def assemble(self, q: np.ndarray, remedy: Remedy, J: BlockMatrix) -> None:
        """J = (1 + σ) wa M + wv D + wx K; K and D as they are, or definite."""
        _, wx, wv, wa, definite = self.key(remedy)
        self.system.project(self.system.assemble(J, self.state(q), wx, wv, wa, definite))

    def couple(self, q: np.ndarray, remedy: Remedy, J: BlockMatrix) -> BlockMatrix:
        _, wx, wv, _, definite = self.key(remedy)
        return self.system.couple(J, self.state(q), wx, wv, definite)

    def updates(self, q: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """(wx c, u) of the dense parts of K."""
        project = self.system.constraints.project
        dense = self.system.dense(self.state(q))
        return [(self.stage.wx * c, project(u)) for c, u in dense]

    def key(self, remedy: Remedy) -> tuple:
        """The system, the weights of K, D and M, and whether K and D are definite."""
        stage, system = self.stage, self.system.constraints  # which the system over a step shares
        return system, stage.wx, stage.wv, (1 + remedy.shift) * stage.wa, remedy.definite

    def failure(self, reason: str, point: Point, residual: float) -> NewtonFailed:
        """The error, with what may help."""
        remedy = "Take a smaller dt."
        if self.definiteness == "none":
            remedy = 'Use definiteness = "on_failure", or a smaller dt.'
        return NewtonFailed(reason, residual, remedy)


def solve(
    system: System,
    stage: Stage,
    solver: SolverContext,
    guess: np.ndarray | None = None,
    dt: float | None = None,
) -> tuple[np.ndarray, Counts]:
    """Return the unknown q (n, 3) of a stage, and the `Counts`.

    It starts from the `guess`, or from zero where the potential is less there, without a guess,
    or where the forces there are not finite. With contact both begin where `find_guess` leads.
    With `dt`, the size of the step [s], the tolerance "auto" ends the iteration by the error in
    time of the step; without it, by the residual. If the solver holds a factor for the same
    weights, its direction is tried first. The full step is taken if the residual falls, with a
    potential if it halves; otherwise a new factor is computed. `iteration.iterate` says how the
    length of a step is chosen, and what happens where the matrix is not definite. The residual
    alone would not do for that: good steps that turn a cloth stretch it, and so increase it.
    """
    equation = StageEquation(system, stage, solver.options.definiteness)
    zero = np.zeros_like(stage.x)
    q = zero if guess is None else system.constraints.project(guess.copy())
    if has_limits(system):
        q, zero = _admit_both(system, stage, q, zero)
    if (potential := equation.potential) and potential(zero) < potential(q):
        q = zero
    left = None
    if solver.options.tolerance == "auto" and solver.step_error and dt:
        left = ErrorLeft(float(dt * stage.wv), float(solver.step_error.over(dt)))
        left.push = equation.push if has_limits(system) else None
    solver.begin(stage.wx, stage.wa, stage.x)
    try:
        return iterate(equation, solver, q, least=1, instead=zero, left=left)
    except FeclothError:
        solver.factor_reuse.drop()
        raise


def _admit_both(system: System, stage: Stage, q: np.ndarray, zero: np.ndarray):
    """The unknowns near q and zero that all contacts allow, or one twice; else `NewtonFailed`."""
    guesses = []
    for each in (q, zero):
        x = stage.at(each)[0]
        if (there := admit(system, x, stage.t)) is not None:
            if there is not x:
                each = each + system.constraints.project((there - x) / stage.wx)
            guesses.append(each)
    if not guesses:
        reason = "no positions were found for the start of its iteration that all contacts allow"
        raise NewtonFailed(reason, math.nan, "Take a smaller dt.")
    return guesses[0], guesses[-1]
