"""Loops over the stencils of a condition C(x): springs, hinges and every other condition.

A condition C(x) with r components on a stencil of k nodes, a stiffness k_s and a damping k_d
give (Baraff and Witkin 1998, Large Steps in Cloth Simulation, equations in brackets)

    energy   ½ Cᵀ k_s C                                                       (above (7))
    force    f_a = −∂C_a k_s C                                                        (7)
    K_ab   = ∂C_a k_s ∂C_bᵀ + Σ_r (k_s C)_r ∂²C_r,ab                                  (8)
    damping  d_a = −∂C_a k_d Ċ,  Ċ = Σ_a ∂C_aᵀ v_a                                   (11)
    −∂d_a/∂x_b = Σ_r (k_d Ċ)_r ∂²C_r,ab + ∂C_a k_d (∂Ċ/∂x_b)ᵀ,  ∂Ċ/∂x_b = ∂²C_ba v   (12)
    −∂d_a/∂v_b = ∂C_a k_d ∂C_bᵀ                                                      (13)

with the last part of (12) not symmetric: Baraff and Witkin drop it. k_s and k_d are (r, r)
matrices, the stencil's own: for one component they are numbers, else mostly diagonal.

A family of conditions is a compiled function

    condition(y, c, order, C, g, H)      decorated with @inner

    y (k, 3)             positions of the stencil's nodes [m]
    c (p,)               the constants of the stencil
    order                which to compute: 0 only C, 1 also g, 2 also H
    C (r,), g (r, k, 3), H (r, k, 3, k, 3)
                         to be filled with C, ∂C/∂y and ∂²C/∂y∂y: every entry of the arrays that
                         `order` names, because they hold the values of another stencil before

The loops below are templates that call it; `bound_condition.ConditionKernels` compiles them and
`BoundCondition.bind` makes the bound term. `per_node` is a tuple with one zero for each node
and `convex` a tuple with, for each component, 1 if its ∂²C is positive semi-definite at every
x and 0 if it is not: the compiler knows their length. A term whose constants change with x or
t extends `BoundCondition` and its `table`, as custom/condition.py and tether.py do.

A definite tangent keeps the part (k_s C + k_d Ċ)_r ∂²C_r where neither factor is negative, and
drops the other such parts and the non-symmetric part. Gauss–Newton drops all of ∂²C.
"""

import numpy as np

from fecloth.compiled.jit import Array, Zeros, inner


def condition(y: Array, c: Array, order: int, C: Array, g: Array, H: Array) -> None:
    """Fill C, g and H; `bound_condition.ConditionKernels` puts a family in place of this one."""
    raise NotImplementedError


@inner
def gather(per_node: Zeros, nodes: Array, e: int, x: Array, y: Array) -> None:
    """y_a = x of the stencil's node a."""
    for a in range(len(per_node)):
        i = np.uintp(nodes[e, a])
        for j in range(3):
            y[a, j] = x[i, j]


@inner
def rate(per_node: Zeros, convex: Zeros, g: Array, u: Array, out: Array) -> None:
    """Ċ_r = Σ_a ∂C_r/∂x_a · v_a."""
    for r in range(len(convex)):
        out[r] = 0.0
        for a in range(len(per_node)):
            out[r] += g[r, a, 0] * u[a, 0] + g[r, a, 1] * u[a, 1] + g[r, a, 2] * u[a, 2]


def energy(per_node: Zeros, convex: Zeros, nodes: Array, c: Array, ks: Array, x: Array) -> float:
    """Return ½ Σ Cᵀ k_s C [J] over the stencils `nodes` (m, k); c is (m, p), ks (m, r, r)."""
    y = np.empty((len(per_node), 3))
    C = np.empty(len(convex))
    g = np.empty((len(convex), len(per_node), 3))
    H = np.empty((0, 0, 0, 0, 0))
    total = 0.0
    for e in range(len(nodes)):
        gather(per_node, nodes, e, x, y)
        condition(y, c[e], 0, C, g, H)
        for r in range(len(convex)):
            for s in range(len(convex)):
                total += 0.5 * ks[e, r, s] * C[r] * C[s]
    return total


