"""Check of the node numbers of a file, without any package but NumPy, for a quick start."""

import numpy as np
from numpy.typing import ArrayLike

from fecloth.errors import MeshError

MAX_LISTED = 5  # wrong nodes or triangles that a message lists, to stay short


def validated_indices(
    name: str, values: ArrayLike, n: int, columns: tuple[int, ...], where: str
) -> np.ndarray:
    """Return the indices of a set, (k, *columns).

    Raises `MeshError` for an empty set, another shape, and indices that are not in 0 … n − 1.
    """
    values = np.asarray(values)
    if values.size == 0:
        allowed = "must contain a node"
        raise MeshError(f"set {name!r} is empty", allowed, where, "Remove or fill it.")
    if values.dtype.kind not in "iu" or values.ndim != len(columns) + 1:
        what = f"set {name!r} has shape {values.shape} and type {values.dtype}"
        raise MeshError(what, f"must be integers, {1 + len(columns)} axes", where)
    if values.shape[1:] != columns:
        raise MeshError(f"edge set {name!r} has shape {values.shape}", "must be (k, 2)", where)
    bad = values[(values < 0) | (values >= n)]
    if bad.size:
        listed = ", ".join(map(str, bad[:MAX_LISTED]))
        if bad.size > MAX_LISTED:
            listed += ", ..."
        what = f"set {name!r} contains {bad.size} indices out of range: {listed}"
        raise MeshError(what, f"must be 0 to {n - 1}", where)
    return values.astype(np.intp)
