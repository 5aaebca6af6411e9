"""Mesh files of other programs: .obj by itself, other formats by meshio, or by PyVista.

PyVista reads the files of VTK that meshio cannot read, where it is installed.
"""

import io
import re
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fecloth import validation
from fecloth.errors import MeshError
from fecloth.mesh.cells import Cells, triangles_of
from fecloth.mesh.indices import validated_indices
from fecloth.mesh.obj_file import read_obj
from fecloth.mesh.raw_mesh import RawMesh

MOST_NODES = 3 * validation.MOST_TRIANGLES  # as many as triangles without common nodes have
_CORNERS = {"vertex": 1, "line": 2, "triangle": 3, "quad": 4}
# The cells of VTK by their numbers, in meshio's words.
_OF_VTK = {
    1: "vertex",
    3: "line",
    5: "triangle",
    9: "quad",
    21: "line3",
    22: "triangle6",
    23: "quad8",
    28: "quad9",
    34: "triangle7",
}
_BY_PYVISTA = (".vtk", ".vtu", ".vtp", ".vtkhdf")
REFERENCE = "reference"  # the point data of fecloth's frames with their flat coordinates


class FileMesh(NamedTuple):
    """A file as it is: points (n, 2 or 3) [m], cells, arrays at the points, and its sets.

    The sets are lists of node indices and lists of node pairs, each by its name.
    """

    points: np.ndarray
    blocks: list[Cells]
    point_data: dict[str, np.ndarray]
    node_sets: dict[str, list[np.ndarray]]
    edge_sets: dict[str, list[np.ndarray]]


def read_file(path: Path, where: str) -> RawMesh:
    """Return the mesh of a file of triangles and quadrilaterals, with its sets.

    Raises `MeshError` for other cells and for cells with wrong node numbers. The nodes of lines
    and points are marked as geometric: they are removed if no triangle uses them. A frame of
    fecloth gives its flat coordinates, and its points as the start.
    """
    if path.suffix.lower() == ".obj":
        return read_obj(path, where)
    mesh = _read(path, where)
    flat = mesh.point_data.get(REFERENCE)
    is_frame = flat is not None and flat.shape in ((len(mesh.points), 2), (len(mesh.points), 3))
    xyz = np.asarray(flat, dtype=float) if is_frame else mesh.points
    raw = _make_raw(xyz, mesh, where)
    if is_frame:
        note = f"a frame: X is its point data {REFERENCE!r}, and its points are the start"
        return replace(raw, start=mesh.points, notes=[note, *raw.notes])
    return raw


def read_surface(path: Path, where: str) -> RawMesh:
    """Return the nodes and triangles of a file, which may hold other cells."""
    if path.suffix.lower() == ".obj":
        return read_obj(path, where)
    mesh = _read(path, where)
    flat_blocks = [block for block in mesh.blocks if block.corners > 2]
    return _make_raw(mesh.points, mesh._replace(blocks=flat_blocks), where)


def _make_raw(xyz: np.ndarray, mesh: FileMesh, where: str) -> RawMesh:
    """Return the nodes and triangles of a file, numbered from 0, with its sets."""
    n = len(xyz)
    triangles = triangles_of(xyz, mesh.blocks, where)
    is_geometric = triangles.between.copy()
    for block in mesh.blocks:
        if block.corners < 3:
            used = validated_indices(f"{block.kind} cells", block.nodes.ravel(), n, (), where)
            is_geometric[used] = True
    return RawMesh(
        xyz=xyz,
        triangles=triangles.nodes,
        node_sets=mesh.node_sets,
        edge_sets=mesh.edge_sets,
        node_ids=np.arange(n),
        triangle_ids=triangles.cell,
        geometric=is_geometric,
        between=triangles.between,
        element=triangles.element,
        notes=triangles.notes,
    )


def _read(path: Path, where: str) -> FileMesh:
    """Read a file by meshio; by PyVista if meshio cannot read it and it is one of VTK's.

    Raises `MeshError` for a suffix that neither knows, for a file that cannot be read or that
    takes too much memory, and for more than `MOST_NODES` nodes.
    """
    import meshio

    suffix = path.suffix.lower()
    suffixes = {*meshio.extension_to_filetypes, *_BY_PYVISTA}
    if suffix not in suffixes:
        allowed = f"must be one of {sorted(suffixes | {'.geo', '.msh'})}"
        remedy = "Convert the file, for instance to .vtu by meshio."
        raise MeshError(f"unknown suffix {suffix!r}", allowed, where, remedy)
    try:
        if suffix not in meshio.extension_to_filetypes:
            mesh = _by_pyvista(path, where)
        else:
            mesh = _by_meshio(path, where)
    except MemoryError as error:
        what = "the file takes too much memory"
        allowed = "must fit in half of the machine's memory"
        remedy = "Is it damaged? Take a coarser mesh."
        raise MeshError(what, allowed, where, remedy) from error
    if len(mesh.points) > MOST_NODES:
        raise MeshError(f"{len(mesh.points)} nodes", f"must be at most {MOST_NODES}", where)
    return mesh


