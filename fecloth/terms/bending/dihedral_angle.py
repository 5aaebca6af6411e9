"""Dihedral angle of a hinge, its gradient and its Hessian.

The edge is e = x₁ − x₀, and the arms are a = x₂ − x₀ to the left and b = x₃ − x₀ to the right.
In the left triangle ê, m = n̂ × ê and the normal n̂ = e × a/|e × a| are a right-handed frame,
and a = s e + h m with the height h. In the right triangle b = s e + h m with n̂ = b × e/|b × e|
and m = ê × n̂. Then

    θ = atan2(ê · (n̂_b × n̂_a), n̂_a · n̂_b)
    ∂θ/∂a = n̂_a / h_a,   ∂θ/∂b = n̂_b / h_b,   ∂θ/∂e = −s_a ∂θ/∂a − s_b ∂θ/∂b

θ is positive where the cloth rises from the edge on both sides. The gradient is as in Bridson,
Marino and Fedkiw (2003), Simulation of Clothing with Folds and Wrinkles, section 4, up to its
scale. The second derivatives follow, with A = −(n̂ mᵀ + m n̂ᵀ)/h² in either triangle and g =
∂θ/∂a or ∂θ/∂b there. They are the derivatives of Tamstorf and Grinspun (2013), Discrete bending
forces and their Jacobians, in another basis:

    ∂²θ/∂a²   = A_a,       ∂²θ/∂b² = A_b,       ∂²θ/∂a∂b = 0
    ∂²θ/∂a∂e  = −s A − ê gᵀ/|e|                                            likewise for b
    ∂²θ/∂e²   = Σ [s² A + s (g êᵀ + ê gᵀ)/|e| − n̂ mᵀ/|e|²]
"""

import math

import numpy as np

from fecloth.compiled.jit import inner, kernel

RIGHT_ANGLE = 0.5 * math.pi


