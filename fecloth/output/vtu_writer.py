"""Encoding of a frame as VTK XML, and of the lists of frames and times; reading of a frame."""

import base64
import json
import sys
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fecloth.errors import InputError

TENSOR = tuple(f"{i}{j}" for i in "XYZ" for j in "XYZ")
COMPONENTS = {
    "principal_stretches": ("smaller", "larger"),
    "principal_stresses": ("smaller", "larger"),
    "strain_tensor": TENSOR,
    "stress_tensor": TENSOR,
}
BLOCK = 1 << 18  # bytes that are compressed at a time
CELLS = {3: 5, 6: 22}  # nodes of a triangle → VTK's number for the cell, linear and quadratic
VTK_TYPES = {"f8": "Float64", "f4": "Float32", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}

Arrays = dict[str, np.ndarray]


def encode_vtu(x, cells, t: float, point_data: Arrays, cell_data: Arrays) -> bytes:
    """Encode one frame as a VTK XML unstructured grid; `cells` (m, 3 or 6) are `Cloth.cells`.

    Meshio is not used: it writes no field data (the time) and no component names ("E11").
    """
    return b"".join(_parts(x, cells, t, point_data, cell_data))


def _parts(x, cells, t: float, point_data: Arrays, cell_data: Arrays) -> Iterator[bytes]:
    """Yield the bytes of the file of `encode_vtu` in their order."""
    m, k = cells.shape
    topology = {
        "connectivity": cells.ravel(),
        "offsets": np.arange(k, k * m + 1, k, dtype=np.int32),  # end of each cell
        "types": np.full(m, CELLS[k], np.uint8),
    }
    order = f"{sys.byteorder.capitalize()}Endian"
    yield (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0"'
        f' byte_order="{order}" header_type="UInt64" compressor="vtkZLibDataCompressor">\n'
        "<UnstructuredGrid>\n<FieldData>\n"
    ).encode()
    yield from _data_array("TimeValue", np.array([t], float), ' NumberOfTuples="1"')
    sizes = f'NumberOfPoints="{len(x)}" NumberOfCells="{m}"'
    yield f"</FieldData>\n<Piece {sizes}>\n".encode()
    for tag, arrays in (
        ("Points", {"Points": x}),
        ("Cells", topology),
        ("PointData", point_data),
        ("CellData", cell_data),
    ):
        yield f"<{tag}>\n".encode()
        for name, data in arrays.items():
            yield from _data_array(name, data)
        yield f"</{tag}>\n".encode()
    yield b"</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"


def _data_array(name: str, data: np.ndarray, attributes: str = "") -> Iterator[bytes]:
    """Yield the bytes of a compressed DataArray with this name, and with more XML attributes.

    Its header has the number of blocks, the size of a block, the size of the last block if it is
    smaller, else 0, and the compressed size of each. All sizes are in bytes. Better compression
    is slower, and saves a few per cent on float64.
    """
    raw = np.ascontiguousarray(data).reshape(-1).view(np.uint8).data
    parts = (raw[i : i + BLOCK] for i in range(0, len(raw), BLOCK))
    blocks = [zlib.compress(part, zlib.Z_BEST_SPEED) for part in parts]
    header = np.array([len(blocks), BLOCK, len(raw) % BLOCK, *map(len, blocks)], np.uint64)
    if data.ndim == 2:
        attributes += f' NumberOfComponents="{data.shape[1]}"'
        for i, component in enumerate(COMPONENTS.get(name, ())):
            attributes += f' ComponentName{i}="{component}"'
    vtk_type = VTK_TYPES[data.dtype.str[1:]]  # without the byte order, as "f8" of "<f8"
    yield f'<DataArray type="{vtk_type}" Name="{name}"{attributes} format="binary">\n'.encode()
    yield base64.b64encode(header.tobytes())
    yield base64.b64encode(b"".join(blocks))
    yield b"\n</DataArray>\n"


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
        f'<DataSet timestep="{float(t)!r}" group="" part="0" file={quoteattr(name)}/>\n'
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
