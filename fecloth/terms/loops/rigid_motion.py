"""Motion d of a stencil's nodes without its rigid part, and the derivative of that by y.

    u_a = d_a − d̄ − ω × p_a,   p = y − ȳ,   Θω = Σ p_a × d_a,   Θ = Σ |p_a|² I − p_a p_aᵀ

For `condition_discrete_gradient`, where d = 2 (y − y₀). `per_node` is a tuple with one zero for
each node.
"""

from __future__ import annotations

from fecloth.compiled.jit import Array, Zeros, inner
from fecloth.terms.loops.green_strain import Six, Three


@inner
def subtract_mean(per_node: Zeros, y: Array, p: Array) -> float:
    """p_a = y_a − ȳ; return Σ |p|²."""
    total = 0.0
    for i in range(3):
        mean = 0.0
        for a in range(len(per_node)):
            mean += y[a, i] / len(per_node)
        for a in range(len(per_node)):
            p[a, i] = y[a, i] - mean
            total += p[a, i] * p[a, i]
    return total


@inner
def inverse_inertia(per_node: Zeros, p: Array, total: float) -> Six:
    """Θ⁻¹ = (11, 22, 33, 12, 13, 23); for two nodes without p pᵀ, as ω ⟂ p."""
    if len(per_node) == 2:
        inverse = 1.0 / total if total > 0.0 else 0.0  # a spring of no length has no rotation
        return inverse, inverse, inverse, 0.0, 0.0, 0.0
    a11, a22, a33, a12, a13, a23 = total, total, total, 0.0, 0.0, 0.0
    for a in range(len(per_node)):
        a11 -= p[a, 0] * p[a, 0]
        a22 -= p[a, 1] * p[a, 1]
        a33 -= p[a, 2] * p[a, 2]
        a12 -= p[a, 0] * p[a, 1]
        a13 -= p[a, 0] * p[a, 2]
        a23 -= p[a, 1] * p[a, 2]
    b11, b12, b13 = a22 * a33 - a23 * a23, a13 * a23 - a12 * a33, a12 * a23 - a13 * a22
    det = a11 * b11 + a12 * b12 + a13 * b13
    b22, b33, b23 = a11 * a33 - a13 * a13, a11 * a22 - a12 * a12, a12 * a13 - a11 * a23
    return b11 / det, b22 / det, b33 / det, b12 / det, b13 / det, b23 / det


@inner
def multiply_symmetric(A: Six, b: Three) -> Three:
    """A b for a symmetric A = (11, 22, 33, 12, 13, 23)."""
    return (
        A[0] * b[0] + A[3] * b[1] + A[4] * b[2],
        A[3] * b[0] + A[1] * b[1] + A[5] * b[2],
        A[4] * b[0] + A[5] * b[1] + A[2] * b[2],
    )


@inner
def cross(a: Three, b: Three) -> Three:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner
def remove_rigid_part(
    per_node: Zeros, p: Array, d: Array, inverse: Six, u: Array
) -> tuple[Three, float]:
    """u_a = d_a − d̄ − ω × p_a; return ω and s = u · u."""
    L1 = L2 = L3 = 0.0
    for a in range(len(per_node)):
        moment = cross(p[a], d[a])
        L1, L2, L3 = L1 + moment[0], L2 + moment[1], L3 + moment[2]
    omega = multiply_symmetric(inverse, (L1, L2, L3))
    subtract_mean(per_node, d, u)
    s = 0.0
    for a in range(len(per_node)):
        rotation = cross(omega, p[a])
        for i in range(3):
            u[a, i] -= rotation[i]
            s += u[a, i] * u[a, i]
    return omega, s


@inner
def differentiate_deformation(
    per_node: Zeros, p: Array, d: Array, omega: Three, inverse: Six, b: int, j: int, du: Array
) -> None:
    """du = ∂u/∂y_bj, with L = Θω, ∂d = 2 ∂y and ∂ω = Θ⁻¹(∂L − ∂Θ ω)."""
    k = len(per_node)
    unit = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
    m1 = m2 = m3 = 0.0
    for a in range(k):
        m1, m2, m3 = m1 + d[a, 0] / k, m2 + d[a, 1] / k, m3 + d[a, 2] / k
    first = cross(unit, (d[b, 0] - m1, d[b, 1] - m2, d[b, 2] - m3))
    second = cross(p[b], unit)
    p_omega = p[b, 0] * omega[0] + p[b, 1] * omega[1] + p[b, 2] * omega[2] if k > 2 else 0.0
    omega_j = omega[j] if k > 2 else 0.0
    twice = 2.0 * p[b, j]
    d_omega = multiply_symmetric(
        inverse,
        (
            first[0] + 2.0 * second[0] - twice * omega[0] + unit[0] * p_omega + p[b, 0] * omega_j,
            first[1] + 2.0 * second[1] - twice * omega[1] + unit[1] * p_omega + p[b, 1] * omega_j,
            first[2] + 2.0 * second[2] - twice * omega[2] + unit[2] * p_omega + p[b, 2] * omega_j,
        ),
    )
    omega_unit = cross(omega, unit)
    for a in range(k):
        share = (1.0 if a == b else 0.0) - 1.0 / k
        d_rotation = cross(d_omega, p[a])
        for i in range(3):
            du[a, i] = share * (2.0 * unit[i] - omega_unit[i]) - d_rotation[i]
