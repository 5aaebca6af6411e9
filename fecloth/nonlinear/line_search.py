"""Line search along Newton's direction, for time steps and equilibrium."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from fecloth.linalg.reductions import NodeSums

HALVINGS = 12
DOUBLINGS = 12
SUFFICIENT = 1e-4  # part of the fall that the slope promises
SHORT = 100.0  # times `tiny`
PUSH = 0.8  # part of the slope: what may point back at the end of a step


@dataclass(frozen=True, eq=False)
class Point:
    """An unknown y (n, 3), its residual R (n, 3), ‖R‖, and the sum of the norms of all forces."""

    y: np.ndarray
    R: np.ndarray
    norm: float
    scale: float

    @property
    def relative(self) -> float:
        """‖R‖ over the forces; 0 where there are none."""
        if self.scale:
            return float(self.norm / self.scale)
        return 0.0


def find_step(
    sums: NodeSums,
    at: Callable[[np.ndarray], Point],
    start: Point,
    step: np.ndarray,
    enough: float,
    potential: Callable[[np.ndarray], float] | None,
    longest: float = np.inf,
    tiny: float = 0.0,
) -> tuple[Point, float] | None:
    """Find the longest α of 1, ½, ¼, … with an improvement at y + α s: the `Point` and α.

    It is an improvement if ‖R‖ is `enough`, or if the potential falls sufficiently (Nocedal
    and Wright 2006, Numerical Optimization, eq. 3.6a). For α ≤ `tiny` that fall is lost in
    round-off, and R·s ≤ 0.8 |R₀·s| tells it (Hager and Zhang 2005, A New Conjugate Gradient
    Method, SIAM J. Optim. 16, eq. 4.1 with δ = 0.1). Without a potential this rule holds for
    every α (Matthies and Strang 1979 ask for half), and any fall of ‖R‖ is an improvement.

    If R·s is steeper at the end of the whole step than at its start, the potential is concave
    along s, and α is doubled for as long as that lasts. Otherwise an iteration would leave a
    point of unstable balance by a few per cent of its distance at a time. Without a potential
    nothing tells whether a long step is too long, and α is doubled only up to 100 `tiny`.
    `longest` limits all α. Returns None without an improvement, or if s leads uphill, as by an
    indefinite matrix.
    """
    slope = sums.dot(start.R, step)
    if not (slope < 0 or start.norm == 0):
        return None
    energy = cache(lambda: potential(start.y) if potential else 0.0)

    def falls(alpha: float, there: Point) -> bool:
        if potential is None or alpha <= tiny:
            return bool(sums.dot(there.R, step) <= -PUSH * slope)
        return bool(potential(there.y) <= energy() + SUFFICIENT * alpha * slope)

    for alpha in min(1.0, longest) * 0.5 ** np.arange(HALVINGS):
        there = at(start.y + alpha * step)
        if potential is None:
            any_fall = (1 - SUFFICIENT * alpha) * start.norm
        else:
            any_fall = 0.0
        if there.norm <= max(enough, any_fall):
            return there, float(alpha)
        if np.isfinite(there.norm) and falls(alpha, there):
            break
    else:
        return None
    limit = longest if potential else min(longest, SHORT * tiny)
    for _ in range(DOUBLINGS):
        if 2 * alpha > limit or not sums.dot(there.R, step) < slope:
            break
        further = at(start.y + 2 * alpha * step)
        if not (np.isfinite(further.norm) and falls(2 * alpha, further)):
            break
        alpha = 2 * alpha
        there = further
    return there, float(alpha)
