"""How far the lowest point of a cloth may lie beyond its lowest node."""

from __future__ import annotations

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.simulation.quantity_values import size_of
from fecloth.study.tuning.trials import ZERO, Bench, Trial

INSIDE, BORDER = 1 / 3, 1 / 4  # of the mean drop to the neighbours
PARTS = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))  # of a P2 triangle: corners, then midpoints


def unsampled(bench: Bench, trial: Trial) -> np.ndarray:
    """Return (q,) relative errors of `sag` because it is that of a node; 0 of other quantities.

    Two meshes may have nodes equally near to the lowest point by accident, so that their values
    agree although both are wrong. Where the cloth is round, −½ κ r² about its lowest point, the
    nodes around any node lie ½ κ h² deeper on average than it, and the lowest point is at most
    h/√3 from a node: a third of this drop. On the border it is h/2: a quarter.
    """
    found = np.zeros(len(bench.quantities))
    for k, (quantity, record) in enumerate(zip(bench.quantities, trial.records, strict=True)):
        if quantity.name == "sag":
            depth = -np.array(trial.row["displacement"])[:, 2]
            found[k] = drop_to_neighbours(trial.cloth, depth) / max(size_of(quantity, record), ZERO)
    return found


def drop_to_neighbours(cloth: Cloth, depth: np.ndarray) -> float:
    """Return how far the largest value of (n,) nodal ones may lie below that of the cloth."""
    lowest = int(np.argmax(depth))
    triangles = cloth.stencil
    if triangles.shape[1] == 6:
        triangles = np.concatenate([triangles[:, part] for part in PARTS])
    around = np.unique(triangles[(triangles == lowest).any(axis=1)])
    border = cloth.nodes("boundary")
    is_inside = lowest not in border
    around = around if is_inside else np.intersect1d(around, border)
    part = INSIDE if is_inside else BORDER
    return part * float(depth[lowest] - depth[around[around != lowest]].mean())
