"""Reading of mesh files of any format into validated flat meshes."""

import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fecloth import validation
from fecloth.errors import InputError, MeshError, amount
from fecloth.mesh.child_process import TIME_LIMIT, in_child
from fecloth.mesh.flat_mesh import FlatMesh
from fecloth.mesh.geo_commands import check_geo
from fecloth.mesh.grading import Grading, check_gradings
from fecloth.mesh.indices import MAX_LISTED, validated_indices
from fecloth.mesh.planes import rounding
from fecloth.mesh.raw_mesh import RawMesh
from fecloth.mesh.texture_reference import REFERENCES, possible_references

LFS = b"version https://git-lfs.github.com/"  # the beginning of a text in place of a file


def read(
    path,
    h: float | None = None,
    trust: bool = False,
    time_limit: float = TIME_LIMIT,
    grading: Sequence[Grading] = (),
    merge: bool = False,
    reference: str | None = None,
    scale: float = 1.0,
) -> FlatMesh:
    """Read a triangle mesh, or mesh a Gmsh geometry.

    Raises `MeshError` for a file that is missing, cannot be read or is not a valid flat mesh,
    and `InputError` for an h, a grading, a reference or a scale that does not fit the file.

    Parameters
    ----------
    path : str or path
        Gmsh meshes ``.geo`` files and reads ``.msh`` files (2.2, 4.1, text or binary). meshio
        reads all others (``.vtu``, ``.vtk``, ``.stl``, ``.ply``, ``.inp``, ``.xdmf`` with
        h5py, ...), except ``.obj``. PyVista, where it is installed, reads ``.vtp`` and
        ``.vtkhdf``, and a ``.vtk`` or ``.vtu`` that meshio cannot read.
    h : float, optional
        Edge length [m], for ``.geo`` only. It replaces the ``h`` of the file's
        ``DefineConstant[ h = ... ];``. In a file without this line it is both the lower and the
        upper limit of every size, so that the mesh is uniform. Default: the sizes of the file.
    trust : bool
        Whether a ``.geo`` file may hold any command of Gmsh, also commands that run programs and
        write files. Default: only the commands of `geo_commands.check_geo`.
    time_limit : float
        Seconds after which the process of its own, in which Gmsh and meshio work, is stopped.
    grading : sequence of Grading
        Places towards which the triangles become smaller, for ``.geo`` with h only. It replaces
        the sizes at points of the file; a file with size fields is refused.
    merge : bool
        Whether nodes closer than the rounding of the file become one node.
    reference : str, optional
        Of an ``.obj``: "v" or "vt", the coordinates that are the flat cloth. Of a frame "v" are
        its points. Default: see `texture_reference.possible_references`.
    scale : float
        Metres of a unit of the coordinates in the file; with the reference "vt", of `vt` alone.

    Returns
    -------
    FlatMesh
        Made by `FlatMesh.from_arrays`. Physical groups of points, curves and surfaces become
        node sets. Groups of curves also become edge sets. A group without a name is called
        ``curve_<tag>``, and likewise for points and surfaces. Groups with the same name are
        united. meshio's point and cell sets, and the names in ``field_data`` for
        ``gmsh:physical`` cell data, are read in the same way.

    Notes
    -----
    All triangles of the file belong to the cloth, in a physical surface or not. A triangle of
    several groups, as in ``.msh`` 2.2, is read once.

    Nodes of no triangle are removed if they only define the geometry. In ``.geo`` and ``.msh``
    files these are all such nodes (centres of circles, construction curves), in ``.obj`` files
    the nodes of no face, in other files the nodes of vertex and line cells. A set that contains
    a removed node is an error, unless the node lies between the corners of quadratic cells.

    Without `merge`, nodes at exactly the same position are merged in ``.stl`` files only,
    because this format has no shared nodes.

    `notes` of the mesh say what was done to the file.
    """
    path = Path(path)
    if not path.is_file():
        raise MeshError("no such file", where=str(path), remedy="Use the path of a mesh file.")
    _refuse_placeholder(path)
    if reference is not None:
        validation.known(f"reference = {reference!r}", reference, REFERENCES, str(path))
    validation.positive("scale", scale, "", str(path))
    suffix = path.suffix.lower()
    if h is not None and suffix != ".geo":
        kind = f"of type {suffix}" if suffix else "without suffix"
        what = f"h = {h!r} for a file {kind}"
        raise InputError(what, "is allowed for a .geo file only", str(path), "Omit h.")
    check_gradings(grading, str(path))
    if grading and h is None:
        raise InputError("grading", "is allowed for a .geo file with h only", str(path))
    if suffix == ".geo":
        raw = _from_geo(path, h, trust, time_limit, grading)
    elif suffix == ".msh":
        raw = _from_msh(path, time_limit)
    else:
        raw = in_child({"file": str(path.resolve())}, str(path), time_limit)
    if merge:
        raw = merge_nodes(raw)
    *first, last = possible_references(raw, reference, scale, str(path))
    for raw in first:
        with suppress(MeshError):
            return _to_flat_mesh(raw, str(path))
    return _to_flat_mesh(last, str(path))


