"""Loops over the hinges of a plate, whose angles are coupled by a constant matrix Q.

With the measures μ_e of the dihedral angles (`fold_measure`), g_e = ∂μ_e/∂x on the four nodes of
hinge e, and the moments m = Q (μ − μ⁰) [N m],

    energy   ½ (μ − μ⁰) · m
    f_a    = −Σ_e m_e g_ea
    K_ab   =  Σ_ef g_ea Q_ef g_fbᵀ + Σ_e m_e ∂²μ_e/∂x_a∂x_b

The first part of K is positive semi-definite. It is added row by row: y_b = Σ_f Q_ef g_fb over
the nodes b of the row of e, then g_ea y_bᵀ into the blocks of e.

The node of a hinge is −1 where it is held in space: the hinges from `first` on are clamped
edges, whose fourth node is `ghosts[e − first]`.
"""

import numpy as np

from fecloth.compiled.jit import inner, kernel, rounded_kernel
from fecloth.linalg.block_matrix import find_sorted
from fecloth.terms.bending.dihedral_angle import (
    angle,
    arms,
    cross,
    gradient,
    hessian,
    measure,
    side,
)


@inner
def gather(nodes, ghosts, first, e, x, y):
    """y (4, 3) = the positions of the nodes of a hinge."""
    for a in range(4):
        i = nodes[e, a]
        for c in range(3):
            y[a, c] = x[i, c] if i >= 0 else ghosts[e - first, c]


@kernel
def add_measures(nodes, ghosts, first, x, scale, mu):
    """mu += scale μ of each hinge."""
    y = np.empty((4, 3))
    for e in range(len(nodes)):
        gather(nodes, ghosts, first, e, x, y)
        mu[e] += scale * measure(angle(*arms(y)))[0]


@kernel
def sum_products(a, b):
    """Σ a_e b_e."""
    total = 0.0
    for e in range(len(a)):
        total += a[e] * b[e]
    return total


@kernel
def fill_gradients(nodes, ghosts, first, x, mu, g):
    """Fill mu (h,) = μ and g (h, 4, 3) = ∂μ/∂x of each hinge.

    `ghosts` and `first` are of the nodes held in space, see the head of the module.
    """
    y = np.empty((4, 3))
    for n in range(len(nodes)):
        gather(nodes, ghosts, first, n, x, y)
        e, a, b = arms(y)
        mu[n], slope, _ = measure(angle(e, a, b))
        gradient(side(e, a, cross(e, a)), side(e, b, cross(b, e)), g[n])
        if slope != 1.0:  # beyond a right angle: dμ/dx = dμ/dθ ∂θ/∂x
            for k in range(4):
                for c in range(3):
                    g[n, k, c] *= slope


@kernel
def add_rates(nodes, g, v, rate):
    """rate (h,) += ∂μ/∂x · v."""
    for e in range(len(nodes)):
        total = 0.0
        for a in range(4):
            i = nodes[e, a]
            if i >= 0:
                total += g[e, a, 0] * v[i, 0] + g[e, a, 1] * v[i, 1] + g[e, a, 2] * v[i, 2]
        rate[e] += total


@inner
def row_product(indptr, indices, Q, e, change):
    """Return Σ_f Q_ef change_f, row e of the matrix Q times the vector `change`.

    It is summed as four sums, so that no addition waits for the addition before.
    """
    begin = indptr[e]
    end = indptr[e + 1]
    last = end - (end - begin) % 4
    m0 = 0.0
    m1 = 0.0
    m2 = 0.0
    m3 = 0.0
    # An unsigned index saves the test whether it counts from the end.
    for s in range(begin, last, 4):
        m0 += Q[s] * change[np.uintp(indices[s])]
        m1 += Q[s + 1] * change[np.uintp(indices[s + 1])]
        m2 += Q[s + 2] * change[np.uintp(indices[s + 2])]
        m3 += Q[s + 3] * change[np.uintp(indices[s + 3])]
    for s in range(last, end):
        m0 += Q[s] * change[np.uintp(indices[s])]
    return (m0 + m1) + (m2 + m3)


