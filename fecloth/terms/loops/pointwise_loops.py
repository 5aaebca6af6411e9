"""The membrane loops with the Green strain E at each quadrature point.

The templates below are plain functions that call `law`, `rate_gradient` and `strain`. `Kernels`
of `membrane_loops` puts compiled functions in place of these three and compiles a copy of each
template. The arguments are

    per_node, per_point   tuples with one zero for each node of a triangle, and for each point:
                          the compiler knows their length and unrolls the loops, three times
                          faster than with a length read from an array
    nodes (m, k)          nodes of the triangles
    slots (m, k, k)       blocks of their pairs of nodes in the matrix
    G (m, points, k, 2)   gradients ∂N_a/∂X of the shape functions [1/m]
    w (m, points)         weights of the points [m²]
    c (m, p)              constants of the law
    rest (m, points, 3)   strain at rest; only `rested` uses it
    x (n, 3)              positions
    v (n, 3)              velocities for the strain rate; else not used, x may stand there

With δE = Σ B_a δx_a the templates compute

    energy   Σ w W
    f_a    = −Σ w P G_a,   P = F S
    K_ab   =  Σ w (B_aᵀ ℂ B_b + (G_a · S G_b) I₃)

The scatter functions are called here by name, and only small functions are inserted: with a
compiled function between a template and `gradient` or `scatter_symmetric`, `StVK` took up to 1.4
times the time on P1 and 2.6 times on P2, also with ``inline="always"`` (1.2 and 2.0 times).
"""

import numpy as np

from fecloth.compiled.jit import Array, Zeros, inner
from fecloth.terms.loops.green_strain import (
    Six,
    Three,
    clamp,
    gradient,
    green_strain,
    scatter_force,
    scatter_mixed,
    scatter_symmetric,
    strain_rate,
)

# --- what is inserted -------------------------------------------------------------------------


def law(E: Three, c: Array) -> tuple[float, Three, Six]:
    """Return W, S and ℂ at the strain E; a membrane law takes the place of this function."""
    raise NotImplementedError


def rate_gradient(per_node: Zeros, nodes: Array, G: Array, e: int, q: int, v: Array) -> Six:
    """Return Ḟ; `gradient` or, for a strain that is no rate, `no_gradient` takes its place."""
    raise NotImplementedError


@inner
def no_gradient(per_node: Zeros, nodes: Array, G: Array, e: int, q: int, v: Array) -> Six:
    """Zero, which the strain does not use."""
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


def strain(F: Six, Fdot: Six, rest: Array, e: int, q: int) -> Three:
    """Return the strain at point q of triangle e; one of the next three takes its place."""
    raise NotImplementedError


@inner
def green(F: Six, Fdot: Six, rest: Array, e: int, q: int) -> Three:
    """E = (FᵀF − I)/2."""
    return green_strain(F)


@inner
def rested(F: Six, Fdot: Six, rest: Array, e: int, q: int) -> Three:
    """E = (FᵀF − I)/2 less the strain at rest."""
    E11, E22, E12 = green_strain(F)
    return E11 - rest[e, q, 0], E22 - rest[e, q, 1], E12 - rest[e, q, 2]


@inner
def rate(F: Six, Fdot: Six, rest: Array, e: int, q: int) -> Three:
    """Ė = sym(FᵀḞ)."""
    return strain_rate(F, Fdot)


# --- templates --------------------------------------------------------------------------------


def energy(
    per_node: Zeros, per_point: Zeros, nodes: Array, G: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array,
) -> float:  # fmt: skip
    """Σ w W [J]."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            W, _, _ = law(E, c[e])
            total += w[e, q] * W
    return total


def add_force(
    per_node: Zeros, per_point: Zeros, nodes: Array, G: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, f: Array,
) -> None:  # fmt: skip
    """f_a −= Σ w P G_a."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            _, S, _ = law(E, c[e])
            scatter_force(per_node, nodes, G, e, q, w[e, q], F, S, f)


def add_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, G: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, wx: float, wv: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += Σ w (wv B_aᵀ ℂ B_b + wx (G_a · S G_b) I₃), symmetric.

    For a strain wv is wx, the weight of K; for the rate of a strain it is the weight of D.
    """
    numbers = J.reshape(J.size)
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            _, S, C = law(E, c[e])
            geometric = wx * w[e, q]
            material = wv * w[e, q]
            scatter_symmetric(per_node, slots, G, e, q, geometric, material, F, S, C, numbers)


def add_definite_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, G: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, wx: float, wv: float, J: Array,
) -> None:  # fmt: skip
    """`add_tangent` with negative principal stresses of the geometric part raised to zero.

    Then it is positive semi-definite, if ℂ is.
    """
    numbers = J.reshape(J.size)
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            _, S, C = law(E, c[e])
            tension = clamp(S)
            geometric = wx * w[e, q]
            material = wv * w[e, q]
            scatter_symmetric(per_node, slots, G, e, q, geometric, material, F, tension, C, numbers)


def add_mixed_tangent(
    per_node: Zeros, per_point: Zeros, nodes: Array, slots: Array, G: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, motion: Array, wx: float, wv: float,
    mixed: float, J: Array,
) -> None:  # fmt: skip
    """J_ab += Σ w (B_a(F)ᵀ ℂ B_b(wv F + mixed H) + wx (G_a · S G_b) I₃), not symmetric.

    H is the gradient of `motion` (n, 3), the way of the nodes in half a step or their velocity.
    """
    numbers = J.reshape(J.size)
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            _, S, C = law(E, c[e])
            H = gradient(per_node, nodes, G, e, q, motion)
            right = (
                wv * F[0] + mixed * H[0],
                wv * F[1] + mixed * H[1],
                wv * F[2] + mixed * H[2],
                wv * F[3] + mixed * H[3],
                wv * F[4] + mixed * H[4],
                wv * F[5] + mixed * H[5],
            )
            geometric = wx * w[e, q]
            scatter_mixed(per_node, slots, G, e, q, geometric, w[e, q], F, right, S, C, numbers)


def add_stress(
    per_node: Zeros, per_point: Zeros, nodes: Array, G: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """out[e] += (S11, S22, S12, W), the means over the triangle, with out (m, 4)."""
    for e in range(len(nodes)):
        area = np.sum(w[e])
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            W, S, _ = law(E, c[e])
            share = w[e, q] / area
            for k in range(3):
                out[e, k] += share * S[k]
            out[e, 3] += share * W


def add_moduli(
    per_node: Zeros, per_point: Zeros, nodes: Array, G: Array, w: Array, c: Array,
    rest: Array, x: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """out[e] += (C11, C22, C66, C12, C16, C26), the mean over the triangle, with out (m, 6)."""
    for e in range(len(nodes)):
        area = np.sum(w[e])
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            _, _, C = law(E, c[e])
            for k in range(6):
                out[e, k] += w[e, q] / area * C[k]


def add_strain(
    per_node: Zeros, per_point: Zeros, nodes: Array, G: Array, rest: Array,
    weight: float, x: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """out (m, points, 3) += weight E."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            E = strain(F, rate_gradient(per_node, nodes, G, e, q, v), rest, e, q)
            for k in range(3):
                out[e, q, k] += weight * E[k]
