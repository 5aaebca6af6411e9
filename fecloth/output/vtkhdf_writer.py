"""A whole run in one file, run.vtkhdf: VTK's transient unstructured grid in HDF5.

ParaView opens it as one data set with times. The triangles are written once; each frame appends
its points and the arrays of `frame_arrays.fields`, and the group Steps has their offsets:

    Points, PointData/*, CellData/*     rows of all frames, one after the other
    Steps/Values                        the times [s]
    Steps/PointOffsets                  first row of a frame in Points
    Steps/PointDataOffsets/*, CellDataOffsets/*    the same for the arrays
    Steps/PartOffsets, CellOffsets, ConnectivityIdOffsets    0: all frames share one topology

PartOffsets must be 0 too: otherwise VTK's reader finds no part for the later frames and silently
shows the values of the first. Components have no names in this format; their order is the order of
`fecloth/runs/README.md`. Layout: VTK file formats, "VTKHDF", version 2.2 (Kitware).

The file is opened, extended and closed for each frame, and the number of frames is raised last: it
can be read between two frames, and ParaView's *Reload Files* shows the new ones. HDF5 has no
journal, so `write_ahead_log` adds one: a process killed while the bytes of a frame are being
written may leave a file that does not open, but a resumed run completes it.
"""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.output.atomic_files import WriteError, writing
from fecloth.output.frame_arrays import STATIC, fields, kinematics
from fecloth.output.vtu_writer import CELLS, Arrays
from fecloth.output.write_ahead_log import changing, replace_whole
from fecloth.system.state import State
from fecloth.system.system import System

CHUNK = 1 << 18  # bytes of a dataset that are compressed and read at a time
COUNTS = ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")
SHARED = ("PartOffsets", "CellOffsets", "ConnectivityIdOffsets")


@dataclass(eq=False)
class HdfFrames:
    """Appends states to one file; the same use as `output.Frames`."""

    path: Path  # the file, replaced by the first frame
    # What is shown; without a system, no stress and no energy.
    cloth: Cloth
    system: System | None = None
    times: list[float] = field(default_factory=list)  # times of the frames written so far [s]

    def __post_init__(self):
        h5py()  # refuse a missing package before the first step

    @property
    def opens(self) -> Path:
        return self.path

    def add(self, state: State, arrays: tuple[Arrays, Arrays] | None = None) -> Path:
        """Append a frame, with its `arrays` by `frame_arrays.fields` if given; return the file."""
        shown = arrays or (self.system and fields(self.system, state))
        points, cells = shown or kinematics(self.cloth, state)
        with (_more if self.times else _new)(self.path) as file:
            if not self.times:
                _begin(file, self.cloth, points, cells)
            _append(file["VTKHDF"], state, points, cells)
        self.times.append(float(state.t))
        return self.path

    def keep(self, times: Sequence[float]) -> None:
        """Continue after the frames of these times, the first of the file; remove later ones."""
        remedy = "Restore it, or run the scene again with --overwrite."
        try:
            with _more(self.path) as file:
                root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
                if steps["Values"][: len(times)].tolist() != list(times):
                    raise InputError(f"{self.path} has other frames than the run", remedy=remedy)
                if len(times) < len(steps["Values"]):
                    _cut(root, steps, len(times))
        except (WriteError, KeyError) as error:
            reason = str(error.__cause__ or error)
            raise InputError(f"{self.path} cannot be read: {reason}", remedy=remedy) from error
        self.times = list(times)

    def files(self, after: int) -> list[Path]:
        """Return the files with the frames from number `after` on."""
        return [self.path]


def h5py():
    """Return the package, or raise an `InputError` that says how to install it."""
    try:
        import h5py
    except ImportError as error:
        remedy = 'Install it: in the clone, pip install ".[hdf]", or write format = "vtu".'
        raise InputError("a .vtkhdf file needs the package h5py", remedy=remedy) from error
    return h5py


