"""Reading of the frames of a finished or running run: times, triangles, fields.

Users choose a field by one word: an array of the frames, or a key of `COMPONENTS`.
Quadratic triangles are cut into four straight ones.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.elements import QUARTERS
from fecloth.output.vtu_writer import Arrays, read_vtu
from fecloth.validation import known

# The span between larger values, or an axis that is a little longer, would overflow.
LARGEST_DRAWABLE = np.finfo(float).max / 4


@dataclass(frozen=True, eq=False)
class Frame:
    """One time of a series.

    Attributes
    ----------
    t
        The time [s].
    points
        (n, 3) positions of the nodes [m].
    cells
        (m, 3) or (m, 6) nodes of the triangles.
    point_data
        Arrays with a row for each node.
    cell_data
        Arrays with a row for each triangle.
    """

    t: float
    points: np.ndarray
    cells: np.ndarray
    point_data: Arrays
    cell_data: Arrays


UNITS = {  # of arrays; the array "" has the positions
    "": "m",
    "velocity": "m/s",
    "displacement": "m",
    "reference": "m",
    "contact_pressure": "Pa",
    "slip": "m/s",
    "recovered_stress": "N/m",
    "principal_stresses": "N/m",
    "stress_tensor": "N/m",
    "S11": "N/m",
    "S22": "N/m",
    "S12": "N/m",
    "energy_density": "J/m²",
    "error_density": "J/m²",
}
# Names of single components: the array, and the column.
COMPONENTS = {
    "larger_stretch": ("principal_stretches", 1),
    "smaller_stretch": ("principal_stretches", 0),
    "larger_stress": ("principal_stresses", 1),
    "smaller_stress": ("principal_stresses", 0),
    "stress.xx": ("recovered_stress", 0),
    "stress.yy": ("recovered_stress", 1),
    "stress.xy": ("recovered_stress", 2),
    "height": ("", 2),
}


def fields_of(frame: Frame) -> list[str]:
    """Return the names of all fields that a frame has: components, and its arrays."""
    arrays = _arrays(frame)
    components = [name for name, (array, _) in COMPONENTS.items() if array in arrays]
    return [*components, *filter(None, arrays)]


def unit_of_field(name: str) -> str:
    """Return the unit of a field, or ""."""
    array, _ = COMPONENTS.get(name, (name, 0))
    return UNITS.get(array, "")


def field_values(frame: Frame, name: str) -> np.ndarray:
    """Return the values of a field, one per node (n,) or per triangle (m,).

    `name` is a key of `COMPONENTS`, or an array of the frame: of vectors it is their length, of
    another array with columns the largest one. Raises `InputError` for a name that the frame
    lacks.
    """
    known(f"field {name!r}", name, fields_of(frame))
    arrays = _arrays(frame)
    if name in COMPONENTS:
        array, column = COMPONENTS[name]
        return arrays[array][:, column]
    values = arrays[name]
    if values.ndim == 1:
        return values
    return np.linalg.norm(values, axis=1) if values.shape[1] == 3 else values.max(axis=1)


def _arrays(frame: Frame) -> Arrays:
    """Return the arrays of a frame by name; the positions have the name ""."""
    return {**frame.point_data, **frame.cell_data, "": frame.points}


def drawable(values: np.ndarray) -> np.ndarray:
    """Return which values can be drawn; the values of a cloth that blows up may overflow."""
    return np.abs(values) < LARGEST_DRAWABLE  # False for NaN


def clip_to_drawable(values: np.ndarray) -> np.ndarray:
    """Return the values as float64, clipped to the extremes of those that can be drawn.

    NaN becomes the largest of them; without any, all values become 0.
    """
    values = np.asarray(values, dtype=float)
    numbers = values[drawable(values)]
    if not numbers.size:
        return np.zeros_like(values)
    low = numbers.min()
    high = numbers.max()
    return np.clip(np.where(np.isnan(values), high, values), low, high)


@dataclass(frozen=True, eq=False)
class Series:
    """The frames of a run, or of `write_vtk`, read one at a time.

    Attributes
    ----------
    folder
        The folder of the frames.
    times
        The times of the frames [s].
    read
        The function from the number of a frame, from 0, to the `Frame`.
    """

    folder: Path
    times: tuple[float, ...]
    read: Callable[[int], Frame]

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """Open the folder of a run, or the path that `write_vtk` was given or has returned.

        Raises `InputError` if there are no frames, or their list cannot be read.
        """
        given_path = folder = Path(path)
        listed = folder / "run.vtu.series"
        single = folder / "run.vtkhdf"
        if not (listed.is_file() or single.is_file()):  # the path is of `write_vtk`
            folder = given_path.parent
            # It has returned out/swing.pvd for the list out/swing.vtu.series.
            listed = Path(f"{given_path}.vtu.series".replace(".pvd.", "."))
        # The run gathers its frames in one file first, and then removes them.
        if single.is_file():
            return cls(folder, _read_times(single), lambda i: _read_hdf(single, i))
        if listed.is_file():
            try:
                entries = json.loads(listed.read_text(encoding="utf-8"))["files"]
                files = [folder / entry["name"] for entry in entries]
                times = tuple(float(entry["time"]) for entry in entries)
            except (ValueError, KeyError, TypeError) as error:
                remedy = "Run the scene again."
                raise InputError(f"{listed}", f"cannot be read ({error})", "", remedy) from error
            return cls(folder, times, lambda i: _read_vtu(files[i], times[i]))
        remedy = "Give the folder of a run, as out/flag."
        raise InputError(f"{given_path}", "has no frames", "", remedy)

    def at(self, time: float | None) -> int:
        """Return the number of the frame closest to a time [s]; the last for None."""
        if time is None:
            time = self.times[-1]
        return int(np.argmin(np.abs(np.array(self.times) - time)))

    def spread(self, most: int) -> list[int]:
        """Return the numbers of up to `most` frames, evenly spread from the first to the last."""
        count = min(max(most, 1), len(self.times))
        numbers = np.round(np.linspace(len(self.times) - 1, 0, count)).astype(int)
        return np.unique(numbers).tolist()


def straight(cells: np.ndarray) -> np.ndarray:
    """Return triangles (m or 4 m, 3) to draw; cell i has the triangle i, or 4 i to 4 i + 3."""
    if cells.shape[1] == 3:
        return cells
    return cells[:, QUARTERS].reshape(-1, 3)


def rim(triangles: np.ndarray) -> np.ndarray:
    """Return the edges (k, 2) of one triangle only."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    return unique[counts == 1]


