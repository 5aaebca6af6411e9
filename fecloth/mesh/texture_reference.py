"""Which coordinates of an .obj are the flat cloth: its nodes `v`, or its texture `vt`."""

from dataclasses import replace

import numpy as np

from fecloth.errors import InputError, MeshError, amount
from fecloth.mesh.planes import flatten
from fecloth.mesh.raw_mesh import RawMesh

MOST_STRETCH = 1.2  # of an edge from `vt` to `v`, or back, for `vt` to be the cloth by itself
REFERENCES = ("v", "vt")
KEYS = 'reference = "vt" takes the cloth from vt, with scale = the metres of a unit of vt'


def possible_references(
    raw: RawMesh, reference: str | None, scale: float, where: str
) -> list[RawMesh]:
    """Return the meshes whose xyz are the flat coordinates, times the `scale`; the best first.

    The flat coordinates are `vt` with the `reference` "vt", and `v` with "v". Without a
    `reference` they are `vt` if no edge is longer or shorter than in `v` by more than
    `MOST_STRETCH`, and else `v`. A flat `v` is also the second choice, for a `vt` that is cut
    or overlaps. Where they are `vt`, `v` is the start. The `scale` is the scale of both
    `v` and `vt`; with the `reference` "vt" it scales `vt` alone.

    Raises `InputError` for "vt" in a file without `vt`, and `MeshError` for a `v` that is not
    flat beside a `vt` of other lengths.
    """
    vt, vt_triangles = raw.vt, raw.vt_triangles
    if reference == "vt" and vt is None:
        what = 'reference = "vt" for a file without vt in all its faces'
        raise InputError(what, "needs an .obj with texture coordinates", where, "Omit reference.")
    if reference == "v" and raw.start is not None:  # a frame, in its present shape
        raw = replace(raw, xyz=raw.start, start=None)
    if reference == "v" or vt is None or vt_triangles is None:
        return [replace(raw, xyz=scale * raw.xyz)]
    if not (np.isfinite(vt).all() and np.isfinite(raw.xyz).all()):
        # `FlatMesh.from_arrays` refuses it.
        return [replace(raw, xyz=scale * raw.xyz)]
    stretch = _largest_stretch(raw, vt[vt_triangles])
    agrees = stretch <= MOST_STRETCH
    v_scale = 1.0 if reference == "vt" else scale
    by_texture = _by_texture(raw, vt[vt_triangles], scale, v_scale)
    if reference == "vt":
        return [by_texture]
    if agrees:
        why = "it is cut or overlaps"
    else:
        why = f"its edges differ from those of v up to {stretch:.3g} times"
    note = f"vt not used: {why}; {KEYS}"
    by_nodes = replace(raw, xyz=scale * raw.xyz, notes=[*raw.notes, note])
    try:
        flatten(raw.xyz[np.unique(raw.triangles)], where)
    except MeshError as error:
        if agrees:
            return [by_texture]
        raise MeshError(error.what, error.allowed, where, f"{note}.") from error
    return [by_texture, by_nodes] if agrees else [by_nodes]


def _largest_stretch(raw: RawMesh, vt: np.ndarray) -> float:
    """Return the largest ratio of the lengths of an edge in `v` and in `vt`; at least 1.

    `vt` (m, 3, 2) are the texture coordinates of the corners of the triangles.
    """
    lengths = []
    for corners in (raw.xyz[raw.triangles], vt):
        lengths.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = lengths[0] / lengths[1]
        largest = float(np.maximum(ratio, 1 / ratio).max())
    return largest if np.isfinite(largest) else np.inf


def _by_texture(raw: RawMesh, vt: np.ndarray, scale: float, v_scale: float) -> RawMesh:
    """Return the mesh whose nodes are the different pairs of a node and its `vt`.

    `vt` (m, 3, 2) are the texture coordinates of the corners. A node with several, where the
    texture is cut, becomes several nodes.
    """
    corners = np.column_stack([raw.triangles.ravel(), vt.reshape(-1, 2)])
    pairs, triangles = np.unique(corners, axis=0, return_inverse=True)
    node = pairs[:, 0].astype(int)
    note = "vt is the flat cloth, and v the start"
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
