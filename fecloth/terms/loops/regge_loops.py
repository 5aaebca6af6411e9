"""The membrane loops with the Regge-interpolated strain E_h (`regge_strain`).

The templates below are plain functions that call `law` and `strain`. `Kernels` of
`membrane_loops` puts compiled functions in place of these two and compiles a copy of each
template. The arguments are

    per_node, per_point     tuples with one zero for each node of a triangle, and for each point
    nodes (m, 6)            nodes of the triangles
    slots (m, 6, 6)         blocks of their pairs of nodes in the matrix
    A (m, 3, 3, 6, 6)       forms A^k of each point [1/m²]
    w (m, 3)                weights of the points [m²]
    c (m, p)                constants of the law
    rest (m, 3, 3)          E⁰, for which the flat cloth has no strain, or another strain at rest
    x (n, 3)                positions, of which B is made
    v (n, 3)                what B acts on: x for the strain, the velocities for its rate

With B^k_b = ∂E_k/∂x_b and S̃, ℂ̃ for the engineering shear they compute

    energy   Σ w W
    f_b    = −Σ w Σ_k S̃_k B^k_b
    K_ab   =  Σ w (Σ_kl B^k_a ℂ̃_kl B^l_bᵀ + Σ_k S̃_k A^k_ab I₃)

Their work space is u and r (6, 3), x and v at the nodes of a triangle; B (3, 6, 3); and R and T
(3, 6, 3) for products with B.
"""

import numpy as np

from fecloth.compiled.jit import Array, Zeros, inner
from fecloth.terms.loops.green_strain import Three, clamp
from fecloth.terms.loops.pointwise_loops import law
from fecloth.terms.loops.regge_strain import (
    NODES,
    POINTS,
    add_sample_stress,
    contract_rows,
    fill_rows,
    gather,
    scatter_force,
    scatter_geometric,
    scatter_material,
    scatter_tension,
)

# --- what is inserted -------------------------------------------------------------------------


def strain(h: Three, rest: Array, e: int, q: int) -> Three:
    """Return the strain from h_k = B^k · r; one of the next two takes its place."""
    raise NotImplementedError


@inner
def rested(h: Three, rest: Array, e: int, q: int) -> Three:
    """E_k = ½ B^k · x less the strain at rest."""
    return 0.5 * h[0] - rest[e, q, 0], 0.5 * h[1] - rest[e, q, 1], 0.5 * h[2] - rest[e, q, 2]


@inner
def rate(h: Three, rest: Array, e: int, q: int) -> Three:
    """Ė_k = B^k · v."""
    return h


# --- templates --------------------------------------------------------------------------------


def energy(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array,
) -> float:  # fmt: skip
    """Σ w W [J]."""
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    total = 0.0
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            W, _, _ = law(E, c[e])
            total += w[e, q] * W
    return total


def add_force(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, f: Array,
) -> None:  # fmt: skip
    """f_b −= Σ w Σ_k S̃_k B^k_b."""
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            _, S, _ = law(E, c[e])
            scatter_force(nodes, e, w[e, q], S, B, f)


def add_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, A: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, wx: float, wv: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += Σ w (wv Σ_kl B^k_a ℂ̃_kl B^l_bᵀ + wx Σ_k S̃_k A^k_ab I₃), symmetric.

    For a strain wv is wx, the weight of K; for the rate of a strain it is the weight of D.
    """
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    T = np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            _, S, C = law(E, c[e])
            scatter_material(slots, e, wv * w[e, q], B, C, B, T, J)
            scatter_geometric(slots, e, wx * w[e, q], S, A[e, q], J)


def add_definite_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, A: Array, w: Array, c: Array,
    slopes: Array, gradients: Array, samples: Array, rest: Array, x: Array, v: Array, wx: float,
    wv: float, J: Array,
) -> None:  # fmt: skip
    """`add_tangent` with a geometric part that is positive semi-definite.

    There the stresses on the nine data of E_h take the place of S. Negative ones, of a tensor
    its negative principal values, are raised to zero: see `scatter_tension`. The arrays `slopes`,
    `gradients` and `samples` are the fields of `ReggeStrain`.
    """
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    T = np.empty((3, NODES, 3))
    sigma = np.empty(9)
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        sigma[:] = 0.0  # 6 stresses on t · E t, then 3 on the mean of E
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            _, S, C = law(E, c[e])
            scatter_material(slots, e, wv * w[e, q], B, C, B, T, J)
            add_sample_stress(samples[e], q, w[e, q], S, sigma)
        # The stress on E12 is 2 S12.
        tension = clamp((sigma[6], sigma[7], 0.5 * sigma[8]))
        scatter_tension(slots, e, wx, sigma, slopes[e], tension, gradients[e], J)


def add_mixed_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, A: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, motion: Array, wx: float, wv: float,
    mixed: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += Σ w (Σ_kl B^k_a ℂ̃_kl R^l_bᵀ + wx Σ_k S̃_k A^k_ab I₃), not symmetric.

    R = wv B + mixed Ḃ with Ḃ, which is B made of `motion` (n, 3) in place of x: of the way of the
    nodes in half a step, or of their velocity.
    """
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    d = np.empty((NODES, 3))
    R = np.empty((3, NODES, 3))
    T = np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        gather(nodes, e, motion, d)
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            _, S, C = law(E, c[e])
            fill_rows(A[e, q], d, R)  # Ḃ
            R[:] = wv * B + mixed * R
            scatter_material(slots, e, w[e, q], B, C, R, T, J)
            scatter_geometric(slots, e, wx * w[e, q], S, A[e, q], J)


def add_stress(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """out[e] += (S11, S22, S12, W), the means over the triangle, whose points weigh the same."""
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            W, S, _ = law(E, c[e])
            for k in range(3):
                out[e, k] += S[k] / POINTS
            out[e, 3] += W / POINTS


def add_moduli(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """out[e] += (C11, C22, C66, C12, C16, C26), the mean over the triangle, with out (m, 6)."""
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            _, _, C = law(E, c[e])
            for k in range(6):
                out[e, k] += C[k] / POINTS


def add_strain(
    per_node: Zeros, per_point: Zeros, nodes: Array, A: Array, rest: Array,
    weight: float, x: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """out (m, 3, 3) += weight E_h, in each triangle at three points (E11, E22, E12)."""
    u = np.empty((NODES, 3))
    r = np.empty((NODES, 3))
    B = np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for q in range(len(per_point)):
            fill_rows(A[e, q], u, B)
            E = strain(contract_rows(B, r), rest, e, q)
            for k in range(3):
                out[e, q, k] += weight * E[k]
