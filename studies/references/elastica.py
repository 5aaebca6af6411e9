"""The heavy elastica: a strip clamped level at one end, bent down by its own weight.

With s along the strip in units of its length L, φ(s) the angle below the horizontal and
Γ = ρ g L³/B, the balance of moments of the inextensible strip gives

    φ'' = −Γ (1 − s) cos φ,   φ(0) = 0,   φ'(1) = 0.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_simpson, solve_bvp


def heavy_elastica(gamma: float, points: int = 20001) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return s, and how far the strip reaches and drops there, in units of its length."""
    s, y = np.linspace(0, 1, 201), np.zeros((2, 201))
    for load in np.geomspace(min(gamma, 1.0), gamma, 6):
        solution = solve_bvp(
            lambda s, y, load=load: [y[1], -load * (1 - s) * np.cos(y[0])],
            lambda start, end: [start[0], end[1]],
            s,
            y,
            tol=1e-9,
            max_nodes=100_000,
        )
        if not solution.success:
            raise ValueError(f"the heavy elastica at gamma = {load:g}: {solution.message}")
        s, y = solution.x, solution.y
    s = np.linspace(0, 1, points)
    angle = solution.sol(s)[0]
    reach, drop = (cumulative_simpson(f(angle), x=s, initial=0) for f in (np.cos, np.sin))
    return s, reach, drop
