"""A measure of the dihedral angle that grows without bound towards a full fold.

    μ(θ) = θ                              for |θ| ≤ π/2
    μ(θ) = ±(π/2 + tan(|θ| − π/2))        beyond, with the sign of θ

It has two continuous derivatives. The angle itself jumps from π to −π where two triangles pass
through each other; the measure makes that fold infinitely stiff. In a march the fold stays open as
long as no step carries a node further than the gap that is left; only contact stops a longer step.
The page fecloth/terms/bending/README.md compares it with the other candidate, 2 tan(θ/2).
"""

import math

import numpy as np

from fecloth.compiled.jit import inner

RIGHT_ANGLE = 0.5 * math.pi


def _measure(theta):
    """μ, dμ/dθ and d²μ/dθ² at θ in (−π, π]."""
    if abs(theta) <= RIGHT_ANGLE:
        return theta, 1.0, 0.0
    sign = math.copysign(1.0, theta)
    t = math.tan(abs(theta) - RIGHT_ANGLE)
    slope = 1.0 + t * t
    return sign * (RIGHT_ANGLE + t), slope, sign * 2.0 * t * slope


measure = inner(_measure)


def fold_measure(theta: np.ndarray) -> np.ndarray:
    """μ of angles [rad]."""
    out, folded = theta.copy(), np.abs(theta) > RIGHT_ANGLE
    out[folded] = [_measure(angle)[0] for angle in theta[folded]]
    return out
