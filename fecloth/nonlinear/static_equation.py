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

# With contact this part of the triangles may be slack without being the cause of a failure.
HARMLESS_SLACK = 0.1
# The shifts of the remedies are the first one times 4ⁿ for these n: enough for any stiffness.
SHIFT_POWERS = range(-10, 30)
# Times a direction: so far a line search may double a step, and so far obstacles are looked for.
LONGEST_DIRECTION = 16.0


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
    """R = −f at positions x, with the loads times `load`; J = K + σ M.

    Attributes
    ----------
    system
        The cloth and its terms.
    start
        The state from which the solution is sought; its v is 0, its t the time of the loads.
    load
        Factor on the loads.
    t
        Time of all terms that are no loads: it says where clamps and obstacles are.
    """

    system: System
    start: State
    load: float = 1.0
    t: float = 0.0

    wx = 1.0
    takes_short_solves = False
    explores = True

    @cached_property
    def longest(self) -> float:
        """The extent of the cloth [m]."""
        return float(np.ptp(self.system.cloth.X, axis=0).max())

    @cached_property
    def remedies(self) -> Remedies:
        """The exact K, and then definite K + σ M with growing σ.

        The σ to begin with is so large that σ M alone would hold the cloth: then the forces at
        the start move it by a tenth of its extent. Smaller ones are for later iterations.
        """
        f, _ = self.forces(self.start)
        mean_acceleration = np.linalg.norm(f, axis=1).sum() / self.system.nodal_mass.sum()
        first_shift = 10 * float(mean_acceleration) / self.longest
        shifted = (Remedy(first_shift * 4.0**n, definite=True) for n in SHIFT_POWERS)
        return Remedies(
            order=(Remedy(0.0, definite=False), *shifted),
            second=1 + SHIFT_POWERS.index(0),  # the one with 4⁰, after the exact K
        )

    @cached_property
    def potential(self) -> Callable[[np.ndarray], float] | None:
        """Σ of the energies. At v = 0 a purely dissipative term has no force and needs none."""
        if all(
            term.has_energy or (term.dissipative and not term.supplies)
            for term in self.system.bound
        ):
            return self.energy
        return None

    def energy(self, x: np.ndarray) -> float:
        """Energy [J] of the terms that have one."""
        return sum(k * term.energy(x, t) for term, k, t in self.terms() if term.has_energy)

    def terms(self) -> Iterator[tuple]:
        """Each term, its factor and its time."""
        for term in self.system.bound:
            if term.load:
                yield term, self.load, self.start.t
            else:
                yield term, 1.0, self.t

    def at(self, x: np.ndarray) -> State:
        """The state at rest at x (n, 3)."""
        return State(self.t, x, np.zeros_like(x))

    def forces(self, state: State) -> tuple[np.ndarray, float]:
        """The force f (n, 3) [N] of the free directions, and the scale Σ ‖f_term‖ [N].

        The scale also counts the forces on held directions, which the pins take.
        """
        total = np.zeros_like(state.x)
        scale = 0.0
        for term, factor, t in self.terms():
            f = np.zeros_like(state.x)
            term.add_force(state.x, state.v, t, f)
            if state is self.start and not np.isfinite(f).all():
                continue  # an obstacle has moved there since
            total += factor * f
            scale += factor * self.system.force_size(f)
        return self.system.constraints.reduce(total), scale

    def largest_step(self, x: np.ndarray, step: np.ndarray) -> float:
        """The largest α for which all contacts allow x + α step."""
        return equation.largest_step(self.system, x, step, self.t, LONGEST_DIRECTION)

    def residual(self, x: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
        """−f, and the scale of the forces at x."""
        f, scale = self.forces(self.at(x))
        return -f, scale

    def round_off(self, x: np.ndarray) -> np.ndarray:
        """The round-off of the forces (n, 3) [N]."""
        return equation.measure_round_off(lambda state: self.forces(state)[0], self.at(x))

    def assemble(self, x: np.ndarray, remedy: Remedy, J: BlockMatrix) -> None:
        """J = K + σ M."""
        still = np.zeros_like(x)
        self.system.assemble(J, self.at(x), wa=self.mass_weight(remedy))
        for term, factor, t in self.terms():
            term.add_tangent(x, still, t, factor, 0.0, J, remedy.definite)
        self.system.project(J)

    def mass_weight(self, remedy: Remedy) -> float:
        """σ."""
        return remedy.shift

    def couple(self, x: np.ndarray, remedy: Remedy, J: BlockMatrix) -> BlockMatrix:
        """J plus what terms couple outside its pattern; they are no loads."""
        return self.system.couple(J, self.at(x), 1.0, definite=remedy.definite)

    def updates(self, x: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """(c, u) of the dense parts of K."""
        updates = []
        for term, factor, t in self.terms():
            part = term.dense(x, t)
            if part is not None:
                c, u = part
                updates.append((factor * c, self.system.constraints.reduce(u)))
        return updates

    def key(self, remedy: Remedy) -> tuple:
        """No factor is used again."""
        return self, remedy

    def failure(
        self, reason: str, point: Point, residual: float, remedy: str = ""
    ) -> EquilibriumFailed:
        """The error to raise where the iteration ended, at a point with a relative `residual`.

        The `reason` is completed by the number of slack triangles, the usual cause. Without a
        `remedy` it has the one that fits the terms.
        """
        stretches = principal_stretches(self.system.cloth, point.y)
        slack = int((stretches.max(axis=1) < 1 - 1e-9).sum())  # not by round-off
        has_contact = equation.has_limits(self.system)
        most_harmless = HARMLESS_SLACK * len(stretches) if has_contact else 0
        if slack > most_harmless:
            reason += f"; {slack} of {len(stretches)} triangles are slack in every direction"
        if not remedy and any(term.needs_path for term in self.system.bound):
            remedy = (
                "Take more load_steps, hold the cloth by a pin or by more friction, or march "
                "with damping."
            )
        if not remedy and has_contact:
            remedy = (
                "On an obstacle without friction the cloth may slide and turn: hold what is "
                "free by a Slide, start nearer to the equilibrium, or march with damping."
            )
        remedy = remedy or (
            "Give the cloth bending stiffness, let the loads grow in more load_steps, start "
            "from a state nearer to the equilibrium, or find one by marching with damping."
        )
        return EquilibriumFailed(reason, residual, self.at(point.y), remedy)
