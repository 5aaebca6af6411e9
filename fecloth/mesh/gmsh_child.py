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
from fecloth.mesh.gmsh_import import DRAWINGS, RawMesh, check_cells, from_geo, from_msh, gmsh_plane
from fecloth.mesh.grading import Grading
from fecloth.mesh.indices import validated_indices

TIME_LIMIT = 300.0  # s, of wall time
MEMORY_SHARE = 0.5  # of the machine's memory
MOST_NODES = 3 * validation.MOST_TRIANGLES
_ERRORS = {"InputError": InputError, "MeshError": MeshError}


def in_child(task: dict, where: str, time_limit: float = TIME_LIMIT) -> RawMesh:
    """Mesh or read a file in a child process, which ends with this function, however it ends.

    The task is ``{"geo": path, "h": … or None, "confined": …}``, ``{"msh": path}``, ``{"meshio":
    path}``, ``{"surface": path}``, also by meshio, or ``{"draw": a name of `DRAWINGS`, "sizes":
    its arguments}``; "geo" and "draw" may have a `grading`, a list of the fields of `Grading`.
    Unless `confined` is false, the process writes no file. It is killed after `time_limit`
    seconds; `where` is the file, for messages.
    """
    validation.positive("time_limit", time_limit, "s", where)
    package = Path(__file__).parents[2]  # -P: a module in the current folder must not be imported
    path = os.pathsep.join(filter(None, [str(package), os.environ.get("PYTHONPATH")]))
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
        raise _broken(done, where)
    result = _unpacked(done.stdout)
    if "error" in result:
        raise _ERRORS[result["error"]](*result["arguments"])
    return RawMesh(**result)


def _broken(done: subprocess.CompletedProcess, where: str) -> MeshError:
    last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
    why = last[0] if last else f"status {done.returncode}"
    if done.returncode < 0:
        with suppress(ValueError):
            why = f"{signal.Signals(-done.returncode).name}; {why}"
    remedy = "Is the mesh too large for the memory? Take a larger h, or a coarser mesh."
    return MeshError(f"reading has ended without a mesh ({why})", where=where, remedy=remedy)


def _packed(result: dict) -> bytes:
    """Return dicts and lists of arrays and texts as an .npz file: a JSON header, and the arrays."""
    arrays: list[np.ndarray] = []

    def place(array: np.ndarray) -> dict:
        arrays.append(array)
        return {"array": len(arrays)}

    header = json.dumps(result, default=place).encode()
    stream = io.BytesIO()
    np.savez(stream, np.frombuffer(header, np.uint8), *arrays)
    return stream.getvalue()


def _unpacked(data: bytes) -> dict:
    with np.load(io.BytesIO(data), allow_pickle=False) as file:

        def find(item: dict) -> Any:
            is_place = item.keys() == {"array"} and isinstance(item["array"], int)
            if is_place:
                return file[f"arr_{item['array']}"]
            return item

        return json.loads(file["arr_0"].tobytes(), object_hook=find)


def main() -> None:
    """Carry out the task on standard input; what Gmsh prints goes to standard error."""
    output = os.dup(1)
    os.dup2(2, 1)
    task = json.load(sys.stdin)
    with suppress(ImportError, OSError):  # `gmsh_model` says what is missing
        # before the limits: Python may write its bytecode
        importlib.import_module("meshio" if {"meshio", "surface"} & task.keys() else "gmsh")
    _limit(task["seconds"], task.get("confined", True))
    try:
        result = vars(_mesh(task))
    except InputError as error:
        arguments = [error.what, error.allowed, error.where, error.remedy]
        result = {"error": type(error).__name__, "arguments": arguments}
    with os.fdopen(output, "wb") as stream:
        stream.write(_packed(result))


def _mesh(task: dict) -> RawMesh:
    where = task["where"]
    grading = [Grading(**fields) for fields in task.get("grading", ())]
    match task:
        case {"draw": name, "sizes": sizes}:
            return gmsh_plane(lambda geo: DRAWINGS[name](geo, *sizes), sizes[-1], where, grading)
        case {"msh": path}:
            return from_msh(Path(path), where)
        case {"meshio": path}:
            return from_meshio(Path(path), where)
        case {"surface": path}:
            return surface_from_meshio(Path(path), where)
    return from_geo(Path(task["geo"]), task["h"], where, grading)


def _limit(seconds: float, confined: bool) -> None:
    """Limit time and memory, and end with the parent; a confined process writes no file."""
    with suppress(ImportError):  # Windows
        import resource

        memory = int(MEMORY_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        limits = {"RLIMIT_CPU": int(seconds) + 2, "RLIMIT_AS": memory, "RLIMIT_CORE": 0}
        if confined:
            limits["RLIMIT_FSIZE"] = 0
        for name, value in limits.items():
            with suppress(AttributeError, ValueError, OSError):  # a lower limit is there already
                resource.setrlimit(getattr(resource, name), (value, value))
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def surface_from_meshio(path: Path, where: str) -> RawMesh:
    """The nodes and triangles of a file, which may hold other cells."""
    mesh = _meshio_mesh(path, where)
    xyz = mesh.points
    triangles = _triangles(mesh)
    n = len(xyz)
    m = len(triangles)
    return RawMesh(xyz, triangles, {}, {}, np.arange(n), np.arange(m), np.zeros(n, dtype=bool))


def from_meshio(path: Path, where: str) -> RawMesh:
    """The mesh of a file of triangles, lines and points, with its sets."""
    mesh = _meshio_mesh(path, where)
    known = ("triangle", "line", "vertex")
    check_cells({b.type: len(b) for b in mesh.cells if b.type not in known}, where)
    triangles = _triangles(mesh)
    nodes, edges = _meshio_sets(mesh, where)
    n = len(mesh.points)
    m = len(triangles)
    geometric = np.zeros(n, dtype=bool)
    for block in mesh.cells:
        if block.type != "triangle":
            used = validated_indices(f"{block.type} cells", block.data.ravel(), n, (), where)
            geometric[used] = True
    return RawMesh(mesh.points, triangles, nodes, edges, np.arange(n), np.arange(m), geometric)


def _triangles(mesh: Any) -> np.ndarray:
    blocks = [block.data for block in mesh.cells if block.type == "triangle"]
    if blocks:
        return np.concatenate(blocks)
    return np.empty((0, 3), dtype=int)


def _meshio_mesh(path: Path, where: str) -> Any:
    import meshio

    suffix = path.suffix.lower()
    suffixes = meshio.extension_to_filetypes
    if suffix not in suffixes:
        allowed = f"must be one of {sorted(suffixes)}"
        remedy = "Convert the file, for instance to .vtu by meshio."
        raise MeshError(f"unknown suffix {suffix!r}", allowed, where, remedy)
    output = io.StringIO()
    try:
        with redirect_stdout(output), redirect_stderr(output):
            mesh = meshio.read(path)
        mesh.points = np.asarray(mesh.points, dtype=float)
    except MemoryError as error:
        what = "the file takes too much memory"
        remedy = "Is it damaged? Take a coarser mesh."
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


if __name__ == "__main__":
    main()