def _refuse_placeholder(path: Path) -> None:
    """Raise `MeshError` for a text of Git that stands for a large file."""
    with path.open("rb") as file:
        if file.read(len(LFS)) == LFS:
            what = "a text of Git LFS that stands for the file"
            raise MeshError(what, "must be the mesh", str(path), "Fetch it: git lfs pull.")


def merge_nodes(raw: RawMesh) -> RawMesh:
    """Return the mesh whose nodes closer than the rounding of the file are one node."""
    n = len(raw.xyz)
    if not (n and np.isfinite(raw.xyz).all()):
        return raw  # `FlatMesh.from_arrays` says why not
    pairs = cKDTree(raw.xyz).query_pairs(rounding(raw.xyz), output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), np.int8), pairs.T), shape=(n, n))
    count, new = connected_components(graph, directed=False)
    kept = np.empty(count, int)
    kept[new[::-1]] = np.arange(n)[::-1]  # the first node at each position
    is_geometric = np.ones(count, bool)
    np.logical_and.at(is_geometric, new, raw.geometric)
    valid = ((raw.triangles >= 0) & (raw.triangles < n)).all()
    return replace(
        raw,
        xyz=raw.xyz[kept],
        triangles=new[raw.triangles] if valid else raw.triangles,
        node_sets={k: [new[s] for s in parts] for k, parts in raw.node_sets.items()},
        edge_sets={k: [new[s] for s in parts] for k, parts in raw.edge_sets.items()},
        node_ids=raw.node_ids[kept],
        geometric=is_geometric,
        between=None if raw.between is None else raw.between[kept],
        start=None if raw.start is None else raw.start[kept],
        notes=[*raw.notes, f"{amount(n - count, 'node')} merged with another at its position"],
    )


def _from_geo(
    path: Path, h: float | None, trust: bool, time_limit: float, grading: Sequence[Grading]
) -> RawMesh:
    """Mesh a geometry file as it is if `trust` is set, or else a checked copy of it.

    Raises `InputError` for a wrong h, and `MeshError` for a command that is not allowed or if
    Gmsh fails.
    """
    where = str(path)
    if h is not None:
        validation.length("h", h, where)
        h = float(h)
    task = {
        "geo": str(path.resolve()),
        "h": h,
        "confined": not trust,
        "grading": [asdict(place) for place in grading],
    }
    if trust:
        return in_child(task, where, time_limit)
    # Gmsh gets the text that was checked, also if the file changes meanwhile.
    text = check_geo(path.read_text(encoding="utf-8-sig", errors="replace"), where)
    with TemporaryDirectory(prefix="fecloth") as folder:
        copy = Path(folder, "cloth.geo")
        copy.write_text(text, encoding="utf-8")
        return in_child(task | {"geo": str(copy)}, where, time_limit)


