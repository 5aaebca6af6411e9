"""Membranes of any law over a step: the stress whose work is the change of the energy.

With Ē = ½ (E₀ + E₁) and e = E₁ − E₀, in the notation of `averaged`,

    S̄ = S(Ē) + β e,   β = (W₁ − W₀ − S(Ē) : e) / (e : e)
    2 ∂S̄/∂E₁ = ℂ(Ē) + 2 e ⊗ (S₁ − S(Ē) − ½ ℂ(Ē) : e − 2 β e) / (e : e) + 2 β I

so that S̄ : e = W₁ − W₀ (Gonzalez 2000, Exact Energy and Momentum Conserving Algorithms for General
Models in Nonlinear Elasticity, Comput. Methods Appl. Mech. Engrg. 190). For a law quadratic in E
β is zero and S̄ is that of `averaged`. Below |e| = 1e-6, β e is of the order of round-off and left
out.
"""

from __future__ import annotations

import numpy as np

from fecloth.jit import inner, loop
from fecloth.terms.loops.green_strain import (
    block,
    gradient,
    green_strain,
    material_rows,
    scatter_force,
)
from fecloth.terms.loops.membrane import contract
from fecloth.terms.loops.membrane_discrete_gradient import extrapolated, half

SMALL = 1e-12  # e : e


@inner
def work(S, e):
    """S : e."""
    return S[0] * e[0] + S[1] * e[1] + 2.0 * S[2] * e[2]


@inner
def change(E0, E1):
    """e = E₁ − E₀."""
    return E1[0] - E0[0], E1[1] - E0[1], E1[2] - E0[2]


@inner
def missing(rise, S, e):
    """β for W₁ − W₀ = rise."""
    square = work(e, e)
    return (rise - work(S, e)) / square if square > SMALL else 0.0


@inner
def along(S, beta, e):
    """S + β e."""
    return S[0] + beta * e[0], S[1] + beta * e[1], S[2] + beta * e[2]


@inner
def turned(S1, S, C, beta, e):
    """2 (S₁ − S(Ē) − ½ ℂ : e − 2 β e) / (e : e)."""
    square, D = work(e, e), contract(C, e)
    if square <= SMALL:
        return 0.0, 0.0, 0.0
    return (
        2.0 * (S1[0] - S[0] - 0.5 * D[0] - 2.0 * beta * e[0]) / square,
        2.0 * (S1[1] - S[1] - 0.5 * D[1] - 2.0 * beta * e[1]) / square,
        2.0 * (S1[2] - S[2] - 0.5 * D[2] - 2.0 * beta * e[2]) / square,
    )


@inner
def skew_rows(T, F, G1, G2, e, z):
    """T + z ⊗ (e : B_a), for the part e ⊗ z of the moduli."""
    p, r = e[0] * G1 + e[2] * G2, e[2] * G1 + e[1] * G2
    h = (p * F[0] + r * F[3], p * F[1] + r * F[4], p * F[2] + r * F[5])
    T1, T2, T3 = T
    return (
        (T1[0] + z[0] * h[0], T1[1] + z[0] * h[1], T1[2] + z[0] * h[2]),
        (T2[0] + z[1] * h[0], T2[1] + z[1] * h[1], T2[2] + z[1] * h[2]),
        (T3[0] + z[2] * h[0], T3[1] + z[2] * h[1], T3[2] + z[2] * h[2]),
    )


@loop
def add_force(law, K, Q, nodes, G, w, c, start, x, f):
    """f_a −= Σ w F S̄ G_a."""
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F0, F = gradient(K, nodes, G, e, q, start), gradient(K, nodes, G, e, q, x)
            E0, E1 = green_strain(F0), green_strain(extrapolated(F, F0))
            W0, _, _ = law(E0, c[e])
            W1, _, _ = law(E1, c[e])
            _, S, _ = law(half(E0, E1), c[e])
            d = change(E0, E1)
            S = along(S, missing(W1 - W0, S, d), d)
            scatter_force(K, nodes, G, e, q, w[e, q], F, S, f)


@loop
def add_tangent(law, K, Q, nodes, slots, G, w, c, start, x, scale, J):
    """J_ab += scale · Σ w (B_a(F)ᵀ (2 ∂S̄/∂E₁) B_b(F₁) + (G_a · S̄ G_b) I₃)."""
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F0, F = gradient(K, nodes, G, e, q, start), gradient(K, nodes, G, e, q, x)
            F1 = extrapolated(F, F0)
            E0, E1 = green_strain(F0), green_strain(F1)
            W0, _, _ = law(E0, c[e])
            W1, S1, _ = law(E1, c[e])
            _, S, C = law(half(E0, E1), c[e])
            d, W = change(E0, E1), scale * w[e, q]
            beta = missing(W1 - W0, S, d)
            z = turned(S1, S, C, beta, d)
            S, z = along(S, beta, d), (W * z[0], W * z[1], W * z[2])
            more = 2.0 * beta
            C = (
                W * (C[0] + more),
                W * (C[1] + more),
                W * (C[2] + beta),
                W * C[3],
                W * C[4],
                W * C[5],
            )
            for a in range(len(K)):
                G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
                T = skew_rows(material_rows(C, F, G1, G2), F, G1, G2, d, z)
                g1, g2 = W * (S[0] * G1 + S[2] * G2), W * (S[2] * G1 + S[1] * G2)
                for b in range(len(K)):
                    H1, H2 = G[e, q, b, 0], G[e, q, b, 1]
                    M = block(T, F1, H1, H2)
                    s = np.uintp(slots[e, a, b])
                    for i in range(3):
                        J[s, i, i] += g1 * H1 + g2 * H2
                        for j in range(3):
                            J[s, i, j] += M[i][j]
