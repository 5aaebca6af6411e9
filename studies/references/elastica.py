"""The heavy elastica: a strip clamped level at one end, bent down by its own weight.

With s along the strip in units of its length L, φ(s) the angle below the horizontal and
Γ = ρ g L³/B, the balance of moments of the inextensible strip gives

    φ'' = −Γ (1 − s) λ cos φ,   φ(0) = 0,   φ'(1) = 0,

with the stretch λ = 1. A strip that stretches by Y E λ, E = (λ² − 1)/2, has λ E = Λ (1 − s) sin φ
with Λ = ρ g L/Y; s and the energy of bending B φ'²/2 refer to its length at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.integrate import cumulative_simpson, solve_bvp


def stretch(s: np.ndarray, angle: np.ndarray, softness: float) -> np.ndarray:
    """Return λ at s, where the strip has the angle φ; `softness` is Λ."""
    tension, found = softness * (1 - s) * np.sin(angle), np.ones_like(s)
    for _ in range(6 if softness else 0):  # Newton's iteration for λ (λ² − 1)/2 = tension
        found -= (found * (found**2 - 1) / 2 - tension) / ((3 * found**2 - 1) / 2)
    return found


@cache
def heavy_angle(gamma: float, softness: float = 0.0) -> Callable[[np.ndarray], np.ndarray]:
    """Return (φ, φ') (2, k) as a function of s (k,); `gamma` is Γ, and `softness` Λ."""
    s, y = np.linspace(0, 1, 201), np.zeros((2, 201))
    for load in np.geomspace(min(gamma, 1.0), gamma, 6):
        solution = solve_bvp(
            lambda s, y, load=load: [
                y[1],
                -load * (1 - s) * stretch(s, y[0], softness) * np.cos(y[0]),
            ],
            lambda start, end: [start[0], end[1]],
            s,
            y,
            tol=1e-9,
            max_nodes=100_000,
        )
        if not solution.success:
            raise ValueError(f"the heavy elastica at gamma = {load:g}: {solution.message}")
        s, y = solution.x, solution.y
    return solution.sol


def heavy_elastica(
    gamma: float, points: int = 20001, softness: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return s, and how far the strip reaches and drops there, in units of its length.

    `gamma` is Γ, and `softness` Λ.
    """
    s = np.linspace(0, 1, points)
    angle = heavy_angle(gamma, softness)(s)[0]
    parts = (stretch(s, angle, softness) * f(angle) for f in (np.cos, np.sin))
    reach, drop = (cumulative_simpson(part, x=s, initial=0) for part in parts)
    return s, reach, drop
