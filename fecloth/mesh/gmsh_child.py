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
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, MeshError
from fecloth.mesh.file_formats import read_file, read_surface
from fecloth.mesh.gmsh_import import (
    DRAWINGS,
    from_geo,
    from_msh,
    gmsh_plane,
)
from fecloth.mesh.grading import Grading
from fecloth.mesh.raw_mesh import RawMesh

TIME_LIMIT = 300.0  # s of wall time by default; users can raise it
MEMORY_SHARE = 0.5  # of the machine's memory; the rest is for the process that waits
_ERRORS = {"InputError": InputError, "MeshError": MeshError}


def in_child(task: dict, where: str, time_limit: float = TIME_LIMIT) -> RawMesh:
    """Mesh or read a file in a child process; return the mesh. The process ends with this call.

    Raises the `InputError` or `MeshError` of the child, and `MeshError` if it takes longer than
    `time_limit` [s] or ends without a mesh.

    Parameters
    ----------
    task
        One of ``{"geo": path, "h": … or None, "confined": …}``, ``{"msh": path}``, ``{"file":
        path}``, ``{"surface": path}`` (both of other formats) and ``{"draw": a name of `DRAWINGS`,
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
        by_meshio = task.keys() & {"file", "surface"}
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
        case {"file": path}:
            return read_file(Path(path), where)
        case {"surface": path}:
            return read_surface(Path(path), where)
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


if __name__ == "__main__":
    main()
