"""Gmsh and meshio in a process of their own, which can be stopped at any moment and has limits.

`in_child` starts ``python -m fecloth.mesh.gmsh_child``, sends it a task as JSON and reads the
arrays of the mesh from its standard output, as an .npz file. A start takes about 0.4 s.
"""

import importlib
import io
import json
import os
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, MeshError
from fecloth.mesh.gmsh_import import (
    DRAWINGS,
    RawMesh,
    check_cells,
    from_geo,
    from_msh,
    gmsh_plane,
)
from fecloth.mesh.grading import Grading
from fecloth.mesh.indices import validated_indices

TIME_LIMIT = 300.0  # s of wall time by default; users can raise it
MEMORY_SHARE = 0.5  # of the machine's memory; the rest is for the process that waits
MOST_NODES = 3 * validation.MOST_TRIANGLES  # as many as triangles without common nodes have
_ERRORS = {"InputError": InputError, "MeshError": MeshError}


def in_child(task: dict, where: str, time_limit: float = TIME_LIMIT) -> RawMesh:
    """Mesh or read a file in a child process; return the mesh. The process ends with this call.

    Raises the `InputError` or `MeshError` of the child, and `MeshError` if it takes longer than
    `time_limit` [s] or ends without a mesh.

    Parameters
    ----------
    task
        One of ``{"geo": path, "h": … or None, "confined": …}``, ``{"msh": path}``, ``{"meshio":
        path}``, ``{"surface": path}`` (also by meshio) and ``{"draw": a name of `DRAWINGS`,
        "sizes": its arguments}``. "geo" and "draw" may have a "grading", a list of the fields
        of `Grading`. The process may write files only if "confined" is false.
    where
        The file, for messages.
    time_limit
        Seconds after which the process is killed.
    """
    validation.positive("time_limit", time_limit, "s", where)
    # The child must import the same fecloth, also where it is not installed.
    package = Path(__file__).parents[2]
    path = os.pathsep.join(filter(None, [str(package), os.environ.get("PYTHONPATH")]))
    # -P: modules in the current folder must not be imported.
    command = [sys.executable, "-P", "-m", __name__]
    options: Any = {"capture_output": True, "env": os.environ | {"PYTHONPATH": path}}
    request = json.dumps(task | {"where": where, "seconds": time_limit}).encode()
    try:
        done = subprocess.run(command, input=request, timeout=time_limit, **options)
    except subprocess.TimeoutExpired:
        what = "meshing or reading takes longer"
        allowed = f"must end within {time_limit:g} s"
        remedy = "Take a larger h, or raise the limit: --mesh-time SECONDS, time_limit in Python."
        raise MeshError(what, allowed, where, remedy) from None
    if done.returncode:
        raise _make_error(done, where)
    result = _unpack(done.stdout)
    if "error" in result:
        raise _ERRORS[result["error"]](*result["arguments"])
    return RawMesh(**result)


def _make_error(done: subprocess.CompletedProcess, where: str) -> MeshError:
    """Return the error of a process that has ended without a mesh, with its last words."""
    last_words = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    why = last_words or f"status {done.returncode}"
    if done.returncode < 0:
        with suppress(ValueError):
            why = f"{signal.Signals(-done.returncode).name}; {why}"
    remedy = "Is the mesh too large for the memory? Take a larger h, or a coarser mesh."
    return MeshError(f"reading has ended without a mesh ({why})", where=where, remedy=remedy)


def _pack(result: dict) -> bytes:
    """Return nested dicts and lists of arrays and texts as the bytes of an .npz file.

    Its first array is a JSON header, in which {"array": i} stands for the array arr_i of the
    file. No array is pickled, so reading the file runs no code.
    """
    arrays: list[np.ndarray] = []

    def place(array: np.ndarray) -> dict:
        """Keep an array, and return what stands for it in the header."""
        arrays.append(array)
        return {"array": len(arrays)}  # arr_0 is the header

    header = json.dumps(result, default=place).encode()
    stream = io.BytesIO()
    np.savez(stream, np.frombuffer(header, np.uint8), *arrays)
    return stream.getvalue()


