"""A measure of the dihedral angle that grows without bound towards a full fold.

    μ(θ) = θ                              for |θ| ≤ π/2
    μ(θ) = ±(π/2 + tan(|θ| − π/2))        beyond, with the sign of θ

It has two continuous derivatives. The angle itself jumps from π to −π where two triangles pass
through each other; the measure makes that fold infinitely stiff. In a march the fold stays open as
long as no step carries a node further than the gap that is left; only contact stops a longer step.

The other candidate, 2 tan(θ/2) for all angles, as in libshell's `MidedgeAngleTanFormulation`, keeps
folds open as well. Measured with each, P1 unless P2 is named, errors relative:

    =================================================  ================  ================
    problem                                            μ                 2 tan(θ/2)
    =================================================  ================  ================
    cylinder, 45° an edge, energy: right               0                 +0.10
    cross, equilateral, unstructured                   −.015 −.008 −.008 +.003 +.016 +.033
    heavy elastica, Γ = 10, n = 8, 16, 32: right       .018 .0045 .0011  .0014 −.0009 −.0004
    unstructured                                       .011 .0026 .0008  .0021 .0002 .0001
    cross                                              −.054 −.006 .0000 −.058 −.007 −.0003
    right, P2                                          .011 .0027 .0007  −.005 −.003 −.0009
    Γ = 1000, n = 16: right, unstructured              .28 .16           .03 −.009
    Newton iterations of a fold closed by 6 forces     189               158
    stiffness about a crease of 45°, 90° over flat's   1, 1              1.4, 4
    =================================================  ================  ================

2 tan(θ/2) is stiffer than the cloth and hides that a coarse mesh is too soft, so that errors cross
zero. μ has errors that fall with h², is exact for a cylinder on `right`, and bends about a curved
rest shape as about a flat one. Therefore it was chosen, at the cost of a fifth more iterations.
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
