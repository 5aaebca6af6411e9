"""Green strain at a quadrature point, and the nodal forces and blocks made of it.

In the notation of `membrane`: E and S in the order (11, 22, 12), ℂ as (C11, C22, C66, C12, C16,
C26), F as its columns (F11, F21, F31, F12, F22, F32), and B_a with δE = Σ B_a δx_a.
"""

import math

import numpy as np

from fecloth.compiled.jit import Array, Zeros, inner

Three = tuple[float, float, float]
"""The components 11, 22, 12 of a strain or stress, or a vector."""
Six = tuple[float, float, float, float, float, float]
"""F as its columns, or the moduli ℂ."""
Rows = tuple[Three, Three, Three]
"""The rows of a 3×3 matrix."""


@inner
def gradient(per_node: Zeros, nodes: Array, G: Array, e: int, q: int, y: Array) -> Six:
    """F = Σ y_a ⊗ G_a at point q of triangle e, as columns (F11, F21, F31, F12, F22, F32).

    y (n, 3) are positions, or other values at the nodes, and G (m, q, k, 2) the gradients of the
    shape functions [1/m].
    """
    F11 = F21 = F31 = F12 = F22 = F32 = 0.0
    for a in range(len(per_node)):
        i = np.uintp(nodes[e, a])
        G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
        F11 += y[i, 0] * G1
        F21 += y[i, 1] * G1
        F31 += y[i, 2] * G1
        F12 += y[i, 0] * G2
        F22 += y[i, 1] * G2
        F32 += y[i, 2] * G2
    return F11, F21, F31, F12, F22, F32


@inner
def green_strain(F: Six) -> Three:
    """E = (FᵀF − I)/2."""
    F11, F21, F31, F12, F22, F32 = F
    E11 = 0.5 * (F11 * F11 + F21 * F21 + F31 * F31 - 1.0)
    E22 = 0.5 * (F12 * F12 + F22 * F22 + F32 * F32 - 1.0)
    E12 = 0.5 * (F11 * F12 + F21 * F22 + F31 * F32)
    return E11, E22, E12


@inner
def contract(C: Six, E: Three) -> Three:
    """S = ℂ : E."""
    C11, C22, C66, C12, C16, C26 = C
    E11, E22, E12 = E
    S11 = C11 * E11 + C12 * E22 + C16 * 2.0 * E12
    S22 = C12 * E11 + C22 * E22 + C26 * 2.0 * E12
    S12 = C16 * E11 + C26 * E22 + C66 * 2.0 * E12
    return S11, S22, S12


@inner
def strain_rate(F: Six, H: Six) -> Three:
    """Ė = sym(FᵀḞ) with H = Ḟ."""
    F11, F21, F31, F12, F22, F32 = F
    H11, H21, H31, H12, H22, H32 = H
    R11 = F11 * H11 + F21 * H21 + F31 * H31
    R22 = F12 * H12 + F22 * H22 + F32 * H32
    R12 = F11 * H12 + F21 * H22 + F31 * H32 + F12 * H11 + F22 * H21 + F32 * H31
    return R11, R22, 0.5 * R12


@inner
def clamp(S: Three) -> Three:
    """Return S with negative principal values raised to zero: positive semi-definite."""
    S11, S22, S12 = S
    mean = 0.5 * (S11 + S22)
    half_difference = 0.5 * (S11 - S22)
    radius = math.sqrt(half_difference * half_difference + S12 * S12)
    if mean - radius >= 0.0:
        return S
    if mean + radius <= 0.0:
        return 0.0, 0.0, 0.0
    # only the smaller value s₂ = mean − radius is negative: S − s₂ n₂ ⊗ n₂
    # with n₁ at the angle θ, c = cos 2θ and s = sin 2θ
    increase = radius - mean
    c = half_difference / radius
    s = S12 / radius
    return (
        S11 + 0.5 * increase * (1.0 - c),
        S22 + 0.5 * increase * (1.0 + c),
        S12 - 0.5 * increase * s,
    )


@inner
def scatter_force(
    per_node: Zeros, nodes: Array, G: Array, e: int, q: int, w: float, F: Six, S: Three, f: Array
) -> None:
    """f_a −= w P G_a with P = F S, for f (n, 3) and point q of triangle e with the weight w."""
    F11, F21, F31, F12, F22, F32 = F
    S11, S22, S12 = S
    P11, P12 = w * (F11 * S11 + F12 * S12), w * (F11 * S12 + F12 * S22)
    P21, P22 = w * (F21 * S11 + F22 * S12), w * (F21 * S12 + F22 * S22)
    P31, P32 = w * (F31 * S11 + F32 * S12), w * (F31 * S12 + F32 * S22)
    for a in range(len(per_node)):
        i = np.uintp(nodes[e, a])
        G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
        f[i, 0] -= P11 * G1 + P12 * G2
        f[i, 1] -= P21 * G1 + P22 * G2
        f[i, 2] -= P31 * G1 + P32 * G2


