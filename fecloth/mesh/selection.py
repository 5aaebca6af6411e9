"""Which nodes and triangles of a cloth are meant: a set's name, a predicate, or their indices."""

from __future__ import annotations

import numpy as np

from fecloth.errors import InputError
from fecloth.suggest import did_you_mean


def nodes(cloth, where) -> np.ndarray:
    """Distinct node indices; see `Cloth.nodes`."""
    if isinstance(where, str):
        if where not in cloth.node_sets:
            raise InputError(
                f"node set {where!r}",
                f"must be one of {', '.join(sorted(cloth.node_sets)) or '(none)'}",
                "Cloth.nodes",
                did_you_mean(where, cloth.node_sets),
            )
        return cloth.node_sets[where]
    chosen = np.atleast_1d(where(cloth.X) if callable(where) else where)
    if not chosen.size:
        raise _no_node(cloth)
    if chosen.dtype == bool and chosen.shape == (len(cloth.X),):
        chosen = np.flatnonzero(chosen)
    if chosen.ndim != 1 or not np.issubdtype(chosen.dtype, np.integer):
        raise InputError(
            f"nodes of type {chosen.dtype} and shape {chosen.shape}",
            f"must be a set's name, indices, or {len(cloth.X)} booleans",
            "Cloth.nodes",
        )
    if not chosen.size:
        raise _no_node(cloth)
    if chosen.min() < 0 or chosen.max() >= len(cloth.X):
        raise InputError(
            f"node indices {chosen.min()} … {chosen.max()}",
            f"must lie in 0 … {len(cloth.X) - 1}",
            "Cloth.nodes",
        )
    _, first = np.unique(chosen, return_index=True)
    return chosen[np.sort(first)]


def triangles(cloth, where) -> np.ndarray:
    """Triangle indices; see `Cloth.region`."""
    if callable(where):
        chosen = np.flatnonzero(where(cloth.X[cloth.triangles].mean(axis=1)))
    elif where in cloth.triangle_sets:
        chosen = cloth.triangle_sets[where]
    else:
        allowed = f"must be one of {', '.join(sorted(cloth.triangle_sets)) or '(none)'}"
        remedy = did_you_mean(where, cloth.triangle_sets)
        raise InputError(f"region {where!r}", allowed, "Cloth.region", remedy)
    if not len(chosen):
        raise InputError("the choice of triangles is empty", "needs one", "Cloth.region")
    return chosen


def _no_node(cloth) -> InputError:
    (left, low), (right, high) = cloth.X.min(axis=0), cloth.X.max(axis=0)
    span = f"The nodes have X from {left:.6g} to {right:.6g} m, Y from {low:.6g} to {high:.6g} m."
    return InputError("the choice of nodes is empty", "needs a node", "Cloth.nodes", span)
