"""Line search along Newton's direction, for time steps and equilibrium."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fecloth.linalg.reductions import NodeSums

HALVINGS = 12


def find_step(
    sums: NodeSums,
    at: Callable[[np.ndarray], tuple],
    y: np.ndarray,
    R: np.ndarray,
    step: np.ndarray,
    goal: float,
    potential: Callable[[np.ndarray], float] | None,
    first: float = 1.0,
):
    """Find the largest α of first, first/2, … with an improvement at y + α step; None without one.

    `at(y)` = (R, …), and R is that at y; `sums` is `System.sums`. A step improves if R falls, or
    the potential sufficiently (Nocedal and Wright 2006, Numerical Optimization, eq. 3.6a), or,
    where there is none, if R does not push back hard at its end: R·s ≤ 0.8 |R₀·s| (after Matthies
    and Strang 1979, who ask for half).

    Returns
    -------
    α, y + α s, at(y + α s)
    """
    norm, slope, start = sums.norm(R), sums.dot(R, step), None
    if not (slope < 0 or norm == 0):  # uphill: the matrix was not positive definite
        return None
    for alpha in first * 0.5 ** np.arange(HALVINGS):
        trial = y + alpha * step
        R_there, *_ = there = at(trial)
        norm_there = sums.norm(R_there)
        if not np.isfinite(norm_there):
            continue
        if norm_there <= max(goal, (1 - 1e-4 * alpha) * norm):
            return float(alpha), trial, there
        if potential is None:
            if sums.dot(R_there, step) <= -0.8 * slope:
                return float(alpha), trial, there
            continue
        start = potential(y) if start is None else start
        if potential(trial) <= start + 1e-4 * alpha * slope:
            return float(alpha), trial, there
    return None