@rounded_kernel
def fill_moments(indptr, indices, Q, change, moment):
    """moment (h,) = Q change, with the sums of SciPy's product."""
    for e in range(len(moment)):
        total = 0.0
        for s in range(indptr[e], indptr[e + 1]):
            total += Q[s] * change[indices[s]]
        moment[e] = total


@kernel
def add_force(nodes, indptr, indices, Q, change, g, f):
    """f_a −= m_e g_ea with the moments m = Q change."""
    for e in range(len(nodes)):
        m = row_product(indptr, indices, Q, e, change)
        for a in range(4):
            i = nodes[e, a]
            if i >= 0:
                for c in range(3):
                    f[i, c] -= m * g[e, a, c]


@kernel
def add_products(indptr, indices, Q, place, start, width, slots, left, right, scale, y, J):
    """J += scale Σ left_ea Q_ef right_fbᵀ over hinges e and f, with left and right (h, 4, 3).

    `indptr`, `indices` and Q are the compressed rows of the matrix, and `slots` are numbers of
    blocks in J. Row e has the nodes 0 … width[e] − 1. `place` (entries of Q, 4) says which of
    them are the nodes of hinge f. The blocks of node a of hinge e with the nodes of the row
    begin at slots[start[e] + a width[e]]. Both are −1 for a node that is held in space. y (at
    least 3 times the largest width,) is work space.
    """
    for e in range(len(width)):
        u = width[e]  # number of nodes of the row
        for b in range(3 * u):
            y[b] = 0.0
        # y_b = scale Σ_f Q_ef right_fb
        for s in range(indptr[e], indptr[e + 1]):
            f = indices[s]
            q = scale * Q[s]
            for a in range(4):
                b = place[s, a]
                if b >= 0:
                    for c in range(3):
                        y[3 * b + c] += q * right[f, a, c]
        for a in range(4):
            g0, g1, g2 = left[e, a, 0], left[e, a, 1], left[e, a, 2]
            first = start[e] + a * u
            if slots[first] >= 0:
                for b in range(u):
                    block = np.uintp(slots[first + b])
                    for c in range(3):
                        J[block, 0, c] += g0 * y[3 * b + c]
                        J[block, 1, c] += g1 * y[3 * b + c]
                        J[block, 2, c] += g2 * y[3 * b + c]


@kernel
def fill_products(
    indptr, indices, of_hinge, triangles, left, of_triangle, hinges, right, H, position, Q
):
    """Q_fg = Σ_e L_feᵀ H_e R_eg over the triangles e that two hinges f and g have in common.

    `indptr`, `indices` and Q are the compressed rows of the result. Those of L, with 3 numbers
    `left` an entry, are `of_hinge` and `triangles`; those of R, with 3 numbers `right` an entry,
    are `of_triangle` and `hinges`. H is (triangles, 3, 3). `position` (hinges,) is work space:
    where the entry of hinge g is in row f.
    """
    for f in range(len(indptr) - 1):
        for s in range(indptr[f], indptr[f + 1]):
            position[indices[s]] = s
            Q[s] = 0.0
        for p in range(of_hinge[f], of_hinge[f + 1]):
            e = triangles[p]
            l0, l1, l2 = left[p, 0], left[p, 1], left[p, 2]
            # w = L_feᵀ H_e
            w0 = l0 * H[e, 0, 0] + l1 * H[e, 1, 0] + l2 * H[e, 2, 0]
            w1 = l0 * H[e, 0, 1] + l1 * H[e, 1, 1] + l2 * H[e, 2, 1]
            w2 = l0 * H[e, 0, 2] + l1 * H[e, 1, 2] + l2 * H[e, 2, 2]
            for q in range(of_triangle[e], of_triangle[e + 1]):
                s = position[hinges[q]]
                Q[s] += w0 * right[q, 0] + w1 * right[q, 1] + w2 * right[q, 2]