def _read_vtu(file: Path, t: float) -> Frame:
    mesh = read_vtu(file)
    cell_data = {name: values[0] for name, values in mesh.cell_data.items()}
    return Frame(t, mesh.points, mesh.cells[0].data, mesh.point_data, cell_data)


def h5py():
    """Return the package, or raise an `InputError` that says how to install it."""
    try:
        import h5py
    except ImportError as error:
        remedy = 'Install it: in the clone, pip install ".[hdf]", or write format = "vtu".'
        raise InputError("a .vtkhdf file needs the package h5py", remedy=remedy) from error
    return h5py


@contextmanager
def _hdf(file: Path) -> Iterator:
    try:
        with h5py().File(file, "r", locking=False) as opened:
            yield opened["VTKHDF"]
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error}") from error


def _read_times(file: Path) -> tuple[float, ...]:
    with _hdf(file) as root:
        steps = root["Steps"]
        return tuple(steps["Values"][: steps.attrs["NSteps"]].tolist())


def _read_hdf(file: Path, i: int) -> Frame:
    """Return frame i of a .vtkhdf file, whose layout `vtkhdf_writer` describes."""
    with _hdf(file) as root:
        steps = root["Steps"]
        n = int(root["NumberOfPoints"][0])
        m = int(root["NumberOfCells"][0])

        def arrays(group, rows):
            """Return the frame's rows of each array in the group PointData or CellData."""
            begins = {name: int(steps[f"{group}Offsets/{name}"][i]) for name in root[group]}
            return {name: root[group][name][b : b + rows] for name, b in begins.items()}

        begin = int(steps["PointOffsets"][i])
        points = root["Points"][begin : begin + n]
        cells = root["Connectivity"][:].reshape(m, -1)
        t = float(steps["Values"][i])
        return Frame(t, points, cells, arrays("PointData", n), arrays("CellData", m))
