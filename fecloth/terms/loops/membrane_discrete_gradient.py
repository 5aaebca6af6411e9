"""Membranes over a step: a stress whose work is the change of the energy.

From positions x₀ to x₁ = 2x − x₀, with F at x, F₁ at x₁, E₀ and E₁ at the two ends,
Ē = ½ (E₀ + E₁) and e = E₁ − E₀,

    f_a  = −Σ w F S̄ G_a
    K_ab = −∂f_a/∂x_b = Σ w (B_a(F)ᵀ (2 ∂S̄/∂E₁) B_b(F₁) + (G_a · S̄ G_b) I₃)

E is quadratic in x, so e = B(F)(x₁ − x₀) without error, and the work −f · (x₁ − x₀) is Σ w S̄ : e.
It equals Σ w (W₁ − W₀), whatever the step, for two choices of S̄:

The average, for a law with W quadratic in E (Simo and Tarnow 1992, The Discrete Energy–Momentum
Method, ZAMP 43):

    S̄ = ½ (S(E₀) + S(E₁)) = S(Ē),   2 ∂S̄/∂E₁ = ℂ

The quotient, for any law (Gonzalez 2000, Exact Energy and Momentum Conserving Algorithms for
General Models in Nonlinear Elasticity, Comput. Methods Appl. Mech. Engrg. 190):

    S̄ = S(Ē) + β e,   β = (W₁ − W₀ − S(Ē) : e) / (e : e)
    2 ∂S̄/∂E₁ = ℂ(Ē) + 2 e ⊗ (S₁ − S(Ē) − ½ ℂ(Ē) : e − 2 β e) / (e : e) + 2 β I

For W quadratic in E β is zero. Below |e| = 1e-6, β e is of the order of round-off and left out.
K is not symmetric, as B is taken at two places.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fecloth.compiled.bodies import insert_bodies
from fecloth.compiled.jit import Array, Zeros, inner, specialise
from fecloth.terms.loops.green_strain import (
    Rows,
    Six,
    Three,
    clamp,
    contract,
    double_contraction,
    gradient,
    green_strain,
    material_block,
    material_rows,
    scatter_force,
    scatter_mixed,
    scatter_symmetric,
)

SMALL = 1e-12  # e : e


def law(E: Three, c: Array) -> tuple[float, Three, Six]:
    """Return W, S and ℂ; `kernels` puts a law in its place (see `membrane_loops`)."""
    raise NotImplementedError


def mean_stress(E0: Three, E1: Three, c: Array) -> Three:
    """Return S̄; `kernels` puts `average_stress` or `quotient_stress` in its place."""
    raise NotImplementedError


@inner
def end_gradient(F: Six, F0: Six) -> Six:
    """F₁ = 2F − F₀."""
    return (
        2.0 * F[0] - F0[0],
        2.0 * F[1] - F0[1],
        2.0 * F[2] - F0[2],
        2.0 * F[3] - F0[3],
        2.0 * F[4] - F0[4],
        2.0 * F[5] - F0[5],
    )


@inner
def mean(E0: Three, E1: Three) -> Three:
    """½ (E₀ + E₁)."""
    return 0.5 * (E0[0] + E1[0]), 0.5 * (E0[1] + E1[1]), 0.5 * (E0[2] + E1[2])


@inner
def mean_strain(F0: Six, F1: Six) -> Three:
    """½ (E₀ + E₁) from the deformation gradients."""
    return mean(green_strain(F0), green_strain(F1))


@inner
def strain_increment(E0: Three, E1: Three) -> Three:
    """e = E₁ − E₀."""
    return E1[0] - E0[0], E1[1] - E0[1], E1[2] - E0[2]


@inner
def quotient(energy_change: float, S: Three, e: Three) -> float:
    """β for W₁ − W₀ = `energy_change`."""
    square = double_contraction(e, e)
    return (energy_change - double_contraction(S, e)) / square if square > SMALL else 0.0


@inner
def add_multiple(S: Three, beta: float, e: Three) -> Three:
    """S + β e."""
    return S[0] + beta * e[0], S[1] + beta * e[1], S[2] + beta * e[2]


@inner
def quotient_derivative(S1: Three, S: Three, C: Six, beta: float, e: Three) -> Three:
    """2 (S₁ − S(Ē) − ½ ℂ : e − 2 β e) / (e : e)."""
    square, D = double_contraction(e, e), contract(C, e)
    if square <= SMALL:
        return 0.0, 0.0, 0.0
    return (
        2.0 * (S1[0] - S[0] - 0.5 * D[0] - 2.0 * beta * e[0]) / square,
        2.0 * (S1[1] - S[1] - 0.5 * D[1] - 2.0 * beta * e[1]) / square,
        2.0 * (S1[2] - S[2] - 0.5 * D[2] - 2.0 * beta * e[2]) / square,
    )


@inner
def add_dyad_rows(T: Rows, F: Six, G1: float, G2: float, e: Three, z: Three) -> Rows:
    """T + z ⊗ (e : B_a), for the part e ⊗ z of the moduli."""
    p, r = e[0] * G1 + e[2] * G2, e[2] * G1 + e[1] * G2
    h = (p * F[0] + r * F[3], p * F[1] + r * F[4], p * F[2] + r * F[5])
    T1, T2, T3 = T
    return (
        (T1[0] + z[0] * h[0], T1[1] + z[0] * h[1], T1[2] + z[0] * h[2]),
        (T2[0] + z[1] * h[0], T2[1] + z[1] * h[1], T2[2] + z[1] * h[2]),
        (T3[0] + z[2] * h[0], T3[1] + z[2] * h[1], T3[2] + z[2] * h[2]),
    )


def average_stress(E0: Three, E1: Three, c: Array) -> Three:
    """S̄ as the average."""
    _, S, _ = law(mean(E0, E1), c)
    return S


def quotient_stress(E0: Three, E1: Three, c: Array) -> Three:
    """S̄ as the quotient."""
    W0, _, _ = law(E0, c)
    W1, _, _ = law(E1, c)
    _, S, _ = law(mean(E0, E1), c)
    d = strain_increment(E0, E1)
    return add_multiple(S, quotient(W1 - W0, S, d), d)


def add_force(
    per_node: Zeros, per_point: Zeros, nodes: Array, G: Array, w: Array, c: Array, start: Array,
    x: Array, f: Array,
) -> None:  # fmt: skip
    """f_a −= Σ w F S̄ G_a; the body of one of the two functions above stands for `mean_stress`."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F0, F = gradient(per_node, nodes, G, e, q, start), gradient(per_node, nodes, G, e, q, x)
            E0, E1 = green_strain(F0), green_strain(end_gradient(F, F0))
            S = mean_stress(E0, E1, c[e])
            scatter_force(per_node, nodes, G, e, q, w[e, q], F, S, f)


