"""Theoretical orders of convergence in h."""

from __future__ import annotations

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.simulation.quantity import Quantity
from fecloth.study.obstacles import has_bending
from fecloth.study.setups import Setup

ROUND = 0.5  # share of the corners of a boundary above which it is round


def space_order(quantity: Quantity, setup: Setup) -> float:
    """Return the theoretical order in h, for a smooth solution.

    That of linear triangles is 2, of gradients 1; of quadratic triangles 3, of gradients 2, and 4
    of energies, frequencies, areas, volumes and reactions. With bending or a round border of
    straight edges it is at most 2.

    Where a cloth without bending has tension in one direction only, point values of quadratic
    triangles reach 2: on a strip that pressure blows up between two held edges, h = 1/8 to 1/32,
    they were measured as 1.9, its energy as 3.9, with interpolated and pointwise strain; held all
    around, 3.4 to 3.6. `obstacles` names this.
    """
    is_gradient = quantity.norm == "h1" or quantity.name.endswith("stretch")
    if setup.cloth.element == "P1":
        return 1.0 if is_gradient else 2.0
    if has_bending(setup) or is_round(setup.cloth):
        return 2.0
    names = {*setup.system.names, "kinetic", "total", "area", "volume"}
    is_mean = quantity.how in ("mode", "period", "frequency") or quantity.column in names
    is_mean |= quantity.column.startswith("reaction")
    return 2.0 if is_gradient else 4.0 if is_mean else 3.0


def is_round(cloth: Cloth) -> bool:
    """Whether most corners of the border turn: a round shape, meshed with straight edges."""
    edges = cloth.edge_sets.get("boundary")
    if edges is None or not len(edges):
        return False
    vector = cloth.X[edges[:, 1]] - cloth.X[edges[:, 0]]
    vector /= np.linalg.norm(vector, axis=1, keepdims=True)
    nodes, both = edges.ravel(), np.repeat(vector, 2, axis=0)
    order = np.argsort(nodes, kind="stable")
    pairs = both[order][: len(order) // 2 * 2].reshape(-1, 2, 2)  # each node has two edges
    turning = np.abs(pairs[:, 0, 0] * pairs[:, 1, 1] - pairs[:, 0, 1] * pairs[:, 1, 0])
    return float(np.mean(turning > 1e-3)) > ROUND
