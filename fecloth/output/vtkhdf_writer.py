"""A whole run in one file, run.vtkhdf: VTK's transient unstructured grid in HDF5.

ParaView opens it as one data set with times. The triangles are written once; each frame has
its points and the arrays of `frame_arrays.fields`, and the group Steps has their offsets:

    Points, PointData/*, CellData/*     rows of all frames, one after the other
    Steps/Values                        the times [s]
    Steps/PointOffsets                  first row of a frame in Points
    Steps/PointDataOffsets/*, CellDataOffsets/*    the same for the arrays
    Steps/PartOffsets, CellOffsets, ConnectivityIdOffsets    0: all frames share one topology

PartOffsets must be 0 too: otherwise VTK's reader finds no part for the later frames and
silently shows the values of the first. Components have no names in this format; their order is
the order of `fecloth/runs/README.md`. Layout: VTK file formats, "VTKHDF", version 2.2
(Kitware).

A run writes its frames as .vtu, which a killed process leaves whole, and gathers them at its
end.
"""

from pathlib import Path

import numpy as np

from fecloth.output.atomic_files import replacing
from fecloth.output.frame_arrays import STATIC
from fecloth.output.frame_reader import Frame, Series, h5py
from fecloth.output.vtu_writer import CELLS, Arrays

COUNTS = ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")


def gather(series: Series, target: Path) -> Path:
    """Write all frames of a series into one .vtkhdf file, and return its path.

    The file is there whole or not at all. Raises `InputError` without the package h5py, and if
    the file cannot be written.
    """
    with replacing(target) as part, h5py().File(part, "w") as file:
        root = file.create_group("VTKHDF")
        first = series.read(0)
        _write_triangles(root, first)
        _write_steps(root, _arrays(first), series.times)
        for i in range(len(series.times)):
            for name, data in _arrays(series.read(i)).items():
                if not (i and _is_static(name)):  # static arrays once, with the first frame
                    root[name][i * len(data) : (i + 1) * len(data)] = data
    return target


def _arrays(frame: Frame) -> Arrays:
    """Return the arrays of a frame by their names in the file, as "PointData/velocity"."""
    point_data = {f"PointData/{name}": data for name, data in frame.point_data.items()}
    cell_data = {f"CellData/{name}": data for name, data in frame.cell_data.items()}
    return {"Points": frame.points, **point_data, **cell_data}


def _is_static(name: str) -> bool:
    return name.rpartition("/")[2] in STATIC


def _write_triangles(root, frame: Frame) -> None:
    """Write the numbers of points and cells, and the triangles, which all frames share."""
    m, k = frame.cells.shape
    root.attrs["Version"] = (2, 2)
    root.attrs["Type"] = np.bytes_("UnstructuredGrid")
    for name, count in zip(COUNTS, (len(frame.points), m, m * k), strict=True):
        root[name] = np.array([count])
    root["Connectivity"] = frame.cells.ravel().astype(np.int64)
    root["Offsets"] = np.arange(0, k * m + 1, k)  # of each cell in Connectivity
    root["Types"] = np.full(m, CELLS[k], np.uint8)


def _write_steps(root, arrays: Arrays, times: tuple[float, ...]) -> None:
    """Write times and offsets, and make datasets for all frames.

    `arrays` are the arrays of the first frame by their names; each dataset has its rows for all
    frames, or once if the array is static. The datasets are still empty.
    """
    count = len(times)
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = count
    steps["Values"] = np.array(times)
    steps["NumberOfParts"] = np.ones(count, np.int64)
    steps["PartOffsets"] = np.zeros(count, np.int64)
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps[name] = np.zeros((count, 1), np.int64)
    for name, data in arrays.items():
        group, _, name_in_group = name.partition("/")  # Points is in no group
        offsets = f"{group}Offsets/{name_in_group}" if name_in_group else "PointOffsets"
        if _is_static(name):
            steps[offsets] = np.zeros(count, np.int64)
            rows = len(data)
        else:
            steps[offsets] = np.arange(count) * len(data)
            rows = len(data) * count
        root.create_dataset(name, (rows, *data.shape[1:]), data.dtype)