@inner
def cross(p, q):
    """p × q."""
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@inner
def dot(p, q):
    """p · q."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@inner
def multiply(factor, p):
    """factor · p."""
    return factor * p[0], factor * p[1], factor * p[2]


@inner
def arms(y):
    """e, a, b of the positions y (4, 3) of a hinge."""
    x0, x1, x2 = y[0, 0], y[0, 1], y[0, 2]
    e = (y[1, 0] - x0, y[1, 1] - x1, y[1, 2] - x2)
    a = (y[2, 0] - x0, y[2, 1] - x1, y[2, 2] - x2)
    b = (y[3, 0] - x0, y[3, 1] - x1, y[3, 2] - x2)
    return e, a, b


@inner
def angle(e, a, b):
    """θ in (−π, π]."""
    left = cross(e, a)
    right = cross(b, e)
    return math.atan2(dot(e, cross(right, left)) / math.sqrt(dot(e, e)), dot(left, right))


@inner
def side(e, arm, normal):
    """Foot s, height h, and p = n̂/h of a triangle; `normal` is e × arm or arm × e."""
    square = dot(e, e)
    twice = dot(normal, normal)
    return (
        dot(e, arm) / square,
        math.sqrt(twice / square),
        multiply(math.sqrt(square) / twice, normal),
    )


@inner
def gradient(left, right, g):
    """g (4, 3) = ∂θ/∂x; p is ∂θ/∂a or ∂θ/∂b."""
    (sa, _, pa), (sb, _, pb) = left, right
    for i in range(3):
        g[0, i] = -(1.0 - sa) * pa[i] - (1.0 - sb) * pb[i]
        g[1, i] = -sa * pa[i] - sb * pb[i]
        g[2, i] = pa[i]
        g[3, i] = pb[i]


@inner
def add_side(arm, s, p, q, u, t, H):
    """Add the part of one triangle to H (4, 3, 4, 3) = ∂²θ/∂x∂x.

    Its arm leads to the node number `arm` of the hinge, 2 or 3, and its foot on the edge is s.
    p = n̂/h, q = m/h, u = ê/|e| and t = h/|e|, so that A = −(p qᵀ + q pᵀ), ê gᵀ/|e| = u pᵀ and
    n̂ mᵀ/|e|² = t² p qᵀ.
    """
    for i in range(3):
        for j in range(3):
            pq = p[i] * q[j]
            A = -pq - q[i] * p[j]
            up = u[i] * p[j]
            pu = p[i] * u[j]
            ae = -s * A - up  # ∂²θ/∂a∂e
            ea = -s * A - pu
            ee = s * (s * A + up + pu) - t * t * pq
            # e and the arm begin at node 0, so that ∂/∂x₀ = −∂/∂a − ∂/∂e. The rows and columns
            # of the arm have no other part; those of the edge have a part of each triangle.
            H[1, i, 1, j] += ee
            H[arm, i, arm, j] = A
            H[arm, i, 1, j] = ae
            H[1, i, arm, j] = ea
            H[arm, i, 0, j] = -A - ae
            H[0, i, arm, j] = -A - ea
            H[1, i, 0, j] -= ee + ea
            H[0, i, 1, j] -= ee + ae
            H[0, i, 0, j] += A + ae + ea + ee


@inner
def hessian(e, left, right, H):
    """Fill H (4, 3, 4, 3) = ∂²θ/∂x∂x; `left` and `right` are what `side` returns."""
    (sa, ha, pa), (sb, hb, pb) = left, right
    length = math.sqrt(dot(e, e))
    unit = multiply(1.0 / length, e)
    u = multiply(1.0 / length, unit)
    for i in range(3):
        for j in range(3):
            H[2, i, 3, j] = H[3, i, 2, j] = 0.0
            H[0, i, 0, j] = H[0, i, 1, j] = H[1, i, 0, j] = H[1, i, 1, j] = 0.0
    # Node 2. For a literal 2 the compiler would make another `add_side`, beside the one for 3.
    arm = len(H) - 2
    add_side(arm, sa, pa, cross(pa, unit), u, ha / length, H)
    add_side(arm + 1, sb, pb, cross(unit, pb), u, hb / length, H)


@inner
def condition(y, c, order, C, g, H):
    """Fill C = θ − θ₀, and g (1, 4, 3) and H (1, 4, 3, 4, 3), its derivatives, up to `order`.

    y (4, 3) are the positions of the hinge's nodes, and c = (θ₀,). The form is that of
    `fecloth.terms.loops.condition`.
    """
    e, a, b = arms(y)
    C[0] = angle(e, a, b) - c[0]
    if order > 0:
        left = side(e, a, cross(e, a))
        right = side(e, b, cross(b, e))
        gradient(left, right, g[0])
        if order > 1:
            hessian(e, left, right, H[0])


@kernel
def angles(nodes, x, out):
    """out (h,) = θ of the hinges with `nodes` (h, 4) at positions x (n, 3)."""
    y = np.empty((4, 3))
    for e in range(len(nodes)):
        for a in range(4):
            for i in range(3):
                y[a, i] = x[nodes[e, a], i]
        out[e] = angle(*arms(y))


def _measure(theta):
    """μ, dμ/dθ and d²μ/dθ² at θ in (−π, π]; see `fold_measure`."""
    if abs(theta) <= RIGHT_ANGLE:
        return theta, 1.0, 0.0
    sign = math.copysign(1.0, theta)
    t = math.tan(abs(theta) - RIGHT_ANGLE)
    slope = 1.0 + t * t
    return sign * (RIGHT_ANGLE + t), slope, sign * 2.0 * t * slope


measure = inner(_measure)


def fold_measure(theta: np.ndarray) -> np.ndarray:
    """Return a measure of dihedral angles [rad] that grows without bound towards a full fold.

        μ(θ) = θ                              for |θ| ≤ π/2
        μ(θ) = ±(π/2 + tan(|θ| − π/2))        beyond, with the sign of θ

    It has two continuous derivatives. The angle itself jumps from π to −π where two triangles
    pass through each other; the measure makes that fold infinitely stiff. In a march the fold
    stays open as long as no step carries a node further than the gap that is left; only
    contact stops a longer step. fecloth/terms/bending/README.md compares it with the other
    candidate, 2 tan(θ/2).
    """
    out = theta.copy()
    folded = np.abs(theta) > RIGHT_ANGLE
    out[folded] = [_measure(angle)[0] for angle in theta[folded]]
    return out
