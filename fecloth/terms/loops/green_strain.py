"""Green strain at a quadrature point, and the nodal forces and blocks made of it.

In the notation of `membrane`: E and S in the order (11, 22, 12), ℂ as (C11, C22, C66, C12, C16,
C26), F as its columns (F11, F21, F31, F12, F22, F32), and B_a with δE = Σ B_a δx_a.
"""

import math
from typing import Any

import numpy as np

from fecloth.compiled.jit import Array, Zeros, inlined, inner
from fecloth.compiled.lanes import group, multiply_add, repeat
from fecloth.linalg.lane_blocks import (
    add_product,
    add_to_diagonal,
    as_columns,
    as_rows,
    block_of,
    write_block,
)

Three = tuple[float, float, float]
"""The components 11, 22, 12 of a strain or stress, or a vector."""
Six = tuple[float, float, float, float, float, float]
"""F as its columns, or the moduli ℂ."""


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


@inlined
def columns_of(F: Six) -> tuple[Any, Any]:
    """The columns F₁ and F₂ in lanes."""
    F11, F21, F31, F12, F22, F32 = F
    return group(F11, F21, F31, 0.0), group(F12, F22, F32, 0.0)


@inlined
def combine(a: float, x: Any, b: float, y: Any) -> Any:
    """a x + b y of vectors in lanes."""
    return multiply_add(repeat(a), x, multiply_add(repeat(b), y, repeat(0.0)))


@inlined
def material_rows(C: Six, F1: Any, F2: Any, G1: float, G2: float) -> tuple[Any, Any, Any]:
    """T = ℂ B_a in lanes, the change of (S11, S22, S12) with δx_a, for G_a = (G1, G2).

    B_a has the rows F₁ G1, F₂ G2 and F₁ G2 + F₂ G1, for E11, E22 and 2 E12.
    """
    C11, C22, C66, C12, C16, C26 = C
    return (
        combine(C11 * G1 + C16 * G2, F1, C12 * G2 + C16 * G1, F2),
        combine(C12 * G1 + C26 * G2, F1, C22 * G2 + C26 * G1, F2),
        combine(C16 * G1 + C66 * G2, F1, C26 * G2 + C66 * G1, F2),
    )


@inner
def scatter_symmetric(
    per_node: Zeros, slots: Array, G: Array, e: int, q: int, wS: float, wC: float, F: Six,
    S: Three, C: Six, numbers: Array,
) -> None:  # fmt: skip
    """J_ab += wC B_aᵀ ℂ B_b + wS (G_a · S G_b) I₃ for all pairs a, b of nodes of triangle e.

    As J_ba = J_abᵀ, only the pairs with b ≤ a are computed. `slots` (m, k, k) are the blocks of
    J, and `numbers` (9 b,) are all numbers of J. wC is the weight of the material part,
    and wS the weight of the geometric part.
    """
    S11, S22, S12 = wS * S[0], wS * S[1], wS * S[2]
    C = (wC * C[0], wC * C[1], wC * C[2], wC * C[3], wC * C[4], wC * C[5])
    F1, F2 = columns_of(F)
    rows = as_rows(F1), as_rows(F2)
    columns = as_columns(F1), as_columns(F2)
    for a in range(len(per_node)):
        G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
        T1, T2, T3 = material_rows(C, F1, F2, G1, G2)
        g1, g2 = S11 * G1 + S12 * G2, S12 * G1 + S22 * G2
        for b in range(a + 1):
            H1, H2 = G[e, q, b, 0], G[e, q, b, 1]
            p = combine(H1, T1, H2, T3)  # Tᵀ B_b = p ⊗ F₁ + r ⊗ F₂
            r = combine(H1, T3, H2, T2)
            g = g1 * H1 + g2 * H2
            add_pair(as_rows(p), columns[0], as_rows(r), columns[1], g, numbers, slots[e, a, b])
            if b < a:
                add_pair(rows[0], as_columns(p), rows[1], as_columns(r), g, numbers, slots[e, b, a])


@inner
def scatter_mixed(
    per_node: Zeros, slots: Array, G: Array, e: int, q: int, wS: float, wC: float, F: Six,
    H: Six, S: Three, C: Six, numbers: Array,
) -> None:  # fmt: skip
    """J_ab += wC B_a(F)ᵀ ℂ B_b(H) + wS (G_a · S G_b) I₃, which is not symmetric.

    The arguments are as for `scatter_symmetric`; H stands in place of F in B_b.
    """
    S11, S22, S12 = wS * S[0], wS * S[1], wS * S[2]
    C = (wC * C[0], wC * C[1], wC * C[2], wC * C[3], wC * C[4], wC * C[5])
    F1, F2 = columns_of(F)
    H1, H2 = columns_of(H)
    columns = as_columns(H1), as_columns(H2)
    for a in range(len(per_node)):
        G1, G2 = G[e, q, a, 0], G[e, q, a, 1]
        T1, T2, T3 = material_rows(C, F1, F2, G1, G2)
        g1, g2 = S11 * G1 + S12 * G2, S12 * G1 + S22 * G2
        for b in range(len(per_node)):
            b1, b2 = G[e, q, b, 0], G[e, q, b, 1]
            p = combine(b1, T1, b2, T3)
            r = combine(b1, T3, b2, T2)
            g = g1 * b1 + g2 * b2
            add_pair(as_rows(p), columns[0], as_rows(r), columns[1], g, numbers, slots[e, a, b])


@inlined
def add_pair(p: Any, F1: Any, r: Any, F2: Any, g: float, numbers: Array, slot: int) -> None:
    """Add p ⊗ F₁ + r ⊗ F₂ + g I₃ to a block of J, with p and r as rows, F₁ and F₂ as columns."""
    s = np.uintp(slot)
    block = add_to_diagonal(g, block_of(numbers, s))
    write_block(add_product(r, F2, add_product(p, F1, block)), numbers, s)
