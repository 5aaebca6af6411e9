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
from fecloth.nonlinear.joined_stage import JoinedStage
from fecloth.nonlinear.last_stage import LastStage
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.remedies import Remedies, Remedy
from fecloth.nonlinear.stage import Stage
from fecloth.nonlinear.statistics import Counts
from fecloth.system.state import State
from fecloth.system.system import System

MULTIPLES = (0.0, *(4.0**n for n in range(-1, 8)))  # of wa M, added to the matrix
REMEDIES = {
    "none": (Remedy(0.0, definite=False),),
    "clamp": (Remedy(0.0, definite=True),),
    "on_failure": (
        *(Remedy(multiple, definite=False) for multiple in MULTIPLES),
        *(Remedy(multiple, definite=True) for multiple in MULTIPLES),
    ),
}


class NewtonFailed(Unsolved):
    """The stage equation was not solved; `residual` is the relative one that was reached."""


@dataclass(frozen=True, eq=False)
class StageEquation:
    """R = M a − f at the unknown q of a stage, with J = wa M + wv D + wx K.

    `last` has the joined calls that evaluate it without Python between kernels, to the same
    bits, and tangents that several iterations share. Without it all tangents are exact.
    """

    system: System
    stage: Stage
    definiteness: str
    last: LastStage | None = None

    longest = float("inf")
    explores = False

    @property
    def joined(self) -> JoinedStage | None:
        """The joined calls of the stage, if its terms have such calls."""
        return self.last.joined if self.last else None

    @property
    def wx(self) -> float:
        return self.stage.wx

    @property
    def remedies(self) -> Remedies:
        """The remedies of the option `definiteness`; their shift σ is a multiple of wa.

        With a potential, tangents are clamped before mass is added. Without one nothing would
        keep the iteration from a valley in which it then creeps.
        """
        clamped = None
        if self.definiteness == "on_failure" and self.potential:
            clamped = len(MULTIPLES)  # number of the first remedy that clamps: without mass
        return Remedies(REMEDIES[self.definiteness], clamped=clamped)

    @property
    def takes_short_solves(self) -> bool:
        """Whether a term limits directions, and the forces have a potential to be lowered."""
        return has_limits(self.system) and self.potential is not None

    @property
    def potential(self) -> Callable[[np.ndarray], float] | None:
        """`incremental_potential`, where each force has an energy U or is −C v; else None."""
        others = [term for term in self.system.bound if not term.damps_linearly]
        if all(term.has_energy and not term.velocity_dependent for term in others):
            return self.incremental_potential
        return None

    def incremental_potential(self, q: np.ndarray) -> float:
        """Φ(q) = ½ wa q·M q + q·M ã + U(x)/wx + ½ v·C v/wv, whose gradient is R.

        U is the sum of the energies of the terms, and v·C v the power of linear damping.
        """
        stage = self.stage
        terms = self.system.bound
        x, v, _ = stage.at(q)
        inertia = self.system.scalar_mass @ (0.5 * stage.wa * q + stage.a)
        if self.joined and self.joined.has_energies:
            energy = self.joined.energy(q)
        else:
            energy = sum(term.energy(x, stage.t) for term in terms if term.has_energy)
        power = sum(term.power(x, v, stage.t) for term in terms if term.damps_linearly)
        potential = energy / stage.wx + (0.5 * power / stage.wv if power else 0.0)
        return self.system.sums.dot(q, inertia) + potential

    def state(self, q: np.ndarray) -> State:
        """The state in which the forces balance, for an unknown q."""
        x, v, _ = self.stage.at(q)
        return State(self.stage.t, x, v)

    def largest_step(self, q: np.ndarray, step: np.ndarray) -> float:
        """The largest α for which all contacts allow q + α step."""
        return largest_step(self.system, self.stage.at(q)[0], self.wx * step, self.stage.t)

    def residual(self, q: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
        """R = M a − f (n, 3) of the free directions [N], and the scale of the forces [N].

        The scale is ‖M a‖ + Σ ‖f_term‖, reactions included, at the first iterate, where `scale`
        is 0. Later it is returned as it is given.
        """
        if self.joined and scale:
            return self.joined.residual(q), scale
        if self.joined:
            R, scale = self.joined.first_residual(q)
            if np.isfinite(scale):
                return R, scale
            scale = 0.0  # the terms below raise an error if a load is not finite
        x, v, a = self.stage.at(q)
        system = self.system
        inertia = system.scalar_mass @ a
        if scale:  # only the sum of the forces is needed
            R = inertia - system.force(State(self.stage.t, x, v))
            return system.constraints.project(R), scale
        R = inertia.copy()
        scale = system.force_size(inertia)
        for term in system.bound:
            f = np.zeros_like(x)
            term.add_force(x, v, self.stage.t, f)
            R -= f
            scale += system.force_size(f)
        return system.constraints.reduce(R), scale

    def push(self, q: np.ndarray) -> float:
        """The size [N] of the forces at q with which `ErrorLeft.push` compares the residual.

        It is ‖f‖ of the contacts, or ‖M a‖ if that is more; 0 where nothing touches.
        """
        x, v, a = self.stage.at(q)
        f = np.zeros_like(q)
        for term in self.system.bound:
            if term.limits_direction:
                term.add_force(x, v, self.stage.t, f)
        if not f.any():
            return 0.0
        norm = self.system.sums.norm
        return max(norm(f), norm(self.system.scalar_mass @ a))

    def round_off(self, q: np.ndarray) -> np.ndarray:
        """The round-off of the forces (n, 3) [N]; the inertia, linear in q, has little."""
        change = measure_round_off(self.system.force, self.state(q))
        return self.system.constraints.project(change)

    def assemble(self, q: np.ndarray, remedy: Remedy, J: BlockMatrix) -> None:
        """J = (1 + σ) wa M + wv D + wx K; K and D as they are, or definite."""
        _, wx, wv, wa, definite = self.key(remedy)
        state = self.state(q)
        kept = self.last.kept if self.last else None
        renew = kept is not None and kept.must_renew(definite)
        joined = self.joined
        if joined and J is joined.matrix and joined.can_assemble(definite):
            joined.assemble(q, wa, definite, renew)
            return
        if kept is None or J.pattern is not kept.matrix.pattern:
            self.system.project(self.system.assemble(J, state, wx, wv, wa, definite))
            return
        if renew:
            kept.matrix.values.fill(0.0)
            self.system.add_tangents(kept.matrix, state, wx, wv, definite=definite, kept=True)
        J.values[...] = kept.matrix.values
        self.system.add_tangents(J, state, wx, wv, wa, definite, kept=False)
        self.system.project(J)

    def mass_weight(self, remedy: Remedy) -> float:
        """(1 + σ) wa."""
        return (1 + remedy.shift) * self.stage.wa

    def couple(self, q: np.ndarray, remedy: Remedy, J: BlockMatrix) -> BlockMatrix:
        """J plus what terms couple outside its pattern."""
        _, wx, wv, _, definite = self.key(remedy)
        return self.system.couple(J, self.state(q), wx, wv, definite)

    def updates(self, q: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """(wx c, u) of the dense parts of K."""
        dense = self.system.dense(self.state(q))
        return [(self.stage.wx * c, self.system.constraints.reduce(u)) for c, u in dense]

    def key(self, remedy: Remedy) -> tuple:
        """The system, the weights of K, D and M, and whether K and D are definite."""
        stage = self.stage
        same = self.system.constraints  # which a system shares with itself over a step
        return same, stage.wx, stage.wv, self.mass_weight(remedy), remedy.definite

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
    """Solve for the unknown q (n, 3) of a stage; return it and the `Counts`.

    The iteration starts from the `guess`. It starts from zero without a guess, where the
    potential is less there, or where the forces at the guess are not finite. With contact both
    begin where `find_guess` leads. With `dt`, the size of the step [s], the tolerance "auto"
    ends the iteration by the error in time of the step; without it, by the residual.
    `solver` has the linear solver, and its state changes.

    If the solver holds a factor for the same weights, its direction is tried first. The full
    step is taken if the residual falls, with a potential if it halves; otherwise a new factor
    is computed. `iteration.iterate` says how the length of a step is chosen, and what happens
    where the matrix is not definite. The residual alone could not decide that: good steps that
    turn a cloth stretch it, and so increase the residual.

    Raises `NewtonFailed` where the iteration fails, or no start was found that contacts allow.
    """
    _, matrix = solver.matrix_solver()
    solver.last_stage.begin(system, stage, matrix)
    equation = StageEquation(system, stage, solver.options.definiteness, solver.last_stage)
    zero = np.zeros_like(stage.x)
    q = zero if guess is None else system.constraints.expand(guess.copy())
    if has_limits(system):
        q, zero = _admit_starts(system, stage, [q, zero])
    if (potential := equation.potential) and potential(zero) < potential(q):
        q = zero
    error_left = None
    if solver.options.tolerance == "auto" and solver.step_error and dt:
        error_left = ErrorLeft(
            unit=float(dt * stage.wv),
            in_time=float(solver.step_error.over(dt)),
            push=equation.push if has_limits(system) else None,
        )
    solver.begin(stage.wx, stage.wa, stage.x)
    try:
        return iterate(equation, solver, q, least=1, other_start=zero, error_left=error_left)
    except FeclothError:
        # A repeated step must not depend on the factor of the failed one.
        solver.factor_reuse.drop()
        raise


def _admit_starts(
    system: System, stage: Stage, starts: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """The unknowns (n, 3) near two `starts` that all contacts allow.

    Where only one of the two is found, it is returned twice. Raises `NewtonFailed` if there is
    none.
    """
    guesses = []
    for q in starts:
        x, _, _ = stage.at(q)
        allowed = admit(system, x, stage.t)
        if allowed is None:
            continue
        if allowed is not x:  # move q, so that x(q) is where the contacts allow it
            q = q + system.constraints.expand((allowed - x) / stage.wx)
        guesses.append(q)
    if not guesses:
        reason = "no positions were found for the start of its iteration that all contacts allow"
        raise NewtonFailed(reason, math.nan, "Take a smaller dt.")
    return guesses[0], guesses[-1]
