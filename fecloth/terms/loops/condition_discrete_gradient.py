"""Conditions over a step: a discrete gradient of C, whose work is the change of the energy.

From positions y₀ of a stencil to y₁ = 2y − y₀, with d = y₁ − y₀ and C₀, C₁ at the two ends,

    f_a = −ḡ_a k_s C̄,   C̄ = ½ (C₀ + C₁),   ḡ = ∂C(y) + (N/s) u,   N = C₁ − C₀ − ∂C(y) · d

where u is d without its rigid part, d_a − d̄ − ω × p_a with p = y − ȳ and Θω = Σ p_a × d_a for the
tensor Θ = Σ |p_a|² I − p_a p_aᵀ, and s = u · u = u · d. Then ḡ · d = C₁ − C₀, so that the work
−f · d is ½ C₁ᵀk_s C₁ − ½ C₀ᵀk_s C₀, and ḡ has no resultant and no moment about y, as ∂C(y) has none
for a C that no rigid motion changes: energy and both momenta are conserved at any step (Gonzalez
1996, Time Integration and Discrete Hamiltonian Systems, J. Nonlinear Sci. 6; here the correction
does not rotate the stencil). Springs have a closed form of it, `terms.springs.springs`.

    −∂f_a/∂y_b = ḡ_a k_s ∂C(y₁)_bᵀ + Σ_r (k_s C̄)_r ∂ḡ_r,a/∂y_b         not symmetric

The symmetric tangent takes ∂C(y) on both sides and ∂²C(y), if `definite` as in `condition`. Where
u is shorter than 1e-8 of the stencil N is left out. Its work is of the order of φ²|u| if the step
turns by φ, but the force jumps there, by the order of φ² k_s C̄.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fecloth.compiled.jit import Array, Zeros, inner, specialise
from fecloth.terms.loops.condition import gather
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


SHORT = 1e-16  # of s, relative to Σ |p|²


def condition(y: Array, c: Array, order: int, C: Array, g: Array, H: Array) -> None:
    """Fill C, g and H; `kernels` puts a family in its place (see `condition`)."""
    raise NotImplementedError


@inner
def gradient_defect(per_node: Zeros, g: Array, d: Array, change: float) -> float:
    """N = C₁ − C₀ − g · d, with C₁ − C₀ = `change`."""
    for a in range(len(per_node)):
        change -= g[a, 0] * d[a, 0] + g[a, 1] * d[a, 1] + g[a, 2] * d[a, 2]
    return change


@inner
def gather_over_step(
    per_node: Zeros, nodes: Array, e: int, start: Array, x: Array, y0: Array, y: Array, y1: Array,
    d: Array,
) -> None:  # fmt: skip
    """y₀, y, y₁ = 2y − y₀ and d = y₁ − y₀ of a stencil."""
    gather(per_node, nodes, e, start, y0)
    gather(per_node, nodes, e, x, y)
    for a in range(len(per_node)):
        for i in range(3):
            y1[a, i] = 2.0 * y[a, i] - y0[a, i]
            d[a, i] = y1[a, i] - y0[a, i]


def add_force(
    per_node: Zeros, convex: Zeros, nodes: Array, c: Array, ks: Array, start: Array, x: Array,
    f: Array,
) -> None:  # fmt: skip
    """f_a −= ḡ_a k_s C̄."""
    k, n = len(per_node), len(convex)
    y0, y, y1, d = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    p, u, g = np.empty((k, 3)), np.empty((k, 3)), np.empty((n, k, 3))
    C0, C, C1, H = np.empty(n), np.empty(n), np.empty(n), np.empty((0, 0, 0, 0, 0))
    for e in range(len(nodes)):
        gather_over_step(per_node, nodes, e, start, x, y0, y, y1, d)
        condition(y0, c[e], 0, C0, g, H)
        condition(y1, c[e], 0, C1, g, H)
        condition(y, c[e], 1, C, g, H)
        total = subtract_mean(per_node, y, p)
        _, s = remove_rigid_part(per_node, p, d, inverse_inertia(per_node, p, total), u)
        for r in range(n):
            N = gradient_defect(per_node, g[r], d, C1[r] - C0[r])
            factor = N / s if s > SHORT * total else 0.0
            tension = 0.0
            for q in range(n):
                tension += 0.5 * ks[e, r, q] * (C0[q] + C1[q])
            for a in range(k):
                i = np.uintp(nodes[e, a])
                for j in range(3):
                    f[i, j] -= tension * (g[r, a, j] + factor * u[a, j])


def add_tangent(
    per_node: Zeros, convex: Zeros, nodes: Array, slots: Array, c: Array, ks: Array, start: Array,
    x: Array, scale: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += scale (ḡ_a k_s ∂C(y₁)_bᵀ + Σ_r (k_s C̄)_r ∂ḡ_r,a/∂y_b)."""
    k, n = len(per_node), len(convex)
    y0, y, y1, d = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    p, u, du = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    g, g1, H = np.empty((n, k, 3)), np.empty((n, k, 3)), np.empty((n, k, 3, k, 3))
    C0, C, C1, N, tension = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for e in range(len(nodes)):
        gather_over_step(per_node, nodes, e, start, x, y0, y, y1, d)
        condition(y0, c[e], 0, C0, g, H)
        condition(y1, c[e], 1, C1, g1, H)
        condition(y, c[e], 2, C, g, H)
        total = subtract_mean(per_node, y, p)
        inverse = inverse_inertia(per_node, p, total)
        omega, s = remove_rigid_part(per_node, p, d, inverse, u)
        corrected = s > SHORT * total
        for r in range(n):
            N[r] = gradient_defect(per_node, g[r], d, C1[r] - C0[r])
            tension[r] = 0.0
            for q in range(n):
                tension[r] += 0.5 * scale * ks[e, r, q] * (C0[q] + C1[q])
        for b in range(k):
            for j in range(3):
                ds = 0.0
                if corrected:
                    differentiate_deformation(per_node, p, d, omega, inverse, b, j, du)
                    for a in range(k):
                        for i in range(3):
                            ds += 2.0 * u[a, i] * du[a, i]
                for r in range(n):
                    T, dN = 0.0, 2.0 * (g1[r, b, j] - g[r, b, j])
                    for q in range(n):
                        T += scale * ks[e, r, q] * g1[q, b, j]
                    for a in range(k):
                        for i in range(3):
                            dN -= H[r, a, i, b, j] * d[a, i]
                    for a in range(k):
                        slot = np.uintp(slots[e, a, b])
                        for i in range(3):
                            gradient, change = g[r, a, i], H[r, a, i, b, j]
                            if corrected:
                                gradient += N[r] / s * u[a, i]
                                change += (dN - N[r] * ds / s) / s * u[a, i]
                                change += N[r] / s * du[a, i]
                            J[slot, i, j] += gradient * T + tension[r] * change


