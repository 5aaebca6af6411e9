"""Reading and meshing in a process of its own, which can be stopped at any moment.

`in_child` starts ``python -m fecloth.mesh.gmsh_child``, sends it a task as JSON and reads the
arrays of the mesh from its standard output, as an .npz file. A start takes about 0.4 s. Nothing
of Gmsh or meshio is imported here.
"""

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
from fecloth.mesh.raw_mesh import RawMesh

CHILD = "fecloth.mesh.gmsh_child"
TIME_LIMIT = 300.0  # s of wall time by default; users can raise it
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
    command = [sys.executable, "-P", "-m", CHILD]
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


def _unpack(data: bytes) -> dict:
    """Return what `_pack` has packed."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:

        def find(item: dict) -> Any:
            is_place = item.keys() == {"array"} and isinstance(item["array"], int)
            if is_place:
                return file[f"arr_{item['array']}"]
            return item

        return json.loads(file["arr_0"].tobytes(), object_hook=find)
