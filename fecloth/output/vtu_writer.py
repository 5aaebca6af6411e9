"""Encoding of a frame as VTK XML, and of the lists of frames and times; reading of a frame.

The arrays are appended to the XML as they are: zlib took ten times as long for a fifth less.
"""

import json
import sys
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError

TENSOR = tuple(f"{i}{j}" for i in "XYZ" for j in "XYZ")
COMPONENTS = {
    "principal_stretches": ("smaller", "larger"),
    "principal_stresses": ("smaller", "larger"),
    "recovered_stress": ("XX", "YY", "XY"),
    "strain_tensor": TENSOR,
    "stress_tensor": TENSOR,
}
STATE = ("velocity",)  # beside the points: a run can begin from a frame, exactly
CELLS = {3: 5, 6: 22}  # nodes of a triangle → VTK's number for the cell, linear and quadratic
VTK_TYPES = {"f8": "Float64", "f4": "Float32", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}

Arrays = dict[str, np.ndarray]


def encode_vtu(x, cells, t: float, point_data: Arrays, cell_data: Arrays) -> bytes:
    """Encode one frame as a VTK XML unstructured grid; `cells` (m, 3 or 6) are `Cloth.cells`.

    Meshio is not used: it writes no field data (the time) and no component names ("E11").
    """
    m, k = cells.shape
    topology = {
        "connectivity": cells.ravel(),
        "offsets": np.arange(k, k * m + 1, k, dtype=np.int32),  # end of each cell
        "types": np.full(m, CELLS[k], np.uint8),
    }
    sections = {
        "FieldData": {"TimeValue": np.array([t], float)},
        "Points": {"Points": x},
        "Cells": topology,
        "PointData": {name: _as_stored(name, data) for name, data in point_data.items()},
        "CellData": {name: _as_stored(name, data) for name, data in cell_data.items()},
    }
    blocks = [_block(data) for arrays in sections.values() for data in arrays.values()]
    # Where each block begins. The first is the last in the file: meshio finds them only so.
    offsets = np.cumsum([0, *map(len, reversed(blocks))])[-2::-1].tolist()
    texts = {
        tag: "".join(_data_array(name, data, offsets.pop(0)) for name, data in arrays.items())
        for tag, arrays in sections.items()
    }
    texts = {tag: f"<{tag}>\n{text}</{tag}>\n" for tag, text in texts.items()}
    time = texts.pop("FieldData")
    order = f"{sys.byteorder.capitalize()}Endian"
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0"'
        f' byte_order="{order}" header_type="UInt64">\n<UnstructuredGrid>\n{time}'
        f'<Piece NumberOfPoints="{len(x)}" NumberOfCells="{m}">\n{"".join(texts.values())}'
        '</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'
    )
    return b"".join([head.encode(), *reversed(blocks), b"\n</AppendedData>\n</VTKFile>\n"])


def _block(data: np.ndarray) -> bytes:
    """Return the number of bytes of an array, as 8 bytes, and its bytes."""
    return data.nbytes.to_bytes(8, sys.byteorder) + data.tobytes()


def _as_stored(name: str, data: np.ndarray) -> np.ndarray:
    """Return an array of a frame with 4 bytes for each number that does not belong to a state."""
    if name in STATE or data.dtype != float:
        return data
    with np.errstate(over="ignore"):  # of a cloth that blows up: infinite
        return data.astype(np.float32)


def _data_array(name: str, data: np.ndarray, offset: int) -> str:
    """Return the element of an array whose block begins at this offset."""
    attributes = ""
    if name == "TimeValue":
        attributes = f' NumberOfTuples="{len(data)}"'
    if data.ndim == 2:
        attributes = f' NumberOfComponents="{data.shape[1]}"'
        for i, component in enumerate(COMPONENTS.get(name, ())):
            attributes += f' ComponentName{i}="{component}"'
    vtk_type = VTK_TYPES[data.dtype.str[1:]]  # without the byte order, as "f8" of "<f8"
    attributes += f' format="appended" offset="{offset}"'
    return f'<DataArray type="{vtk_type}" Name="{name}"{attributes}/>\n'


def read_vtu(path: str | Path) -> Any:
    """Read a frame as a mesh of meshio.

    Raises `InputError` if the file cannot be read, or has not exactly one type of cells.
    """
    from meshio import vtu  # here, as its import is slow

    try:
        mesh = vtu.read(path)
        (_,) = mesh.cells  # an error unless there is one block of cells
    except Exception as error:  # meshio raises errors of any kind for a broken file
        remedy = "Give a frame written by fecloth."
        raise InputError(f"cannot be read ({error})", where=str(path), remedy=remedy) from error
    return mesh


def encode_pvd(files: Iterable[tuple[str, float]]) -> bytes:
    """Encode ParaView's collection of (file relative to it, time)."""
    lines = "".join(
        f'<DataSet timestep="{float(t)!r}" group="" part="0" file="{escape(name)}"/>\n'
        for name, t in files
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n'
    return f"{head}{lines}</Collection>\n</VTKFile>\n".encode()


def encode_series(files: Iterable[tuple[str, float]]) -> bytes:
    """Encode a VTK file series, in JSON, of (file relative to it, time)."""
    entries = [{"name": name, "time": t} for name, t in files]
    return json.dumps({"file-series-version": "1.0", "files": entries}).encode()


LISTS = (
    (".pvd", encode_pvd, b"</Collection>\n</VTKFile>\n"),
    (".vtu.series", encode_series, b"]}"),
)  # suffix, encoder, and the bytes at the end of every such list
