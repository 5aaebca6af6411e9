"""The equation of static equilibrium, f(x) = 0, for Newton's iteration."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear import equation
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.remedies import Remedies, Remedy
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import principal_stretches

FEW = 0.1  # of the triangles: with contact, as many are slack without being the cause
LESS, MORE = 10, 30  # factors of 4 that the first shift may shrink and grow by


class EquilibriumFailed(equation.Unsolved):
    """No equilibrium was found; `state` is the best one reached, with its `residual`.

    With load steps, `state` balances the loads times `load`, the largest factor solved, and
    `residual` belongs to the last attempt at a larger load.
    """

    what = "equilibrium: "

    def __init__(self, reason: str, residual: float, state: State, remedy: str, load=1.0):
        self.state = state
        self.load = load
        super().__init__(reason, residual, remedy)


@dataclass(frozen=True, eq=False)
class StaticEquation:
    """R = −f at positions x, with the loads times `load`; J = K + σ M."""

    system: System
    start: State  # the state from which the solution is sought; its v is 0, its t that of the loads
    load: float = 1.0
    t: float = 0.0  # time of all terms that are no loads: where clamps and obstacles are

    wx = 1.0
    takes_short_solves = False
    explores = True

    @cached_property
    def longest(self) -> float:
        return float(np.ptp(self.system.cloth.X, axis=0).max())

    @cached_property
    def remedies(self) -> Remedies:
        """K, and definite K with σ M; the first σ moves the cloth by a tenth of its extent."""
        f, _ = self.forces(self.start)
        mean = np.linalg.norm(f, axis=1).sum() / self.system.nodal_mass.sum()
        first = 10 * float(mean) / self.longest
        shifted = (Remedy(first * 4.0**n, True) for n in range(-LESS, MORE))
        return Remedies((Remedy(0.0, False), *shifted), second=LESS + 1)

    @cached_property
    def potential(self) -> Callable[[np.ndarray], float] | None:
        """Σ of the energies. At v = 0 a purely dissipative term has no force and needs none."""
        bound = self.system.bound
        has_one = all(b.has_energy or (b.dissipative and not b.supplies) for b in bound)
        return self.energy if has_one else None

    def energy(self, x: np.ndarray) -> float:
        """Energy [J] of the terms that have one."""
        return sum(k * term.energy(x, t) for term, k, t in self.terms() if term.has_energy)

    def terms(self) -> Iterator[tuple]:
        """Each term, its factor and its time."""
        for term in self.system.bound:
            yield (term, self.load, self.start.t) if term.load else (term, 1.0, self.t)

    def at(self, x: np.ndarray) -> State:
        return State(self.t, x, np.zeros_like(x))

    def forces(self, state: State) -> tuple[np.ndarray, float]:
        """f of the free directions (n, 3), and Σ ‖f_term‖ of all directions, as the pins hold."""
        total = np.zeros_like(state.x)
        scale = 0.0
        for term, factor, t in self.terms():
            f = np.zeros_like(state.x)
            term.add_force(state.x, state.v, t, f)
            total += factor * f
            scale += factor * self.system.force_size(f)
        return self.system.constraints.project(total), scale

    def largest_step(self, x: np.ndarray, step: np.ndarray) -> float:
        return equation.largest_step(self.system, x, step, self.t)

    def residual(self, x: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
        """−f, and the scale of the forces at x."""
        f, scale = self.forces(self.at(x))
        return -f, scale

    def round_off(self, x: np.ndarray) -> float:
        change = equation.measure_round_off(lambda state: self.forces(state)[0], self.at(x))
        return self.system.sums.norm(change)

    def assemble(self, x: np.ndarray, remedy: Remedy, J: BlockMatrix) -> None:
        """J = K + σ M."""
        still = np.zeros_like(x)
        self.system.assemble(J, self.at(x), wa=remedy.shift)
        for term, factor, t in self.terms():
            term.add_tangent(x, still, t, factor, 0.0, J, remedy.definite)
        self.system.project(J)

    def couple(self, x: np.ndarray, remedy: Remedy, J: BlockMatrix) -> BlockMatrix:
        """J plus what terms couple outside its pattern; they are no loads."""
        return self.system.couple(J, self.at(x), 1.0, definite=remedy.definite)

    def updates(self, x: np.ndarray) -> list[tuple[float, np.ndarray]]:
        parts = [(k, term.dense(x, t)) for term, k, t in self.terms()]
        dense = [(k, part) for k, part in parts if part is not None]
        return [(k * c, self.system.constraints.project(u)) for k, (c, u) in dense]

    def key(self, remedy: Remedy) -> tuple:
        """No factor is used again."""
        return self, remedy

    def failure(
        self, reason: str, point: Point, residual: float, remedy: str = ""
    ) -> EquilibriumFailed:
        """The error; it says how many triangles are slack, which is the usual cause."""
        stretches = principal_stretches(self.system.cloth, point.y)
        slack = int((stretches.max(axis=1) < 1 - 1e-9).sum())
        if slack > (FEW * len(stretches) if equation.has_limits(self.system) else 0):
            reason += f"; {slack} of {len(stretches)} triangles are slack in every direction"
        if not remedy and any(term.needs_path for term in self.system.bound):
            remedy = (
                "Take more load_steps, hold the cloth by a pin or by more friction, or march with "
                "damping."
            )
        if not remedy and equation.has_limits(self.system):
            remedy = (
                "On an obstacle without friction the cloth may slide and turn: hold what is free "
                "by a Slide, start nearer to the equilibrium, or march with damping."
            )
        remedy = remedy or (
            "Give the cloth bending stiffness, let the loads grow in more load_steps, start "
            "from a state nearer to the equilibrium, or find one by marching with damping."
        )
        return EquilibriumFailed(reason, residual, self.at(point.y), remedy)
