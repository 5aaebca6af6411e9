"""Reading of the frames of a finished or running run: times, triangles, fields.

Users choose a field by one word: a key of `FIELDS`, or for `fecloth render` an array of the
frames.
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


@dataclass(frozen=True)
class Field:
    """A field that can be drawn.

    Attributes
    ----------
    title
        Its name in words.
    unit
        Its unit, or "".
    array
        The array of the frame that it is made of; "" for the positions.
    of
        The function from that array to the values, one for each node or triangle.
    """

    title: str
    unit: str
    array: str
    of: Callable[[np.ndarray], np.ndarray]


def _norm(values):
    return np.linalg.norm(values, axis=1)


def _component(i: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: values[:, i]


FIELDS = {
    "larger_stretch": Field("larger stretch", "", "principal_stretches", _component(1)),
    "smaller_stretch": Field("smaller stretch", "", "principal_stretches", _component(0)),
    "speed": Field("speed", "m/s", "velocity", _norm),
    "displacement": Field("displacement", "m", "displacement", _norm),
    "contact_pressure": Field("contact pressure", "Pa", "contact_pressure", np.asarray),
    "slip": Field("slip", "m/s", "slip", _norm),
    "energy_density": Field("energy density", "J/m²", "energy_density", np.asarray),
    "error_density": Field("error density", "J/m²", "error_density", np.asarray),
    "height": Field("height", "m", "", _component(2)),
    "quality": Field("quality", "", "quality", np.asarray),
    "larger_stress": Field("larger stress", "N/m", "principal_stresses", _component(1)),
    "smaller_stress": Field("smaller stress", "N/m", "principal_stresses", _component(0)),
    **{
        f"{letter}{ij}": Field(f"{letter}{ij}", unit, f"{letter}{ij}", np.asarray)
        for letter, unit in (("E", ""), ("S", "N/m"))
        for ij in ("11", "22", "12")
    },
    **{
        f"stress.{ij}": Field(f"stress {ij}", "N/m", "recovered_stress", _component(i))
        for i, ij in enumerate(("xx", "yy", "xy"))
    },
}


def names_of(frame: Frame) -> list[str]:
    """Return the names that `field_of` knows."""
    return list(dict.fromkeys([*FIELDS, *filter(None, _arrays(frame))]))


def field_of(frame: Frame, name: str) -> Field:
    """Return the field of a name: a key of `FIELDS`, or an array of the frame.

    Of an array of vectors it is their length, of another array with columns the largest one.
    Raises `InputError` for an unknown name, and for a field whose array the frame lacks.
    """
    arrays = _arrays(frame)
    if name not in FIELDS and name in arrays and name:
        units = [field.unit for field in FIELDS.values() if field.array == name]
        return Field(name.replace("_", " "), next(iter(units), ""), name, _one_number)
    known(f"field {name!r}", name, names_of(frame))
    if FIELDS[name].array not in arrays:
        available = (key for key, field in FIELDS.items() if field.array in arrays)
        remedy = f"There are {', '.join(available)}."
        raise InputError(f"field {name!r}", "is not in these frames", remedy=remedy)
    return FIELDS[name]


def field_values(frame: Frame, name: str) -> np.ndarray:
    """Return the values of a field, one per node (n,) or per triangle (m,); see `field_of`."""
    field = field_of(frame, name)
    return field.of(_arrays(frame)[field.array])


def _arrays(frame: Frame) -> Arrays:
    """Return the arrays of a frame by name; the positions have the name ""."""
    return {**frame.point_data, **frame.cell_data, "": frame.points}


def _one_number(values: np.ndarray) -> np.ndarray:
    """Return one number for each row: itself, the length of three, the largest of others."""
    if values.ndim == 1:
        return values
    return _norm(values) if values.shape[1] == 3 else values.max(axis=1)


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
