"""What Newton's iteration needs of an equation, and what the equations of cloths share."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from fecloth.errors import FeclothError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.line_search import Point
from fecloth.nonlinear.remedies import Remedies, Remedy
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.guess import find_guess


class Unsolved(FeclothError):
    """An equation was not solved; `residual` is the relative residual that was reached."""

    what = ""  # begins the message

    def __init__(self, reason: str, residual: float, remedy: str):
        self.reason = reason
        self.residual = residual
        self.remedy = remedy
        super().__init__(reason, residual, remedy)

    def __str__(self) -> str:
        return f"{self.what}{self.reason} (relative residual {self.residual:.2e}). {self.remedy}"


class Equation(Protocol):
    """R(y) = 0 for an unknown y (n, 3), as `iteration.iterate` solves it."""

    @property
    def system(self) -> System:
        """Supplies the constraints and the sums over nodes."""

    @property
    def wx(self) -> float:
        """∂x/∂y."""

    @property
    def longest(self) -> float:
        """The longest way [m] that an iteration may move a node."""

    @property
    def potential(self) -> Callable[[np.ndarray], float] | None:
        """The function of y whose gradient R is, or None."""

    @property
    def remedies(self) -> Remedies:
        """What to try where the exact matrix fails."""

    @property
    def takes_short_solves(self) -> bool:
        """Whether a direction may be the iterate of a solve that met negative curvature."""

    @property
    def explores(self) -> bool:
        """Whether slow iterations are worth more work; see `Steps.explore`, `find_direction`."""

    def largest_step(self, y: np.ndarray, step: np.ndarray) -> float:
        """The largest α for which the terms allow y + α step; see the function below."""

    def residual(self, y: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
        """R (n, 3) of the free directions and the sum of the norms of all forces, reactions too.

        `scale` is the sum at the iterate before; 0.0 at the first one.
        """

    def round_off(self, y: np.ndarray) -> np.ndarray:
        """How R (n, 3) changes if the last digits of positions and velocities change."""

    def assemble(self, y: np.ndarray, remedy: Remedy, J: BlockMatrix) -> None:
        """J = ∂R/∂y with a remedy, projected onto the free directions."""

    def mass_weight(self, remedy: Remedy) -> float:
        """The weight of M in the matrix of a remedy."""

    def couple(self, y: np.ndarray, remedy: Remedy, J: BlockMatrix) -> BlockMatrix:
        """J plus the parts of ∂R/∂y outside its pattern, projected too; J itself without any."""

    def updates(self, y: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """(c, u) of each part c u uᵀ of ∂R/∂y that J leaves out."""

    def key(self, remedy: Remedy) -> tuple:
        """The quantities that J depends on beside y, for the reuse of its factor."""

    def failure(self, reason: str, point: Point, residual: float) -> Exception:
        """The error to raise where the iteration ended; `residual` is relative."""


def measure_round_off(force: Callable[[State], np.ndarray], state: State) -> np.ndarray:
    """Change of the force (n, 3) [N] when x and v change in their last digits, at random.

    The random numbers are the same in every call. This measure is right for all terms. A bound
    from the stiffness would hold only for forces that are differences of positions.
    """
    random = np.random.default_rng(0)
    eps = float(np.finfo(float).eps)

    def shake(y: np.ndarray) -> np.ndarray:
        return y * (1 + eps * random.uniform(-1, 1, y.shape))

    x = shake(state.x)
    v = shake(state.v)
    return force(State(state.t, x, v)) - force(state)


def largest_step(
    system: System, x: np.ndarray, s: np.ndarray, t: float, longest: float = 1.0
) -> float:
    """The largest α for which all terms allow x + α s at the time t; infinite without contact.

    x and s are (n, 3) [m], and α is at most `longest`. With terms that couple nodes it is at most
    1, as their `limit` is expensive.
    """
    limits = [term.limit for term in system.bound if term.limits_direction]
    if not limits:
        return math.inf
    if any(term.couples_nodes for term in system.bound):
        longest = 1.0
    return longest * min(limit(x, longest * s, t) for limit in limits)


def has_limits(system: System) -> bool:
    """Whether a term of the system, such as a contact, limits directions."""
    return any(term.limits_direction for term in system.bound)


def admit(system: System, x: np.ndarray, t: float) -> np.ndarray | None:
    """Positions near x (n, 3), at the end t of a step, that all contacts allow.

    They are the array x itself without contact, and None if none were found.
    """
    ways = [term.way(t) for term in system.bound]
    ways_of_contact = [way for way in ways if way is not None]
    if not ways_of_contact:
        return x
    expand = system.constraints.expand
    return find_guess(ways_of_contact, x, lambda guess: x + expand(guess - x))