def _by_meshio(path: Path, where: str) -> FileMesh:
    """Read a file by meshio, or by PyVista if that fails; raises `MeshError` if both fail."""
    import meshio

    output = io.StringIO()  # meshio prints why it cannot read a file
    try:
        with redirect_stdout(output), redirect_stderr(output):
            mesh = meshio.read(path)
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # meshio exits on a file that it cannot read
        if path.suffix.lower() in _BY_PYVISTA:
            return _by_pyvista(path, where)
        reason = " ".join(output.getvalue().split()) or error
        raise MeshError(f"meshio cannot read the file ({reason})", where=where) from error
    blocks = [Cells(block.type, _corners(block.type), block.data) for block in mesh.cells]
    sets = _meshio_sets(mesh, where)
    return FileMesh(np.asarray(mesh.points, dtype=float), blocks, mesh.point_data, *sets)


def _by_pyvista(path: Path, where: str) -> FileMesh:
    """Read a file of VTK by PyVista; of several times the first.

    Raises `MeshError` without PyVista, and for a file that it cannot read.
    """
    try:
        import pyvista
    except ImportError as error:
        what = f"this {path.suffix} file is read by PyVista only, which is not installed"
        remedy = 'Install it: in the clone, pip install ".[view]". Or convert the file to .vtu.'
        raise MeshError(what, where=where, remedy=remedy) from error
    try:
        with pyvista.VtkErrorCatcher(raise_errors=True):
            data = pyvista.read(path)
        grid = data.cast_to_unstructured_grid()
    except MemoryError:
        raise
    except Exception as error:  # VTK's errors have no class of their own
        reason = " ".join(str(error).split())[-300:]
        raise MeshError(f"PyVista cannot read the file ({reason})", where=where) from error
    offset, nodes = np.asarray(grid.offset), np.asarray(grid.cell_connectivity)
    size = np.diff(offset)
    blocks = []
    for vtk_type, count in np.unique(np.stack([grid.celltypes, size], axis=1), axis=0).tolist():
        cells = np.flatnonzero((grid.celltypes == vtk_type) & (size == count))
        kind = _OF_VTK.get(vtk_type, f"{pyvista.CellType(vtk_type).name} of {count} nodes")
        rows = nodes[offset[cells][:, None] + np.arange(count)]
        blocks.append(Cells(kind, _corners(kind), rows))
    point_data = {name: np.asarray(values) for name, values in grid.point_data.items()}
    return FileMesh(np.asarray(grid.points, dtype=float), blocks, point_data, {}, {})


def _corners(kind: str) -> int:
    """Return the number of corners of a kind of cells, as "triangle6"; 0 for other kinds."""
    return _CORNERS.get(re.sub(r"\d+$", "", kind), 0)


def _meshio_sets(mesh: Any, where: str) -> tuple[dict, dict]:
    """Return lists of node indices and lists of node pairs of each set, by its name.

    The node indices are of all cells of the set, the pairs of its lines only. Raises `MeshError`
    for indices of cells that are out of range.

    The sets are meshio's point sets and cell sets, and the named groups of "gmsh:physical".
    """
    nodes = {name: [np.asarray(s)] for name, s in mesh.point_sets.items()}
    edges: dict[str, list[np.ndarray]] = {}
    # For each set, the indices of its cells in each block of the mesh. meshio's own sets, whose
    # names begin with "gmsh:", are no groups of the user.
    cells = {name: list(s) for name, s in mesh.cell_sets.items() if not name.startswith("gmsh:")}
    # The tag of the physical group of each cell, and in `field_data` the tag and the dimension
    # of each group by its name.
    physical = mesh.cell_data.get("gmsh:physical", [])
    for name, value in mesh.field_data.items():
        if physical and name not in cells and np.shape(value) == (2,):
            tag, dim = value
            blocks = zip(mesh.cells, physical, strict=True)
            cells[name] = [np.flatnonzero((tags == tag) & (b.dim == dim)) for b, tags in blocks]
    for name, members in cells.items():
        nodes.setdefault(name, [])
        for block, indices in zip(mesh.cells, members, strict=True):
            if indices is None or len(indices) == 0:
                continue
            corners = block.data[validated_indices(name, indices, len(block), (), where)]
            nodes[name].append(corners.ravel())
            if _corners(block.type) == 2:
                edges.setdefault(name, []).append(corners[:, :2])
    return nodes, edges
