"""Which coordinates of an .obj are the flat cloth: its nodes `v`, or its texture `vt`."""

from dataclasses import replace

import numpy as np

from fecloth.errors import InputError, MeshError, amount
from fecloth.mesh.planes import flatten
from fecloth.mesh.raw_mesh import RawMesh

MOST_STRETCH = 1.2  # of an edge from `vt` to `v`, or back, for `vt` to be the cloth by itself
REFERENCES = ("v", "vt")
KEYS = 'reference = "vt" takes the cloth from vt, with scale = the metres of a unit of vt'


def choose_reference(raw: RawMesh, reference: str | None, scale: float, where: str) -> RawMesh:
    """Return the mesh whose xyz are the flat coordinates, multiplied by the `scale`.

    They are `vt` with the `reference` "vt", and `v` with "v". Without a `reference` they are
    `vt` if no edge is longer or shorter than in `v` by more than `MOST_STRETCH`, and else `v`.
    Where they are `vt`, `v` is the start. It is scaled, too, if it has the unit of `vt`.

    Raises `InputError` for "vt" in a file without `vt`, and `MeshError` for a `v` that is not
    flat beside a `vt` of other lengths.
    """
    if reference == "vt" and raw.vt is None:
        what = 'reference = "vt" for a file without vt in all its faces'
        raise InputError(what, "needs an .obj with texture coordinates", where, "Omit reference.")
    if reference == "v" and raw.start is not None:  # a frame, in its present shape
        raw = replace(raw, xyz=raw.start, start=None)
    if raw.vt is None or reference == "v":
        return replace(raw, xyz=scale * raw.xyz)
    stretch = _largest_stretch(raw)
    has_same_unit = stretch <= MOST_STRETCH
    if reference == "vt" or has_same_unit:
        v_scale = scale if has_same_unit else 1.0
        return _by_texture(raw, scale, v_scale, asked=reference == "vt")
    note = f"vt not used: its edges differ from those of v up to {stretch:.3g} times; {KEYS}"
    try:
        flatten(raw.xyz[np.unique(raw.triangles)], where)
    except MeshError as error:
        raise MeshError(error.what, error.allowed, where, f"{note}.") from error
    return replace(raw, xyz=scale * raw.xyz, notes=[*raw.notes, note])


def _largest_stretch(raw: RawMesh) -> float:
    """Return the largest ratio of the lengths of an edge in `v` and in `vt`; at least 1."""
    lengths = []
    for points, triangles in ((raw.xyz, raw.triangles), (raw.vt, raw.vt_triangles)):
        corners = points[triangles]
        lengths.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = lengths[0] / lengths[1]
        largest = float(np.maximum(ratio, 1 / ratio).max())
    return largest if np.isfinite(largest) else np.inf


def _by_texture(raw: RawMesh, scale: float, v_scale: float, asked: bool) -> RawMesh:
    """Return the mesh whose nodes are the different pairs of a node and its `vt`.

    A node with several `vt`, where the texture is cut, becomes several nodes.
    """
    corners = np.column_stack([raw.triangles.ravel(), raw.vt[raw.vt_triangles.ravel()]])
    pairs, triangles = np.unique(corners, axis=0, return_inverse=True)
    node = pairs[:, 0].astype(int)
    why = "" if asked else " (by itself, as their edges agree within 20 %)"
    note = f"vt is the flat cloth, and v the start{why}"
    if more := len(node) - len(np.unique(node)):
        note += f"; {amount(more, 'node')} added where the texture is cut"
    return replace(
        raw,
        xyz=scale * pairs[:, 1:],
        triangles=triangles.reshape(-1, 3),
        node_ids=raw.node_ids[node],
        geometric=np.zeros(len(node), bool),
        start=v_scale * raw.xyz[node],
        notes=[*raw.notes, note],
    )