def add_symmetric_tangent(
    per_node: Zeros, convex: Zeros, nodes: Array, slots: Array, c: Array, ks: Array, start: Array,
    x: Array, scale: float, definite: bool, J: Array,
) -> None:  # fmt: skip
    """J_ab += scale (∂C_a k_s ∂C_bᵀ + Σ_r (k_s C̄)_r ∂²C_r,ab) at y, or its definite part."""
    k, n = len(per_node), len(convex)
    y0, y, y1, d = np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3)), np.empty((k, 3))
    g, H = np.empty((n, k, 3)), np.empty((n, k, 3, k, 3))
    C0, C, C1 = np.empty(n), np.empty(n), np.empty(n)
    for e in range(len(nodes)):
        gather_over_step(per_node, nodes, e, start, x, y0, y, y1, d)
        condition(y0, c[e], 0, C0, g, H)
        condition(y1, c[e], 0, C1, g, H)
        condition(y, c[e], 2, C, g, H)
        for r in range(n):
            tension = 0.0
            for q in range(n):
                tension += 0.5 * scale * ks[e, r, q] * (C0[q] + C1[q])
            if definite and (convex[r] == 0 or tension < 0.0):
                tension = 0.0
            for b in range(k):
                for j in range(3):
                    T = 0.0
                    for q in range(n):
                        T += scale * ks[e, r, q] * g[q, b, j]
                    for a in range(k):
                        slot = np.uintp(slots[e, a, b])
                        for i in range(3):
                            J[slot, i, j] += g[r, a, i] * T + tension * H[r, a, i, b, j]


class DiscreteGradientKernels(NamedTuple):
    """The entry points of a family over a step, each a template above compiled with the family."""

    add_force: Callable[..., None]
    add_tangent: Callable[..., None]
    add_symmetric_tangent: Callable[..., None]


def kernels(condition: Callable[..., Any]) -> DiscreteGradientKernels:
    """Compile the entry points of a family over a step."""
    templates = add_force, add_tangent, add_symmetric_tangent
    return DiscreteGradientKernels(*(specialise(each, condition=condition) for each in templates))
