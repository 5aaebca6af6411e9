"""The process in which Gmsh and meshio work: it has limits of time and memory.

`child_process.in_child` starts it, and says what its tasks and its answer are.
"""

import importlib
import io
import json
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.file_formats import read_file, read_surface
from fecloth.mesh.gmsh_import import (
    DRAWINGS,
    from_geo,
    from_msh,
    gmsh_plane,
)
from fecloth.mesh.grading import Grading
from fecloth.mesh.raw_mesh import RawMesh

MEMORY_SHARE = 0.5  # of the machine's memory; the rest is for the process that waits


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
