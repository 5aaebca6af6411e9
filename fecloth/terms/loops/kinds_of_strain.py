"""Kinds of strain: what `membrane_loops` inserts for the calls in its templates.

The functions are not called, and have the parameters and meaning that the docstring there
gives each name. Pointwise strains have one F and one E at each quadrature point. Of E_h the
forms A of a point, as rows B of the nodes' positions u, take the place of F (`regge_strain`).
"""

# mypy: allow-untyped-defs

from collections.abc import Callable
from typing import Any

import numpy as np

from fecloth.terms.loops.green_strain import (
    clamp,
    gradient,
    green_strain,
    scatter_force,
    scatter_mixed,
    scatter_symmetric,
    strain_rate,
)
from fecloth.terms.loops.regge_strain import (
    NODES,
    POINTS,
    contract_rows,
    fill_rows,
    gather,
    scatter_geometric,
    scatter_material,
)
from fecloth.terms.loops.regge_strain import scatter_force as scatter_rows

Kind = dict[str, Callable[..., Any]]
"""A kind of strain: plain functions by their names in the templates."""


# --- pointwise ------------------------------------------------------------------------------------


def no_scratch():
    return None, None, None


def no_tangent_scratch():
    return None, None


def load_nothing(nodes, e, x, y, u, r):
    pass


def load_no_motion(nodes, e, v, r):
    pass


def pointwise_strain(per_node, nodes, A, e, q, x, y, u, r, B):
    F = gradient(per_node, nodes, A, e, q, x)
    return F, green_strain(F)


def rested_strain(per_node, nodes, A, e, q, x, y, u, r, B):
    F = gradient(per_node, nodes, A, e, q, x)
    E11, E22, E12 = green_strain(F)
    return F, (E11 - y[e, q, 0], E22 - y[e, q, 1], E12 - y[e, q, 2])


def pointwise_rate(per_node, nodes, A, e, q, x, y, u, r, B):
    F = gradient(per_node, nodes, A, e, q, x)
    return F, strain_rate(F, gradient(per_node, nodes, A, e, q, y))


def push_pointwise(per_node, nodes, A, e, q, w, F, B, S, f):
    scatter_force(per_node, nodes, A, e, q, w, F, S, f)


def weigh_elastic(w, wx, wv, S, C):
    return wx * w, S, C


def weigh_viscous(w, wx, wv, S, C):
    moduli = (wv * C[0], wv * C[1], wv * C[2], wv * C[3], wv * C[4], wv * C[5])
    return w, (wx * S[0], wx * S[1], wx * S[2]), moduli


def stiffen_pointwise(per_node, slots, A, e, q, w, floor, F, B, T, S, C, J):
    scatter_symmetric(per_node, slots, A, e, q, w, F, clamp(S, floor), C, J)


def mix_pointwise(
    per_node, nodes, slots, A, e, q, w, wx, wv, mixed, F, v, r, B, R, T, S, C, J
):  # fmt: skip
    H = gradient(per_node, nodes, A, e, q, v)
    right = (
        wv * F[0] + mixed * H[0],
        wv * F[1] + mixed * H[1],
        wv * F[2] + mixed * H[2],
        wv * F[3] + mixed * H[3],
        wv * F[4] + mixed * H[4],
        wv * F[5] + mixed * H[5],
    )
    weighed = (wx * S[0], wx * S[1], wx * S[2])
    scatter_mixed(per_node, slots, A, e, q, w, F, right, weighed, C, J)


def add_means_by_weight(e, w, area, values, out):
    share = w / area
    for k in range(len(values)):
        out[e, k] += share * values[k]


POINTWISE: Kind = {
    "scratch": no_scratch,
    "tangent_scratch": no_tangent_scratch,
    "load": load_nothing,
    "load_motion": load_no_motion,
    "strain": pointwise_strain,
    "push": push_pointwise,
    "weigh": weigh_elastic,
    "stiffen": stiffen_pointwise,
    "mix": mix_pointwise,
    "add_means": add_means_by_weight,
}
RESTED: Kind = POINTWISE | {"strain": rested_strain}
RATE: Kind = POINTWISE | {"strain": pointwise_rate, "weigh": weigh_viscous}


# --- E_h ------------------------------------------------------------------------------------------


def work_space():
    return np.empty((NODES, 3)), np.empty((NODES, 3)), np.empty((3, NODES, 3))


def tangent_work_space():
    return np.empty((3, NODES, 3)), np.empty((3, NODES, 3))


def load_positions(nodes, e, x, y, u, r):
    gather(nodes, e, x, u)


def load_positions_and_velocities(nodes, e, x, y, u, r):
    gather(nodes, e, x, u)
    gather(nodes, e, y, r)


def load_motion(nodes, e, v, r):
    gather(nodes, e, v, r)


def regge_strain(per_node, nodes, A, e, q, x, y, u, r, B):
    fill_rows(A[e, q], u, B)
    h = contract_rows(B, u)
    E = 0.5 * h[0] - y[e, q, 0], 0.5 * h[1] - y[e, q, 1], 0.5 * h[2] - y[e, q, 2]
    return None, E


def regge_rate(per_node, nodes, A, e, q, x, y, u, r, B):
    fill_rows(A[e, q], u, B)
    return None, contract_rows(B, r)


def push_rows(per_node, nodes, A, e, q, w, F, B, S, f):
    scatter_rows(nodes, e, w, S, B, f)


def stiffen_rows(per_node, slots, A, e, q, w, floor, F, B, T, S, C, J):
    scatter_material(slots, e, w, B, C, B, T, J)
    scatter_geometric(slots, e, w, S, A[e, q], J)


def mix_rows(per_node, nodes, slots, A, e, q, w, wx, wv, mixed, F, v, r, B, R, T, S, C, J):
    fill_rows(A[e, q], r, R)
    R[:] = wv * B + mixed * R
    scatter_material(slots, e, w, B, C, R, T, J)
    scatter_geometric(slots, e, wx * w, S, A[e, q], J)


def add_equal_means(e, w, area, values, out):
    for k in range(len(values)):
        out[e, k] += values[k] / POINTS


REGGE: Kind = {
    "scratch": work_space,
    "tangent_scratch": tangent_work_space,
    "load": load_positions,
    "load_motion": load_motion,
    "strain": regge_strain,
    "push": push_rows,
    "weigh": weigh_elastic,
    "stiffen": stiffen_rows,
    "mix": mix_rows,
    "add_means": add_equal_means,
}
REGGE_RATE: Kind = REGGE | {"load": load_positions_and_velocities, "strain": regge_rate}
