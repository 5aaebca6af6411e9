"""Line search along Newton's direction, for time steps and equilibrium."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from fecloth.linalg.reductions import NodeSums

# Lengths that are tried, each half of the one before, and then doublings: the length of Newton's
# step is wrong by a factor of a few thousand at most, or the direction is wrong.
MOST_LENGTHS = 12
# The potential must fall by this part of what the slope promises (Nocedal and Wright 2006).
SUFFICIENT_FALL = 1e-4
# At the end of a step too short for that, this part of the slope may point back: 1 − 2 δ with
# δ = 0.1 as in Hager and Zhang (2005).
LARGEST_PUSH_BACK = 0.8
# Times `tiny`: up to here a step is doubled without a potential, which would tell it is too long.
LONGEST_DOUBLED = 100.0


@dataclass(frozen=True, eq=False)
class Point:
    """An unknown and its residual.

    Attributes
    ----------
    y
        The unknown (n, 3).
    R
        Its residual (n, 3).
    norm
        ‖R‖.
    scale
        The sum of the norms of all forces, with which ‖R‖ is compared.
    """

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
    along s. Then α is doubled for as long as that lasts. Otherwise an iteration would leave a
    point of unstable balance by a few per cent of its distance at a time. Without a potential
    nothing tells whether a long step is too long, and α is doubled only up to 100 `tiny`.

    Parameters
    ----------
    sums
        The dot product of arrays (n, 3).
    at
        The point at an unknown (n, 3).
    start, step
        y and its residual R₀, and the direction s (n, 3).
    enough
        ‖R‖ that is an improvement in any case.
    potential
        The function of y whose gradient R is, or None.
    longest
        The largest α.
    tiny
        α up to which round-off hides the change of the potential.

    Returns
    -------
    tuple of Point and float, or None
        None without an improvement, or if s leads uphill, as by an indefinite matrix.
    """
    slope = sums.dot(start.R, step)
    if not (slope < 0 or start.norm == 0):  # also for a slope that is not a number
        return None
    energy = cache(lambda: potential(start.y) if potential else 0.0)

    def falls(alpha: float, end: Point) -> bool:
        """Whether the potential falls sufficiently from the start to `end`, at α."""
        if potential is None or alpha <= tiny:
            return bool(sums.dot(end.R, step) <= -LARGEST_PUSH_BACK * slope)
        return bool(potential(end.y) <= energy() + SUFFICIENT_FALL * alpha * slope)

    for alpha in min(1.0, longest) * 0.5 ** np.arange(MOST_LENGTHS):
        end = at(start.y + alpha * step)
        small_enough = enough
        if potential is None:  # any fall of ‖R‖ is an improvement
            small_enough = max(enough, (1 - SUFFICIENT_FALL * alpha) * start.norm)
        if end.norm <= small_enough:
            return end, float(alpha)
        if np.isfinite(end.norm) and falls(alpha, end):
            break
    else:
        return None
    # An improvement was found. Double α while the potential is concave along s.
    limit = longest if potential else min(longest, LONGEST_DOUBLED * tiny)
    for _ in range(MOST_LENGTHS):
        is_concave = sums.dot(end.R, step) < slope
        if 2 * alpha > limit or not is_concave:
            break
        farther = at(start.y + 2 * alpha * step)
        if not (np.isfinite(farther.norm) and falls(2 * alpha, farther)):
            break
        alpha = 2 * alpha
        end = farther
    return end, float(alpha)
