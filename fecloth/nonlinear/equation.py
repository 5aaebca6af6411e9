"""What Newton's iteration needs of an equation: residual, matrix, and remedies where it fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.line_search import Point
from fecloth.system.system import System


class Remedy(NamedTuple):
    """σ [of the matrix's mass M] to add to the matrix as σ M, and whether to clamp tangents."""

    shift: float
    definite: bool


class Equation(Protocol):
    """R(y) = 0 for an unknown y (n, 3), as `iterate` solves it."""

    @property
    def system(self) -> System:
        """Supplies the constraints and the sums over nodes."""
        ...

    @property
    def wx(self) -> float:
        """∂x/∂y."""
        ...

    @property
    def longest(self) -> float:
        """The longest way [m] that an iteration may move a node."""
        ...

    @property
    def potential(self) -> Callable[[np.ndarray], float] | None:
        """The function of y whose gradient R is, or None."""
        ...

    @property
    def remedies(self) -> tuple[Remedy, ...]:
        """What to try in this order; the first is the exact matrix, if the options allow that."""
        ...

    @property
    def resume(self) -> int:
        """Where to go on after the first remedy has failed in the first iteration.

        The remedies from number max(resume − 1, 1) on are then tried.
        """
        ...

    @property
    def clamped(self) -> int | None:
        """Which remedy comes next after the first, in at most CLAMPED iterations; or None."""
        ...

    @property
    def takes_short_solves(self) -> bool:
        """Whether a direction may be the iterate of a solve that met negative curvature."""
        ...

    def largest_step(self, y: np.ndarray, step: np.ndarray) -> float:
        """The largest α for which the terms allow y + α step; see `limits.largest_step`."""
        ...

    def residual(self, y: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
        """R (n, 3) of the free directions and the sum of the norms of all forces, reactions too.

        `scale` is the sum at the iterate before; 0.0 at the first one.
        """
        ...

    def round_off(self, y: np.ndarray) -> float:
        """How much R changes if the last digits of positions and velocities change."""
        ...

    def assemble(self, y: np.ndarray, remedy: Remedy, J: BlockMatrix) -> None:
        """J = ∂R/∂y with a remedy, projected onto the free directions."""
        ...

    def couple(self, y: np.ndarray, remedy: Remedy, J: BlockMatrix) -> BlockMatrix:
        """J plus the parts of ∂R/∂y outside its pattern, projected too; J itself without any."""
        ...

    def updates(self, y: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """(c, u) of each part c u uᵀ of ∂R/∂y that J leaves out."""
        ...

    def key(self, remedy: Remedy) -> tuple:
        """The quantities that identify J, for the reuse of its factor."""
        ...

    def failure(self, reason: str, point: Point, residual: float) -> Exception:
        """The error to raise where the iteration ended; `residual` is relative."""
        ...
