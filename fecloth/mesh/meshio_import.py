"""Meshes that meshio reads: triangles, sets of nodes and of edges. `gmsh_child` runs it."""

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import MeshError
from fecloth.mesh.gmsh_import import RawMesh, check_cells
from fecloth.mesh.indices import validated_indices

MOST_NODES = 3 * validation.MOST_TRIANGLES


def surface_from_meshio(path: Path, where: str) -> RawMesh:
    """The nodes and triangles of a file, which may hold other cells."""
    mesh = _meshio_mesh(path, where)
    xyz, triangles = mesh.points, _triangles(mesh)
    n, m = len(xyz), len(triangles)
    return RawMesh(xyz, triangles, {}, {}, np.arange(n), np.arange(m), np.zeros(n, dtype=bool))


def from_meshio(path: Path, where: str) -> RawMesh:
    """The mesh of a file of triangles, lines and points, with its sets."""
    mesh = _meshio_mesh(path, where)
    check_cells(
        {b.type: len(b) for b in mesh.cells if b.type not in ("triangle", "line", "vertex")}, where
    )
    triangles = _triangles(mesh)
    nodes, edges = _meshio_sets(mesh, where)
    n, m = len(mesh.points), len(triangles)
    geometric = np.zeros(n, dtype=bool)
    for block in mesh.cells:
        if block.type != "triangle":
            geometric[
                validated_indices(f"{block.type} cells", block.data.ravel(), n, (), where)
            ] = True
    return RawMesh(mesh.points, triangles, nodes, edges, np.arange(n), np.arange(m), geometric)


def _triangles(mesh: Any) -> np.ndarray:
    blocks = [block.data for block in mesh.cells if block.type == "triangle"]
    return np.concatenate(blocks) if blocks else np.empty((0, 3), dtype=int)


def _meshio_mesh(path: Path, where: str) -> Any:
    import meshio

    suffix, suffixes = path.suffix.lower(), meshio.extension_to_filetypes
    if suffix not in suffixes:
        allowed = f"must be one of {sorted(suffixes)}"
        remedy = "Convert the file, for instance to .vtu by meshio."
        raise MeshError(f"unknown suffix {suffix!r}", allowed, where, remedy)
    output = io.StringIO()
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            mesh = meshio.read(path)
        mesh.points = np.asarray(mesh.points, dtype=float)
    except MemoryError as error:
        what, remedy = "the file takes too much memory", "Is it damaged? Take a coarser mesh."
        raise MeshError(what, "must fit in half of the machine's memory", where, remedy) from error
    except (Exception, SystemExit) as error:  # meshio exits on a file that it cannot read
        reason = " ".join(output.getvalue().split()) or error
        raise MeshError(f"meshio cannot read the file ({reason})", where=where) from error
    if len(mesh.points) > MOST_NODES:
        raise MeshError(f"{len(mesh.points)} nodes", f"must be at most {MOST_NODES}", where)
    return mesh


def _meshio_sets(mesh: Any, where: str) -> tuple[dict, dict]:
    """Node indices and node pairs of point sets, cell sets and named gmsh:physical groups."""
    nodes = {name: [np.asarray(s)] for name, s in mesh.point_sets.items()}
    edges: dict[str, list[np.ndarray]] = {}
    cells = {name: list(s) for name, s in mesh.cell_sets.items() if not name.startswith("gmsh:")}
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
            if block.type == "line":
                edges.setdefault(name, []).append(corners)
    return nodes, edges
