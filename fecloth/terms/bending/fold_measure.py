"""A measure of the dihedral angle that grows without bound towards a full fold.

    μ(θ) = θ                              for |θ| ≤ π/2
    μ(θ) = ±(π/2 + tan(|θ| − π/2))        beyond, with the sign of θ

It has two continuous derivatives. The angle itself jumps from π to −π where two triangles pass
through each other; the measure makes that fold infinitely stiff.
"""

from __future__ import annotations

import math

import numpy as np

from fecloth.jit import inner, kernel

RIGHT_ANGLE = 0.5 * math.pi


@inner
def measure(theta):
    """μ, dμ/dθ and d²μ/dθ² at θ in (−π, π]."""
    if abs(theta) <= RIGHT_ANGLE:
        return theta, 1.0, 0.0
    sign = math.copysign(1.0, theta)
    t = math.tan(abs(theta) - RIGHT_ANGLE)
    slope = 1.0 + t * t
    return sign * (RIGHT_ANGLE + t), slope, sign * 2.0 * t * slope


@kernel
def measures(theta, out):
    """out = μ(θ), for arrays."""
    for e in range(len(theta)):
        out[e] = measure(theta[e])[0]


def fold_measure(theta: np.ndarray) -> np.ndarray:
    """μ of angles [rad]."""
    out = np.empty_like(theta)
    measures(theta, out)
    return out