@inner
def material_rows(C: Six, F: Six, G1: float, G2: float) -> Rows:
    """T = ℂ B_a, the change of (S11, S22, S12) with δx_a, for G_a = (G1, G2).

    B_a has the rows F₁ G1, F₂ G2 and F₁ G2 + F₂ G1, for E11, E22 and 2 E12.
    """
    C11, C22, C66, C12, C16, C26 = C
    F11, F21, F31, F12, F22, F32 = F
    # each row of T is α F₁ + β F₂
    a1 = C11 * G1 + C16 * G2
    b1 = C12 * G2 + C16 * G1
    a2 = C12 * G1 + C26 * G2
    b2 = C22 * G2 + C26 * G1
    a3 = C16 * G1 + C66 * G2
    b3 = C26 * G2 + C66 * G1
    return (
        (a1 * F11 + b1 * F12, a1 * F21 + b1 * F22, a1 * F31 + b1 * F32),
        (a2 * F11 + b2 * F12, a2 * F21 + b2 * F22, a2 * F31 + b2 * F32),
        (a3 * F11 + b3 * F12, a3 * F21 + b3 * F22, a3 * F31 + b3 * F32),
    )


@inner
def material_block(T: Rows, H: Six, G1: float, G2: float) -> Rows:
    """Tᵀ B_b(H) = p ⊗ H₁ + r ⊗ H₂, the 3×3 material block of the pair (a, b).

    T is what `material_rows` returns for a. B_b(H) is B_b with H, as columns, in place of F, for
    G_b = (G1, G2).
    """
    T1, T2, T3 = T
    H11, H21, H31, H12, H22, H32 = H
    p1 = T1[0] * G1 + T3[0] * G2
    r1 = T3[0] * G1 + T2[0] * G2
    p2 = T1[1] * G1 + T3[1] * G2
    r2 = T3[1] * G1 + T2[1] * G2
    p3 = T1[2] * G1 + T3[2] * G2
    r3 = T3[2] * G1 + T2[2] * G2
    return (
        (p1 * H11 + r1 * H12, p1 * H21 + r1 * H22, p1 * H31 + r1 * H32),
        (p2 * H11 + r2 * H12, p2 * H21 + r2 * H22, p2 * H31 + r2 * H32),
        (p3 * H11 + r3 * H12, p3 * H21 + r3 * H22, p3 * H31 + r3 * H32),
    )


@inner
def scatter_symmetric(
    per_node: Zeros, slots: Array, G: Array, e: int, q: int, wS: float, wC: float, F: Six,
    S: Three, C: Six, J: Array,
) -> None:  # fmt: skip
    """J_ab += wC B_aᵀ ℂ B_b + wS (G_a · S G_b) I₃ for all pairs a, b of nodes of triangle e.

    As J_ba = J_abᵀ, only the pairs with b ≤ a are computed. `slots` (m, k, k) are the blocks of
    J. The weights wC and wS are those of the material and of the geometric part.
    """
    S11, S22, S12 = wS * S[0], wS * S[1], wS * S[2]
    C = (wC * C[0], wC * C[1], wC * C[2], wC * C[3], wC * C[4], wC * C[5])
    for a in range(len(per_node)):
        G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
        T = material_rows(C, F, G1, G2)
        g1, g2 = S11 * G1 + S12 * G2, S12 * G1 + S22 * G2
        for b in range(a + 1):
            H1, H2 = G[e, q, b, 0], G[e, q, b, 1]
            M = material_block(T, F, H1, H2)
            g = g1 * H1 + g2 * H2
            s = np.uintp(slots[e, a, b])
            for i in range(3):
                J[s, i, i] += M[i][i] + g
            J[s, 0, 1] += M[0][1]
            J[s, 0, 2] += M[0][2]
            J[s, 1, 0] += M[1][0]
            J[s, 1, 2] += M[1][2]
            J[s, 2, 0] += M[2][0]
            J[s, 2, 1] += M[2][1]
            if b < a:
                s = np.uintp(slots[e, b, a])
                for i in range(3):
                    J[s, i, i] += M[i][i] + g
                J[s, 1, 0] += M[0][1]
                J[s, 2, 0] += M[0][2]
                J[s, 0, 1] += M[1][0]
                J[s, 2, 1] += M[1][2]
                J[s, 0, 2] += M[2][0]
                J[s, 1, 2] += M[2][1]


@inner
def scatter_mixed(
    per_node: Zeros, slots: Array, G: Array, e: int, q: int, wS: float, wC: float, F: Six,
    F1: Six, S: Three, C: Six, J: Array,
) -> None:  # fmt: skip
    """J_ab += wC B_a(F)ᵀ ℂ B_b(F₁) + wS (G_a · S G_b) I₃, which is not symmetric.

    The arguments are as for `scatter_symmetric`; F₁ stands in place of F in B_b.
    """
    S11, S22, S12 = wS * S[0], wS * S[1], wS * S[2]
    C = (wC * C[0], wC * C[1], wC * C[2], wC * C[3], wC * C[4], wC * C[5])
    for a in range(len(per_node)):
        G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
        T = material_rows(C, F, G1, G2)
        g1, g2 = S11 * G1 + S12 * G2, S12 * G1 + S22 * G2
        for b in range(len(per_node)):
            H1, H2 = G[e, q, b, 0], G[e, q, b, 1]
            M = material_block(T, F1, H1, H2)
            s = np.uintp(slots[e, a, b])
            for i in range(3):
                J[s, i, i] += g1 * H1 + g2 * H2
                for j in range(3):
                    J[s, i, j] += M[i][j]
