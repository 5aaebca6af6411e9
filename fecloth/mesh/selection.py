"""Selection of nodes, edges and triangles by the name of a set, a predicate, or indices."""

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


def half_edges(cloth, where: Where) -> tuple[np.ndarray, np.ndarray]:
    """Return the half-edges (e,) of a curve, and which of them (e,) lie on the border.

    Half-edge 3 t + i leads from corner i of triangle t to the next corner, so that the triangle
    lies on its left. Of an inner edge, with a triangle on either side, it is the lower number.

    The name of an edge set selects its edges; any other `where`, as of `nodes`, selects the
    edges of the border both of whose ends are selected. Raises `InputError` as `nodes` does, and
    if no edge is selected.
    """
    corners = cloth.nodes(where)
    start = cloth.triangles.ravel().astype(np.int64)
    end = np.roll(cloth.triangles, -1, axis=1).ravel().astype(np.int64)
    keys, first, count = np.unique(
        _edge_keys(start, end, len(cloth.X)), return_index=True, return_counts=True
    )
    on_border = count == 1
    if isinstance(where, str) and where in cloth.edge_sets:
        a, b = cloth.edge_sets[where].T
        is_selected = np.isin(keys, _edge_keys(a, b, len(cloth.X)))
    else:
        has_both_ends = np.isin(start[first], corners) & np.isin(end[first], corners)
        is_selected = on_border & has_both_ends
    if not is_selected.any():
        by = "" if callable(where) else f" by {brief(where)}"
        allowed = "at least one edge of the border needs both ends among the nodes"
        remedy = "Inside a cloth, name a curve of the mesh file."
        raise InputError(f"no edge is selected{by}", allowed, "Cloth.half_edges", remedy)
    return first[is_selected], on_border[is_selected]


def _edge_keys(a: np.ndarray, b: np.ndarray, n: int) -> np.ndarray:
    """(e,) a number for each edge between nodes a and b (e,) of n, in either order."""
    keys: np.ndarray = np.minimum(a, b) * n + np.maximum(a, b)
    return keys


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
