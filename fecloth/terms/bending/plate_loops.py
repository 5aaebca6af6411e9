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

import math

import numpy as np

from fecloth.compiled.jit import inlined, inner, kernel, rounded_kernel
from fecloth.compiled.lanes import group, load, multiply_add, reordered, repeat, store
from fecloth.linalg.block_matrix import find_sorted
from fecloth.linalg.lane_blocks import add_product, as_columns, as_rows, block_of, write_block
from fecloth.terms.bending.dihedral_angle import (
    angle,
    arms,
    cross,
    dot,
    gradient,
    hessian,
    measure,
    multiply,
    side,
)

to_left = reordered(1, 2, 3, 0)


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
    them are the nodes of hinge f. The blocks of the nodes of hinge e with node b of the row begin
    at slots[start[e] + 4 b]. Both are −1 for a node that is held in space. y (the largest width,
    4) is work space.
    """
    zero = repeat(0.0)
    numbers = J.reshape(J.size)
    for row in range(len(width)):
        e = np.uintp(row)  # not negative: the compiler need not look
        for b in range(width[e]):
            store(zero, y, (np.uintp(b),))
        # y_b = scale Σ_f Q_ef right_fb
        for entry in range(indptr[e], indptr[e + np.uintp(1)]):
            s = np.uintp(entry)
            f = np.uintp(indices[s])
            q = repeat(scale * Q[s])
            add_to_vector(q, vector(right, f, 0), y, place[s, 0])
            add_to_vector(q, vector(right, f, 1), y, place[s, 1])
            add_to_vector(q, vector(right, f, 2), y, place[s, 2])
            add_to_vector(q, vector(right, f, 3), y, place[s, 3])
        g0 = as_rows(vector(left, e, 0))
        g1 = as_rows(vector(left, e, 1))
        g2 = as_rows(vector(left, e, 2))
        g3 = as_rows(vector(left, e, 3))
        s = np.uintp(start[e])
        for b in range(width[e]):
            columns = as_columns(load(y, (np.uintp(b),)))
            add_to_block(g0, columns, numbers, slots[s])
            add_to_block(g1, columns, numbers, slots[s + np.uintp(1)])
            add_to_block(g2, columns, numbers, slots[s + np.uintp(2)])
            add_to_block(g3, columns, numbers, slots[s + np.uintp(3)])
            s += np.uintp(4)


@inlined
def vector(g, e, a):
    """The lanes of g[e, a] of g (h, 4, 3)."""
    if a < 3:
        return load(g, (e, a))
    # Nothing may follow the last vector: the number before it becomes the fourth one.
    return to_left(load(g, (e, 2, 2)))


@inlined
def add_to_vector(factor, g, y, place):
    """Add factor g, in lanes, to a row of y (…, 4), unless its number is −1."""
    if place >= 0:
        b = np.uintp(place)
        store(multiply_add(factor, g, load(y, (b,))), y, (b,))


@inlined
def add_to_block(rows, columns, numbers, slot):
    """Add the product of two vectors, in lanes, to a block of J, unless its number is −1."""
    if slot >= 0:
        s = np.uintp(slot)
        write_block(add_product(rows, columns, block_of(numbers, s)), numbers, s)


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

    `place`, `start` and `slots` say where the blocks of hinge e are, as in `add_products`; own[e]
    is the entry of Q on the diagonal of row e.
    """
    y = np.empty((4, 3))
    g = np.empty((4, 3))
    of_hinge = np.empty((4, 4), np.int64)
    numbers = J.reshape(J.size)
    for n in range(len(nodes)):
        gather(nodes, ghosts, first, n, x, y)
        e, a, b = arms(y)
        normals = cross(e, a), cross(b, e)
        left = side(e, a, normals[0])
        right = side(e, b, normals[1])
        column = place[np.uintp(own[n])]  # where the hinge's own nodes are in its row
        for i in range(4):
            for j in range(4):
                slot = slots[np.uintp(start[n] + 4 * column[j] + i)] if column[j] >= 0 else -1
                of_hinge[i, j] = slot
        m = scale * moment[n]
        if dot(normals[0], normals[1]) < 0.0:  # beyond a right angle, where μ is not θ
            _, slope, bend = measure(angle(e, a, b))
            gradient(left, right, g)
            add_outer_products(m * bend, g, of_hinge, J)
            m *= slope
        square = dot(e, e)
        length = math.sqrt(square)
        u = multiply(1.0 / square, e)
        q = cross(left[2], multiply(1.0 / length, e))
        arm = len(y) - 2  # node 2: for a literal 2 the compiler would make another function
        add_side_of_curvature(arm, m, *left, q, u, 1.0 / square, of_hinge, numbers)
        q = cross(multiply(1.0 / length, e), right[2])
        add_side_of_curvature(arm + 1, m, *right, q, u, 1.0 / square, of_hinge, numbers)


