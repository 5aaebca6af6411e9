"""Mesh files of any format to validated flat meshes."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np

from fecloth.errors import InputError, MeshError
from fecloth.mesh.flat_mesh import FlatMesh, checked, set_indices
from fecloth.mesh.gmsh_import import RawMesh, from_geo, from_msh, refuse_cells


def read(path, h: float | None = None) -> FlatMesh:
    """Read a triangle mesh, or mesh a Gmsh geometry.

    Parameters
    ----------
    path : str or path
        ``.geo`` is meshed by Gmsh, ``.msh`` (2.2, 4.1, text or binary) read by it, anything else
        read by meshio (``.vtu``, ``.vtk``, ``.obj``, ``.stl``, ``.inp``, ``.xdmf`` with h5py, ...).
    h : float, optional
        Edge length [m], for ``.geo`` only. It replaces the ``h`` of the file's
        ``DefineConstant[ h = ... ];``; in a file without one it bounds every size from below and
        above, so the mesh is uniform. Default: the file's own sizes.

    Returns
    -------
    FlatMesh
        Validated as by `checked`. Physical groups of points, curves and surfaces become node
        sets, those of curves also edge sets; an unnamed group is called ``curve_<tag>`` and so
        on, groups of one name are united. meshio's point and cell sets, and names in
        ``field_data`` for ``gmsh:physical`` cell data, do the same.

    Notes
    -----
    All triangles of the file are the cloth, whether or not in a physical surface. Nodes used by
    no triangle are dropped if they serve the geometry only: all such nodes of ``.geo`` and
    ``.msh`` files (centres of circles, construction curves), elsewhere those of vertex and line
    cells; but a set that names one is an error. Nodes at exactly the same place are merged in
    ``.stl`` files, a format without shared nodes, and nowhere else. In ``.msh`` 2.2, triangles
    repeated because their surface is in several groups are read once.

    Raises
    ------
    InputError
        ``h`` that is not positive and finite, larger than the sheet, or given for another file.
    MeshError
        A file that is missing or unreadable, cells other than triangles, lines and points, empty
        groups, and everything that `checked` refuses; messages use the file's own numbers.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> file = pathlib.Path(tempfile.mkdtemp(), "sheet.obj")
    >>> _ = file.write_text("v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n")
    >>> read(file).triangles.tolist()
    [[0, 1, 2]]
    """
    path = Path(path)
    if not path.is_file():
        raise MeshError("no such file", where=str(path), remedy="Give the path of a mesh file.")
    suffix = path.suffix.lower()
    if h is not None and suffix != ".geo":
        what = f"h = {h!r} for a {suffix or 'nameless'} file"
        raise InputError(what, "only a .geo file is meshed", str(path), "Leave h out.")
    if suffix == ".geo":
        raw = from_geo(path, h)
    else:
        raw = from_msh(path) if suffix == ".msh" else _from_meshio(path, suffix)
    return _assembled(raw, str(path))


def _assembled(raw: RawMesh, where: str) -> FlatMesh:
    """Drop unused nodes of the geometry, refuse sets that name one, check the rest."""
    n, t = len(raw.xyz), raw.triangles
    nodes = {k: np.concatenate(v) if v else np.empty(0, int) for k, v in raw.node_sets.items()}
    edges = {k: np.concatenate(v) for k, v in raw.edge_sets.items()}
    kept = ~raw.geometric
    kept[t[(t >= 0) & (t < n)]] = True
    if not kept.all() and t.size and t.min() >= 0 and t.max() < n:
        new = np.cumsum(kept) - 1
        for name, members in nodes.items():
            members = set_indices(name, members, n, (), where)
            lost = raw.node_ids[members[~kept[members]]]
            if lost.size:
                what = f"set {name!r} names {lost.size} nodes outside all triangles"
                what += f": {', '.join(map(str, lost[:5]))}"
                raise MeshError(what, where=where, remedy="Embed them in the surface.")
            nodes[name] = new[members]
        t, edges = new[t], {name: new[pairs] for name, pairs in edges.items()}
    else:
        kept[:] = True
    ids, xyz = raw.node_ids[kept], raw.xyz[kept]
    regions = raw.triangle_sets
    return checked(xyz, t, nodes, edges, where, ids, raw.triangle_ids, regions)


def _from_meshio(path: Path, suffix: str) -> RawMesh:
    where = str(path)
    mesh = _meshio_mesh(path, suffix)
    refuse_cells(
        {b.type: len(b) for b in mesh.cells if b.type not in ("triangle", "line", "vertex")},
        where,
    )
    blocks = [b.data for b in mesh.cells if b.type == "triangle"]
    triangles = np.concatenate(blocks) if blocks else np.empty((0, 3), dtype=int)
    nodes, edges = _meshio_sets(mesh, where)
    n, m = len(mesh.points), len(triangles)
    geometric = np.zeros(n, dtype=bool)
    for block in mesh.cells:
        if block.type != "triangle":
            geometric[set_indices(f"{block.type} cells", block.data.ravel(), n, (), where)] = True
    return RawMesh(mesh.points, triangles, nodes, edges, np.arange(n), np.arange(m), geometric)


def _meshio_mesh(path: Path, suffix: str):
    import meshio

    known = meshio.extension_to_filetypes
    if suffix not in known:
        remedy = "Convert it, for instance to .vtu by meshio."
        raise MeshError(f"unknown suffix {suffix!r}", f"one of {sorted(known)}", str(path), remedy)
    chatter = io.StringIO()
    try:
        with contextlib.redirect_stdout(chatter), contextlib.redirect_stderr(chatter):
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio exits on a file that it cannot read
        said = " ".join(chatter.getvalue().split()) or error
        raise MeshError(f"meshio cannot read it ({said})", where=str(path)) from error


def _meshio_sets(mesh, where):
    """Node indices and node pairs of point sets, cell sets and named gmsh:physical numbers."""
    nodes = {name: [np.asarray(s)] for name, s in mesh.point_sets.items()}
    edges = {}
    cells = {name: list(s) for name, s in mesh.cell_sets.items() if not name.startswith("gmsh:")}
    physical = mesh.cell_data.get("gmsh:physical", [])
    for name, value in mesh.field_data.items():
        if physical and name not in cells and np.shape(value) == (2,):
            tag, dim = value
            found = zip(mesh.cells, physical, strict=True)
            cells[name] = [np.flatnonzero((d == tag) & (b.dim == dim)) for b, d in found]
    for name, members in cells.items():
        nodes.setdefault(name, [])
        for block, chosen in zip(mesh.cells, members, strict=True):
            if chosen is None or len(chosen) == 0:
                continue
            corners = block.data[set_indices(name, chosen, len(block), (), where)]
            nodes[name].append(corners.ravel())
            if block.type == "line":
                edges.setdefault(name, []).append(corners)
    return nodes, edges
