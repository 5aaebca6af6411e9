"""Selection of nodes and triangles by the name of a set, a predicate, or indices."""

from collections.abc import Callable

import numpy as np

from fecloth.errors import InputError, brief
from fecloth.validation import known

Where = str | np.ndarray | list[int] | Callable[[np.ndarray], np.ndarray]


def nodes(cloth, where: Where) -> np.ndarray:
    """Return the indices of nodes, each once.

    A list of indices keeps its order; otherwise the indices ascend. A named curve or region of
    P2 triangles includes the midpoints of its edges. Raises `InputError` if the set is unknown,
    an index is out of range, or no node is selected.

    Parameters
    ----------
    where
        The name of a node set, a list of indices, (n,) booleans, or a function of the
        coordinates X (n, 2) [m] that returns indices or booleans.
    """
    if isinstance(where, str):
        known(f"node set {where!r}", where, sorted(cloth.node_sets), "Cloth.nodes")
        return cloth.node_sets[where]
    if callable(where):
        selected = np.atleast_1d(where(cloth.X))
    else:
        selected = np.atleast_1d(where)
    if not selected.size:
        raise _empty_selection(cloth, where)  # an empty list has no integer type to check
    if selected.dtype == bool and selected.shape == (len(cloth.X),):
        selected = np.flatnonzero(selected)
    if selected.ndim != 1 or not np.issubdtype(selected.dtype, np.integer):
        what = f"nodes of type {selected.dtype} and shape {selected.shape}"
        allowed = f"must be the name of a set, indices, or {len(cloth.X)} booleans"
        raise InputError(what, allowed, "Cloth.nodes")
    if not selected.size:
        raise _empty_selection(cloth, where)
    if selected.min() < 0 or selected.max() >= len(cloth.X):
        what = f"node indices {selected.min()} … {selected.max()}"
        allowed = f"must be in 0 … {len(cloth.X) - 1}"
        raise InputError(what, allowed, "Cloth.nodes")
    _, first_places = np.unique(selected, return_index=True)
    return selected[np.sort(first_places)]  # each index once, in the order of the list


def region(cloth, where: str | Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the indices of triangles, in ascending order.

    Raises `InputError` if the region is unknown or contains no triangle.

    Parameters
    ----------
    where
        The name of a region, or a function of the centroids (m, 2) [m] that returns (m,)
        booleans.
    """
    if callable(where):
        selected = np.flatnonzero(where(cloth.X[cloth.triangles].mean(axis=1)))
    else:
        known(f"region {where!r}", where, sorted(cloth.triangle_sets), "Cloth.region")
        selected = cloth.triangle_sets[where]
    if not len(selected):
        raise InputError("no triangle is selected", "at least one is needed", "Cloth.region")
    return selected


def _empty_selection(cloth, where) -> InputError:
    is_function = hasattr(where, "__qualname__")
    by = "" if is_function else f" by {brief(where)}"
    left, low = cloth.X.min(axis=0)
    right, high = cloth.X.max(axis=0)
    span = f"The nodes have X from {left:.6g} to {right:.6g} m, Y from {low:.6g} to {high:.6g} m."
    return InputError(f"no node is selected{by}", "at least one is needed", "Cloth.nodes", span)