def _unpack(data: bytes) -> dict:
    """Return what `_pack` has packed."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:

        def find(item: dict) -> Any:
            is_place = item.keys() == {"array"} and isinstance(item["array"], int)
            if is_place:
                return file[f"arr_{item['array']}"]
            return item

        return json.loads(file["arr_0"].tobytes(), object_hook=find)


def main() -> None:
    """Carry out the task on standard input, and write the packed mesh to standard output.

    An `InputError` or `MeshError` is written in place of the mesh, for `in_child` to raise. What
    Gmsh prints goes to standard error.
    """
    output = os.dup(1)  # the standard output, kept for the mesh only
    os.dup2(2, 1)  # descriptor 1, to which Gmsh prints, now leads to standard error
    task = json.load(sys.stdin)
    with suppress(ImportError, OSError):  # `gmsh_model` says what is missing
        # Imported before the limits, because Python may write its bytecode.
        by_meshio = task.keys() & {"meshio", "surface"}
        importlib.import_module("meshio" if by_meshio else "gmsh")
    _limit_process(task["seconds"], task.get("confined", True))
    try:
        result = vars(_carry_out(task))
    except InputError as error:
        arguments = [error.what, error.allowed, error.where, error.remedy]
        result = {"error": type(error).__name__, "arguments": arguments}
    with os.fdopen(output, "wb") as stream:
        stream.write(_pack(result))


def _carry_out(task: dict) -> RawMesh:
    """Return the mesh of a task; `in_child` says what tasks there are."""
    where = task["where"]
    grading = [Grading(**fields) for fields in task.get("grading", ())]
    match task:
        case {"draw": name, "sizes": sizes}:
            h = sizes[-1]  # the last argument of each drawing
            return gmsh_plane(lambda geo: DRAWINGS[name](geo, *sizes), h, where, grading)
        case {"msh": path}:
            return from_msh(Path(path), where)
        case {"meshio": path}:
            return from_meshio(Path(path), where)
        case {"surface": path}:
            return surface_from_meshio(Path(path), where)
    return from_geo(Path(task["geo"]), task["h"], where, grading)


def _limit_process(seconds: float, confined: bool) -> None:
    """Limit the time [s] and the memory of this process, and end it with its parent.

    A confined process cannot write to files, either. Where the system lacks a limit, it is left
    out.
    """
    with suppress(ImportError):  # Windows
        import resource

        memory = int(MEMORY_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        limits = {
            "RLIMIT_CPU": int(seconds) + 2,  # 2 s later than `in_child`, which says why it ended
            "RLIMIT_AS": memory,
            "RLIMIT_CORE": 0,  # no core dump of a crash
        }
        if confined:
            limits["RLIMIT_FSIZE"] = 0  # the output is a pipe, to which this does not apply
        for name, value in limits.items():
            with suppress(AttributeError, ValueError, OSError):  # a lower limit is there already
                resource.setrlimit(getattr(resource, name), (value, value))
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            # 1 is PR_SET_PDEATHSIG: the signal that this process gets when its parent ends.
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def surface_from_meshio(path: Path, where: str) -> RawMesh:
    """The nodes and triangles of a file, which may hold other cells."""
    mesh = _read_by_meshio(path, where)
    n = len(mesh.points)
    return _make_raw(mesh, {}, {}, is_geometric=np.zeros(n, dtype=bool))


def from_meshio(path: Path, where: str) -> RawMesh:
    """Return the mesh of a file of triangles, lines and points, with its sets.

    Raises `MeshError` for other cells and for cells with wrong node numbers. The nodes of lines
    and points are marked as geometric: they are removed if no triangle uses them.
    """
    mesh = _read_by_meshio(path, where)
    allowed_types = ("triangle", "line", "vertex")
    check_cells({b.type: len(b) for b in mesh.cells if b.type not in allowed_types}, where)
    node_sets, edge_sets = _meshio_sets(mesh, where)
    n = len(mesh.points)
    is_geometric = np.zeros(n, dtype=bool)
    for block in mesh.cells:
        if block.type != "triangle":
            used = validated_indices(f"{block.type} cells", block.data.ravel(), n, (), where)
            is_geometric[used] = True
    return _make_raw(mesh, node_sets, edge_sets, is_geometric)


def _make_raw(mesh: Any, node_sets: dict, edge_sets: dict, is_geometric: np.ndarray) -> RawMesh:
    """Return the nodes and triangles of meshio's mesh, numbered from 0, with these sets.

    `is_geometric` (n,) is true for a node of a line or point of the geometry, which is removed
    if no triangle uses it.
    """
    blocks = [block.data for block in mesh.cells if block.type == "triangle"]
    if blocks:
        triangles = np.concatenate(blocks)
    else:
        triangles = np.empty((0, 3), dtype=int)
    return RawMesh(
        xyz=mesh.points,
        triangles=triangles,
        node_sets=node_sets,
        edge_sets=edge_sets,
        node_ids=np.arange(len(mesh.points)),
        triangle_ids=np.arange(len(triangles)),
        geometric=is_geometric,
    )


def _read_by_meshio(path: Path, where: str) -> Any:
    """Return meshio's mesh of a file, with its points as floats.

    Raises `MeshError` for a suffix that meshio does not know, for a file that it cannot read or
    that takes too much memory, and for more than `MOST_NODES` nodes.
    """
    import meshio

    suffix = path.suffix.lower()
    suffixes = meshio.extension_to_filetypes
    if suffix not in suffixes:
        allowed = f"must be one of {sorted(suffixes)}"
        remedy = "Convert the file, for instance to .vtu by meshio."
        raise MeshError(f"unknown suffix {suffix!r}", allowed, where, remedy)
    output = io.StringIO()  # meshio prints why it cannot read a file
    try:
        with redirect_stdout(output), redirect_stderr(output):
            mesh = meshio.read(path)
        mesh.points = np.asarray(mesh.points, dtype=float)
    except MemoryError as error:
        what = "the file takes too much memory"
        allowed = "must fit in half of the machine's memory"
        remedy = "Is it damaged? Take a coarser mesh."
        raise MeshError(what, allowed, where, remedy) from error
    except (Exception, SystemExit) as error:  # meshio exits on a file that it cannot read
        reason = " ".join(output.getvalue().split()) or error
        raise MeshError(f"meshio cannot read the file ({reason})", where=where) from error
    if len(mesh.points) > MOST_NODES:
        raise MeshError(f"{len(mesh.points)} nodes", f"must be at most {MOST_NODES}", where)
    return mesh


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
            if block.type == "line":
                edges.setdefault(name, []).append(corners)
    return nodes, edges


if __name__ == "__main__":
    main()
