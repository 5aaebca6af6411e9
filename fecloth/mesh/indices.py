"""Check of the node numbers of a file, without any package but NumPy, for a quick start."""

import numpy as np
from numpy.typing import ArrayLike

from fecloth.errors import MeshError

MAX_LISTED = 5  # wrong nodes or triangles that a message lists, to stay short


def validated_indices(
    name: str, values: ArrayLike, n: int, columns: tuple[int, ...], where: str
) -> np.ndarray:
    """Return the indices of the set `name` as integers of shape (k, *columns).

    `columns` is () for a set of nodes or triangles, and (2,) for a set of edges. Raises `MeshError`
    for an empty set, for another shape or type, and for indices that are not in 0 … n − 1;
    `where` is the file or function, for the message.
    """
    values = np.asarray(values)
    if values.size == 0:
        allowed = "must contain a node"
        raise MeshError(f"set {name!r} is empty", allowed, where, "Remove or fill it.")
    if values.dtype.kind not in "iu" or values.ndim != len(columns) + 1:
        what = f"set {name!r} has shape {values.shape} and type {values.dtype}"
        remedy = "Write np.flatnonzero(mask)." if values.dtype == bool else ""
        raise MeshError(what, f"must be integers, {1 + len(columns)} axes", where, remedy)
    if values.shape[1:] != columns:
        raise MeshError(f"edge set {name!r} has shape {values.shape}", "must be (k, 2)", where)
    out_of_range = values[(values < 0) | (values >= n)]
    if out_of_range.size:
        listed = ", ".join(map(str, out_of_range[:MAX_LISTED]))
        if out_of_range.size > MAX_LISTED:
            listed += ", ..."
        what = f"set {name!r} contains {out_of_range.size} indices out of range: {listed}"
        raise MeshError(what, f"must be 0 to {n - 1}", where)
    return values.astype(np.intp)