def add_average_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, G: Array, w: Array, c: Array,
    start: Array, x: Array, scale: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += scale · Σ w (B_a(F)ᵀ ℂ B_b(F₁) + (G_a · S̄ G_b) I₃) with the average S̄."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F0, F = gradient(per_node, nodes, G, e, q, start), gradient(per_node, nodes, G, e, q, x)
            F1 = end_gradient(F, F0)
            _, S, C = law(mean_strain(F0, F1), c[e])
            scatter_mixed(per_node, slots, G, e, q, scale * w[e, q], F, F1, S, C, J)


def add_quotient_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, G: Array, w: Array, c: Array,
    start: Array, x: Array, scale: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += scale · Σ w (B_a(F)ᵀ (2 ∂S̄/∂E₁) B_b(F₁) + (G_a · S̄ G_b) I₃), quotient's S̄."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F0, F = gradient(per_node, nodes, G, e, q, start), gradient(per_node, nodes, G, e, q, x)
            F1 = end_gradient(F, F0)
            E0, E1 = green_strain(F0), green_strain(F1)
            W0, _, _ = law(E0, c[e])
            W1, S1, _ = law(E1, c[e])
            _, S, C = law(mean(E0, E1), c[e])
            d, W = strain_increment(E0, E1), scale * w[e, q]
            beta = quotient(W1 - W0, S, d)
            z = quotient_derivative(S1, S, C, beta, d)
            S, z = add_multiple(S, beta, d), (W * z[0], W * z[1], W * z[2])
            normal = 2.0 * beta  # of 2 β I on E11 and E22; β on the engineering shear
            C = (
                W * (C[0] + normal),
                W * (C[1] + normal),
                W * (C[2] + beta),
                W * C[3],
                W * C[4],
                W * C[5],
            )
            for a in range(len(per_node)):
                G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
                T = add_dyad_rows(material_rows(C, F, G1, G2), F, G1, G2, d, z)
                g1, g2 = W * (S[0] * G1 + S[2] * G2), W * (S[2] * G1 + S[1] * G2)
                for b in range(len(per_node)):
                    H1, H2 = G[e, q, b, 0], G[e, q, b, 1]
                    M = material_block(T, F1, H1, H2)
                    s = np.uintp(slots[e, a, b])
                    for i in range(3):
                        J[s, i, i] += g1 * H1 + g2 * H2
                        for j in range(3):
                            J[s, i, j] += M[i][j]


def add_symmetric_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, G: Array, w: Array, c: Array,
    start: Array, x: Array, scale: float, floor: float, J: Array,
) -> None:  # fmt: skip
    """J += scale · Σ w (B_a(F)ᵀ ℂ B_b(F) + (G_a · S(Ē) G_b) I₃), S(Ē) clamped at `floor`."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F0, F = gradient(per_node, nodes, G, e, q, start), gradient(per_node, nodes, G, e, q, x)
            _, S, C = law(mean_strain(F0, end_gradient(F, F0)), c[e])
            scatter_symmetric(per_node, slots, G, e, q, scale * w[e, q], F, clamp(S, floor), C, J)


class DiscreteGradientKernels(NamedTuple):
    """The entry points of a law over a step, each a template above compiled with the law."""

    add_force: Callable[..., None]
    add_tangent: Callable[..., None]
    add_symmetric_tangent: Callable[..., None]
    add_definite_tangent: Callable[..., None]


def kernels(
    law: Callable[..., Any], definite_law: Callable[..., Any], is_quadratic: bool
) -> DiscreteGradientKernels:
    """Compile the entry points of a law over a step (see `membrane_loops.kernels`)."""
    stress, tangent = quotient_stress, add_quotient_tangent
    if is_quadratic:
        stress, tangent = average_stress, add_average_tangent
    return DiscreteGradientKernels(
        specialise(insert_bodies(add_force, {"mean_stress": stress}), law=law),
        specialise(tangent, law=law),
        specialise(add_symmetric_tangent, law=law),
        specialise(add_symmetric_tangent, law=definite_law),
    )