def _from_msh(path: Path, time_limit: float) -> RawMesh:
    """Read a Gmsh mesh under another name: beside x.msh Gmsh would also run x.msh.opt."""
    with TemporaryDirectory(prefix="fecloth") as folder:
        copy = Path(folder, "cloth.msh")
        try:
            copy.symlink_to(path.resolve())
        except OSError:  # Windows, without the right to make links
            shutil.copyfile(path, copy)
        return in_child({"msh": str(copy)}, str(path), time_limit)


def _to_flat_mesh(raw: RawMesh, where: str) -> FlatMesh:
    """Return the mesh without the nodes that only define the geometry, and validate it.

    Raises `MeshError` for too many triangles, for a set that contains a removed node, and for
    all that `FlatMesh.from_arrays` refuses.
    """
    n = len(raw.xyz)
    triangles = raw.triangles
    if len(triangles) > validation.MOST_TRIANGLES:
        allowed = f"must be at most {validation.MOST_TRIANGLES}"
        remedy = "Take a coarser mesh."
        raise MeshError(amount(len(triangles), "triangle"), allowed, where, remedy)
    no_part = [np.empty(0, int)]
    nodes = {k: np.concatenate(parts or no_part) for k, parts in raw.node_sets.items()}
    edges = {k: np.concatenate(parts) for k, parts in raw.edge_sets.items()}
    in_mesh = ~raw.geometric
    in_mesh[triangles[(triangles >= 0) & (triangles < n)]] = True
    # Wrong numbers cannot be renumbered; they stay, and `from_arrays` refuses them.
    are_valid = triangles.size and triangles.min() >= 0 and triangles.max() < n
    if are_valid and not in_mesh.all():
        new = np.cumsum(in_mesh) - 1  # the new number of each node that stays
        for name, members in nodes.items():
            members = validated_indices(name, members, n, (), where)
            if raw.between is not None:
                members = members[~raw.between[members]]
            _check_inside(name, raw.node_ids[members[~in_mesh[members]]], where)
            nodes[name] = new[members]
        triangles = new[triangles]
        edges = {name: new[pairs] for name, pairs in edges.items()}
    else:
        in_mesh[:] = True
    mesh = FlatMesh.from_arrays(
        raw.xyz[in_mesh],
        triangles,
        node_sets=nodes,
        edge_sets=edges,
        where=where,
        node_ids=raw.node_ids[in_mesh],
        triangle_ids=raw.triangle_ids,
        triangle_sets=raw.triangle_sets,
    )
    start = None if raw.start is None else raw.start[in_mesh]
    return replace(mesh, start=start, element=raw.element, notes=(*raw.notes, *mesh.notes))


def _check_inside(name: str, outside: np.ndarray, where: str) -> None:
    """Raise `MeshError` if a set has nodes outside all triangles."""
    if outside.size:
        what = f"set {name!r} contains {amount(outside.size, 'node')} outside all triangles"
        what += f": {', '.join(map(str, outside[:MAX_LISTED]))}"
        raise MeshError(what, where=where, remedy="Embed them in the surface.")


def read_surface(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a surface in space: nodes (n, 3) [m] and triangles (m, 3).

    Nodes at exactly the same position are united, and triangles with two equal corners are left
    out. Raises `MeshError` for a file that is missing or has no triangles, and for coordinates
    that are not finite.
    """
    where = str(path)
    path = Path(path)
    if not path.is_file():
        raise MeshError("no such file", where=where)
    _refuse_placeholder(path)
    raw = in_child({"surface": str(path.resolve())}, where)
    used = validated_indices("triangle cells", raw.triangles.ravel(), len(raw.xyz), (), where)
    corners = raw.xyz[used]
    if not np.isfinite(corners).all():
        raise MeshError("coordinates that are not finite", "must be finite", where)
    nodes, number_of_corner = np.unique(corners, axis=0, return_inverse=True)
    triangles = number_of_corner.reshape(-1, 3)
    a, b, c = triangles.T
    return nodes, triangles[(a != b) & (b != c) & (a != c)]