@kernel
def add_curvatures(nodes, ghosts, first, x, place, own, start, width, slots, moment, scale, J):
    """J += scale Σ m_e ∂²μ_e/∂x∂x with m = `moment`.

    `place`, `start`, `width` and `slots` say where the blocks of hinge e are, as in
    `add_products`; own[e] is the entry of Q on the diagonal of row e.
    """
    y = np.empty((4, 3))
    g = np.empty((4, 3))
    H = np.empty((4, 3, 4, 3))
    for n in range(len(nodes)):
        m = scale * moment[n]
        gather(nodes, ghosts, first, n, x, y)
        e, a, b = arms(y)
        _, slope, bend = measure(angle(e, a, b))
        left = side(e, a, cross(e, a))
        right = side(e, b, cross(b, e))
        hessian(e, left, right, H)
        if bend != 0.0:  # beyond a right angle, where μ is not θ
            gradient(left, right, g)
            add_fold(slope, bend, g, H)
        column = place[np.uintp(own[n])]  # where the hinge's own nodes are in its row
        row = start[n]  # where the blocks of node i begin in `slots`
        for i in range(4):
            if nodes[n, i] >= 0:
                for j in range(4):
                    if nodes[n, j] >= 0:
                        block = np.uintp(slots[np.uintp(row + column[j])])
                        for c in range(3):
                            for d in range(3):
                                J[block, c, d] += m * H[i, c, j, d]
            row += width[n]


@inner
def add_fold(slope, bend, g, H):
    """H (4, 3, 4, 3) of the angle becomes H of its measure: μ′ H + μ″ g gᵀ."""
    for i in range(4):
        for c in range(3):
            for j in range(4):
                for d in range(3):
                    H[i, c, j, d] = slope * H[i, c, j, d] + bend * g[i, c] * g[j, d]


@kernel
def add_gradient_rates(nodes, ghosts, first, x, v, scale, out):
    """out (h, 4, 3) += scale ∂μ̇/∂x = scale ∂²μ/∂x∂x · v, of each hinge.

    With the measure μ of θ, ∂²μ/∂x∂x = μ′ ∂²θ/∂x∂x + μ″ ∂θ/∂x ∂θ/∂xᵀ. Nodes held in space
    have v = 0.
    """
    y = np.empty((4, 3))
    g = np.empty((4, 3))
    H = np.empty((4, 3, 4, 3))
    for n in range(len(nodes)):
        gather(nodes, ghosts, first, n, x, y)
        e, a, b = arms(y)
        _, slope, bend = measure(angle(e, a, b))
        left = side(e, a, cross(e, a))
        right = side(e, b, cross(b, e))
        gradient(left, right, g)
        hessian(e, left, right, H)
        rate = 0.0  # θ̇
        for j in range(4):
            i = nodes[n, j]
            if i >= 0:
                rate += g[j, 0] * v[i, 0] + g[j, 1] * v[i, 1] + g[j, 2] * v[i, 2]
        for k in range(4):
            for c in range(3):
                total = bend * rate * g[k, c]
                for j in range(4):
                    i = nodes[n, j]
                    if i >= 0:
                        for d in range(3):
                            total += slope * H[k, c, j, d] * v[i, d]
                out[n, k, c] += scale * total


@kernel
def fill_rows(
    nodes, indptr, indices, block_ptr, block_nodes, blocks, start, last, position, row, place, slots
):
    """Fill `place` and `slots` of `add_products` from the blocks of each pair of nodes.

    Row i of the pairs has the nodes block_nodes[block_ptr[i] …], ascending, with their `blocks`.
    `last`, which must be −1 for each node, `position` and `row` are work space: the last row in
    which a node was met, its place in that row, and the nodes of the row. Return the first hinge
    with a pair that has no block, or −1.
    """
    for e in range(len(nodes)):
        u = 0  # number of nodes found in row e
        for s in range(indptr[e], indptr[e + 1]):
            for a in range(4):
                i = nodes[indices[s], a]
                if i < 0:
                    place[s, a] = -1
                    continue
                if last[i] != e:
                    last[i] = e
                    position[i] = u
                    row[u] = i
                    u += 1
                place[s, a] = position[i]
        for a in range(4):
            i = nodes[e, a]
            first = start[e] + a * u
            for b in range(u):
                slots[first + b] = -1
                if i >= 0:
                    pair = find_sorted(block_nodes, block_ptr[i], block_ptr[i + 1], row[b])
                    if pair < 0:  # not found
                        return e
                    slots[first + b] = blocks[pair]
    return -1