@contextmanager
def _new(path: Path) -> Iterator:
    """Yield a new HDF5 file that replaces `path` at the end of the block."""
    stream = io.BytesIO()
    with h5py().File(stream, "w") as file:
        yield file
    replace_whole(path, stream.getvalue())


@contextmanager
def _more(path: Path) -> Iterator:
    """Yield the file to change, without HDF5's lock, so that an open ParaView stops no run."""
    with writing(path), changing(path) as stream, h5py().File(stream, "r+") as file:
        yield file


def _begin(file, cloth: Cloth, points: Arrays, cells: Arrays) -> None:
    """Write the topology, and empty datasets for everything that grows."""
    m, k = cloth.cells.shape
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = (2, 2)
    root.attrs["Type"] = np.bytes_("UnstructuredGrid")
    for name, count in zip(COUNTS, (len(cloth.X), m, m * k), strict=True):
        root[name] = np.array([count])
    root["Connectivity"] = cloth.cells.ravel().astype(np.int64)
    root["Offsets"] = np.arange(0, k * m + 1, k)
    root["Types"] = np.full(m, CELLS[k], np.uint8)
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = 0
    _growing(root, "Points", (3,), float)
    _growing(steps, "Values", (), float)
    for name in ("NumberOfParts", "PointOffsets", *SHARED):
        _growing(steps, name, (1,) * (name in SHARED[1:]), np.int64)
    for kind, arrays in (("PointData", points), ("CellData", cells)):
        for name, data in arrays.items():
            if name in STATIC:
                root[f"{kind}/{name}"] = data
            else:
                _growing(root, f"{kind}/{name}", data.shape[1:], data.dtype)
            _growing(steps, f"{kind}Offsets/{name}", (), np.int64)


def _growing(group, name: str, row: tuple[int, ...], dtype) -> None:
    """Create an empty dataset of rows, compressed without loss like the .vtu frames."""
    rows = max(1, CHUNK // (8 * int(np.prod(row, dtype=int)))) if row or "Data/" in name else 1024
    layout = {"maxshape": (None, *row), "chunks": (rows, *row)}
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    group.create_dataset(name, (0, *row), dtype, **layout, **packing)


def _append(root, state: State, points: Arrays, cells: Arrays) -> None:
    """Append the rows of one frame, then their offsets, and last the number of steps."""
    steps = root["Steps"]
    _extend(steps["PointOffsets"], [_extend(root["Points"], state.x)])
    for kind, arrays in (("PointData", points), ("CellData", cells)):
        for name, data in arrays.items():
            begin = 0 if name in STATIC else _extend(root[f"{kind}/{name}"], data)
            _extend(steps[f"{kind}Offsets/{name}"], [begin])
    for name in SHARED:
        _extend(steps[name], np.zeros((1, *steps[name].shape[1:]), np.int64))
    _extend(steps["NumberOfParts"], [1])
    _extend(steps["Values"], [state.t])
    root.file.flush()
    steps.attrs["NSteps"] = len(steps["Values"])


def _cut(root, steps, count: int) -> None:
    """Truncate every dataset at the begin of frame `count` (from 0)."""
    steps.attrs["NSteps"] = count
    root["Points"].resize(int(steps["PointOffsets"][count]), axis=0)
    for kind in ("PointData", "CellData"):
        for name in root[kind].keys() - set(STATIC):
            root[kind][name].resize(int(steps[f"{kind}Offsets/{name}"][count]), axis=0)
        for offsets in steps[f"{kind}Offsets"].values():
            offsets.resize(count, axis=0)
    for name in ("Values", "NumberOfParts", "PointOffsets", *SHARED):
        steps[name].resize(count, axis=0)


def _extend(dataset, rows) -> int:
    begin = len(dataset)
    dataset.resize(begin + len(rows), axis=0)
    dataset[begin:] = rows
    return begin
