"""Compiled loops over points inside triangles: values from nodes, and what goes back to them."""

from __future__ import annotations

from fecloth.compiled.jit import Array, kernel


@kernel
def find_near(
    triangles: Array, stencil: Array, size: Array, at_nodes: Array, reach: Array, near: Array
) -> int:
    """Write the numbers of points whose triangle has a node nearer than `reach` plus `size`.

    `triangles` (p,) is sorted, or nearly; `reach` has one entry, or one a node. Returns how many.
    """
    count, last, is_near, each = 0, -1, False, len(reach) > 1
    for p in range(len(triangles)):
        e = triangles[p]
        if e != last:
            last, is_near = e, False
            for a in range(stencil.shape[1]):
                node = stencil[e, a]
                if at_nodes[node] - reach[node if each else 0] < size[e]:
                    is_near = True
        if is_near:
            near[count] = p
            count += 1
    return count


@kernel
def gather(
    which: Array, triangles: Array, N: Array, stencil: Array, of_nodes: Array, values: Array
) -> None:
    """values (p, 3) = Σ_a N_a of_nodes[a] of some of the points."""
    for i in range(len(which)):
        p = which[i]
        e = triangles[p]
        v0 = v1 = v2 = 0.0
        for a in range(stencil.shape[1]):
            node, share = stencil[e, a], N[p, a]
            v0 += share * of_nodes[node, 0]
            v1 += share * of_nodes[node, 1]
            v2 += share * of_nodes[node, 2]
        values[i, 0], values[i, 1], values[i, 2] = v0, v1, v2


@kernel
def add_forces(
    which: Array, triangles: Array, N: Array, stencil: Array, F: Array, f: Array
) -> None:
    """f (n, 3) += N_a F of some of the points."""
    for i in range(len(which)):
        p = which[i]
        e = triangles[p]
        for a in range(stencil.shape[1]):
            node, share = stencil[e, a], N[p, a]
            for c in range(3):
                f[node, c] += share * F[i, c]


@kernel
def add_tangents(
    which: Array, triangles: Array, N: Array, slots: Array, K: Array, values: Array
) -> None:
    """The blocks of the matrix += N_a N_b K of some of the points."""
    for i in range(len(which)):
        p = which[i]
        e = triangles[p]
        for a in range(slots.shape[1]):
            for b in range(slots.shape[2]):
                share, slot = N[p, a] * N[p, b], slots[e, a, b]
                if share != 0.0:
                    for c in range(3):
                        for d in range(3):
                            values[slot, c, d] += share * K[i, c, d]