def power(
    per_node: Zeros, convex: Zeros, nodes: Array, c: Array, kd: Array, x: Array, v: Array
) -> float:
    """Return the dissipated power Σ Ċᵀ k_d Ċ [W]; c is (m, p), kd (m, r, r)."""
    y = np.empty((len(per_node), 3))
    u = np.empty((len(per_node), 3))
    C = np.empty(len(convex))
    Cdot = np.empty(len(convex))
    g = np.empty((len(convex), len(per_node), 3))
    H = np.empty((0, 0, 0, 0, 0))
    total = 0.0
    for e in range(len(nodes)):
        gather(per_node, nodes, e, x, y)
        gather(per_node, nodes, e, v, u)
        condition(y, c[e], 1, C, g, H)
        rate(per_node, convex, g, u, Cdot)
        for r in range(len(convex)):
            for s in range(len(convex)):
                total += kd[e, r, s] * Cdot[r] * Cdot[s]
    return total


def add_force(
    per_node: Zeros, convex: Zeros, nodes: Array, c: Array, ks: Array, kd: Array, x: Array,
    v: Array, f: Array,
) -> None:  # fmt: skip
    """f_a −= ∂C_a (k_s C + k_d Ċ), for f (n, 3) [N]."""
    y = np.empty((len(per_node), 3))
    u = np.empty((len(per_node), 3))
    C = np.empty(len(convex))
    Cdot = np.empty(len(convex))
    g = np.empty((len(convex), len(per_node), 3))
    H = np.empty((0, 0, 0, 0, 0))
    for e in range(len(nodes)):
        gather(per_node, nodes, e, x, y)
        gather(per_node, nodes, e, v, u)
        condition(y, c[e], 1, C, g, H)
        rate(per_node, convex, g, u, Cdot)
        for r in range(len(convex)):
            tension = 0.0
            for s in range(len(convex)):
                tension += ks[e, r, s] * C[s] + kd[e, r, s] * Cdot[s]
            for a in range(len(per_node)):
                i = np.uintp(nodes[e, a])
                for j in range(3):
                    f[i, j] -= tension * g[r, a, j]


def add_tangent(
    per_node: Zeros, convex: Zeros, nodes: Array, slots: Array, c: Array, ks: Array, kd: Array,
    x: Array, v: Array, wx: float, wv: float, geometric: bool, definite: bool, mixed: bool,
    J: Array,
) -> None:  # fmt: skip
    """J_ab += ∂C_a (wx k_s + wv k_d) ∂C_bᵀ + wx Σ (k_s C + k_d Ċ)_r ∂²C_r,ab + the mixed part.

    `geometric` says whether the second part is there, with ∂²C; `definite` whether only its
    positive semi-definite terms are kept; and `mixed` whether the mixed part wx ∂C_a k_d
    (∂Ċ/∂x_b)ᵀ is there. `slots` (m, k, k) are the blocks of J.
    """
    k = len(per_node)
    n = len(convex)
    y = np.empty((k, 3))
    u = np.empty((k, 3))
    C = np.empty(n)
    Cdot = np.empty(n)
    tension = np.empty(n)
    g = np.empty((n, k, 3))
    H = np.empty((n, k, 3, k, 3))
    dCdot = np.zeros((n, k, 3))  # wx ∂Ċ/∂x
    T = np.empty((n, k, 3))  # the factor of ∂C_a
    order = 2 if geometric or mixed else 1
    for e in range(len(nodes)):
        gather(per_node, nodes, e, x, y)
        gather(per_node, nodes, e, v, u)
        condition(y, c[e], order, C, g, H)
        rate(per_node, convex, g, u, Cdot)
        if mixed:
            for r in range(n):
                for b in range(k):
                    for j in range(3):
                        total = 0.0
                        for a in range(k):
                            for i in range(3):
                                total += H[r, b, j, a, i] * u[a, i]
                        dCdot[r, b, j] = wx * total
        for r in range(n):
            s = 0.0
            for q in range(n):
                s += ks[e, r, q] * C[q] + kd[e, r, q] * Cdot[q]
            tension[r] = wx * s  # the factor of ∂²C_r; 0 where that part is left out
            if not geometric or (definite and (convex[r] == 0 or tension[r] < 0.0)):
                tension[r] = 0.0
            for b in range(k):
                for j in range(3):
                    T[r, b, j] = 0.0
                    for q in range(n):
                        # dCdot is zero without the mixed part
                        weight = wx * ks[e, r, q] + wv * kd[e, r, q]
                        T[r, b, j] += weight * g[q, b, j] + kd[e, r, q] * dCdot[q, b, j]
        for a in range(k):
            for b in range(k):
                slot = np.uintp(slots[e, a, b])
                for i in range(3):
                    for j in range(3):
                        total = 0.0
                        for r in range(n):
                            total += g[r, a, i] * T[r, b, j]
                            if tension[r] != 0.0:
                                total += tension[r] * H[r, a, i, b, j]
                        J[slot, i, j] += total