@inner
def add_side_of_curvature(arm, m, s, height, p, q, u, inverse_square, slots, numbers):
    """Add m times ∂²θ/∂x∂x of one triangle, whose arm leads to node number `arm`, to J.

    s and `height` are of the triangle, p = n̂/h, q = m/h, u = ê/|e| and `inverse_square` is 1/|e|²,
    see `fecloth.terms.bending.dihedral_angle`. The second derivatives there are

        ∂²θ/∂x_i∂x_j = −p (w_j h_i + d_i d_j (h/|e|)² q)ᵀ − w_i h_j pᵀ,   h_i = w_i q + d_i u

    with w = (s − 1, −s, 1) and d = (−1, 1, 0) for nodes 0, 1 and `arm`. `slots` (4, 4) are the
    blocks of the pairs of nodes in J, and `numbers` (9 b,) are all numbers of J.
    """
    p = group(-m * p[0], -m * p[1], -m * p[2], 0.0)
    q = group(q[0], q[1], q[2], 0.0)
    u = group(u[0], u[1], u[2], 0.0)
    zero = repeat(0.0)
    minus_u = multiply_add(repeat(-1.0), u, zero)
    twist = multiply_add(repeat(height * height * inverse_square), q, zero)
    minus_twist = multiply_add(repeat(-1.0), twist, zero)
    w0 = repeat(s - 1.0)
    w1 = repeat(-s)
    w2 = repeat(1.0)
    h0 = multiply_add(w0, q, minus_u)
    h1 = multiply_add(w1, q, u)
    p = as_rows(p), as_columns(p)
    add_pair(p, w0, h0, w0, h0, twist, numbers, slots[0, 0])
    add_pair(p, w0, h0, w1, h1, minus_twist, numbers, slots[0, 1])
    add_pair(p, w0, h0, w2, q, zero, numbers, slots[0, arm])
    add_pair(p, w1, h1, w0, h0, minus_twist, numbers, slots[1, 0])
    add_pair(p, w1, h1, w1, h1, twist, numbers, slots[1, 1])
    add_pair(p, w1, h1, w2, q, zero, numbers, slots[1, arm])
    add_pair(p, w2, q, w0, h0, zero, numbers, slots[arm, 0])
    add_pair(p, w2, q, w1, h1, zero, numbers, slots[arm, 1])
    add_pair(p, w2, q, w2, q, zero, numbers, slots[arm, arm])


@inlined
def add_pair(p, wi, hi, wj, hj, twist, numbers, slot):
    """Add p (w_j h_i + twist)ᵀ + w_i h_j pᵀ, in lanes, to a block of J, unless its number is −1."""
    if slot >= 0:
        k = np.uintp(slot)
        rows, columns = p
        block = add_product(rows, as_columns(multiply_add(wj, hi, twist)), block_of(numbers, k))
        h = as_rows(multiply_add(wi, hj, repeat(0.0)))
        write_block(add_product(h, columns, block), numbers, k)


@inner
def add_outer_products(factor, g, slots, J):
    """J += factor g gᵀ of the gradients g (4, 3) of a hinge; `slots` (4, 4) are its blocks."""
    for i in range(4):
        for j in range(4):
            if slots[i, j] >= 0:
                for c in range(3):
                    for d in range(3):
                        J[slots[i, j], c, d] += factor * g[i, c] * g[j, d]


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
            for b in range(u):
                slot = start[e] + 4 * b + a
                slots[slot] = -1
                if i >= 0:
                    pair = find_sorted(block_nodes, block_ptr[i], block_ptr[i + 1], row[b])
                    if pair < 0:  # not found
                        return e
                    slots[slot] = blocks[pair]
    return -1
