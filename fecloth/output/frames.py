"""Frames for ParaView: one .vtu for each state, listed with their times in .pvd and .vtu.series.

A frame's points are the current positions, so that no filter is needed; its arrays are the
arrays of `frame_arrays`. The time is in the field data as TimeValue, where VTK looks for it.
Positions, velocities and the time are float64: a frame read back is the state itself. All other
numbers are float32, which is enough to draw them.
"""

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.output.atomic_files import append_in_place, replace_file, writing
from fecloth.output.frame_arrays import fields, kinematics
from fecloth.output.vtu_writer import LISTS, Arrays, encode_vtu, read_vtu
from fecloth.system.state import State
from fecloth.system.system import System

MESHIO = {"P1": "triangle", "P2": "triangle6"}


@dataclass(eq=False)
class Frames:
    """Writes states as frames one by one; after each the series on disk is complete.

    A frame is written before the lists name it, and a list grows by one write in place: a run
    killed at any moment leaves lists that open, and a frame costs the same however many there
    are. Memory: 8 bytes a frame for its time.

    Attributes
    ----------
    path
        Folder and name of the series: ``path``.pvd and ``path``.vtu.series list the
        frames.
    cloth
        Mesh of the frames.
    system
        Without it, frames have no stress and no energy.
    stem
        Frame i is ``stem_00000i.vtu``, relative to the folder.
    times
        Times of the frames written so far [s].
    """

    path: Path
    cloth: Cloth
    system: System | None = None
    stem: str = "frames/frame"
    times: array = field(default_factory=lambda: array("d"))

    @property
    def opens(self) -> Path:
        """The file to open in ParaView."""
        return self._list(".pvd")

    def add(self, state: State, arrays: tuple[Arrays, Arrays] | None = None) -> Path:
        """Write the next frame and the lists; returns the frame's file.

        `arrays` are the point and cell data, where `frame_arrays.fields` has made them already.
        Raises `InputError` if the state is not one of this cloth, or a file cannot be written.
        """
        points, cells = arrays or self._fields(state)
        file = self.path.parent / self._name(len(self.times))
        replace_file(file, encode_vtu(state.x, self.cloth.cells, state.t, points, cells))
        self.times.append(state.t)
        self._list_last()
        return file

    def cut(self, times: Sequence[float]) -> None:
        """Go back to the frames of these times [s], and remove later ones.

        The lists are written anew with these frames only. Raises `InputError` if a frame is
        missing or empty; nothing is changed then.
        """
        self.times = array("d", times)
        files = [self.path.parent / self._name(i) for i in range(len(times))]
        missing = [file for file in files if not (file.is_file() and file.stat().st_size)]
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            remedy = "Restore it, or run the scene again with --overwrite."
            raise InputError(f"{missing[0]}{more}", "is missing", remedy=remedy)
        listed = [(self._name(i), t) for i, t in enumerate(self.times)]
        for suffix, encode, _ in LISTS:
            replace_file(self._list(suffix), encode(listed))
        for file in self.path.parent.glob(f"{self.stem}_*.vtu"):
            # The numbers have leading zeros, so the names have the order of the numbers.
            if file.name >= Path(self._name(len(self.times))).name:
                with writing(file):
                    file.unlink()

    def remove(self) -> None:
        """Remove the lists, and then the frames that they named."""
        for file in reversed(self.files(0)):
            with writing(file):
                file.unlink()

    def files(self, after: int) -> list[Path]:
        """Return the frames from number `after` on, and the lists."""
        frames = [self.path.parent / self._name(i) for i in range(after, len(self.times))]
        return [*frames, *(self._list(suffix) for suffix, *_ in LISTS)]

    def _name(self, number: int) -> str:
        return f"{self.stem}_{number:06d}.vtu"

    def _fields(self, state):
        """Return the point data and the cell data of a state.

        Without a system they need no material: there is no stress. Raises `InputError` for what
        is not a `State`, and for a state of another cloth.
        """
        shape = (len(self.cloth.X), 3)
        if not isinstance(state, State):
            what = f"a {type(state).__name__}"
            raise InputError(what, "must be a State", str(self.path), "Pass the states alone.")
        if state.x.shape != shape or state.v.shape != shape:
            what = f"a state with x {state.x.shape} and v {state.v.shape}"
            raise InputError(what, f"must be of shape {shape} on this cloth", str(self.path))
        if self.system is None:
            return kinematics(self.cloth, state)
        return fields(self.system.after(state.t), state)

    def _list(self, suffix: str) -> Path:
        return self.path.with_name(self.path.name + suffix)

    def _list_last(self) -> None:
        """Append the last frame to the lists on disk; the first frame creates them."""
        last = self._name(len(self.times) - 1), self.times[-1]  # its file and its time
        for suffix, encode, tail in LISTS:
            if len(self.times) == 1:
                replace_file(self._list(suffix), encode([last]))
            else:
                # The list of this frame alone without its beginning: the entry and the tail. It
                # is written over the tail of the list on disk.
                entry = encode([last]).removeprefix(encode([]).removesuffix(tail))
                between = b", " if suffix == ".vtu.series" else b""
                append_in_place(self._list(suffix), between + entry, len(tail))


def write_vtk(
    path: str | Path, cloth: Cloth, states: State | Iterable[State], system: System | None = None
) -> Path:
    """Write states as a series for ParaView; return the path of the .pvd file.

    Raises `InputError` if there is no state, one is not of this cloth, or a file cannot be
    written.

    Parameters
    ----------
    path
        Folder and name: "out/swing" makes out/swing.pvd, out/swing.vtu.series and
        out/swing_000000.vtu and so on. Folders are made; files of these names are replaced.
    states
        One state or any iterable; a generator is written state by state.
    system
        Adds stress resultants and energy density.
    """
    validation.instance("cloth", cloth, Cloth, "system.cloth", "write_vtk")
    path = Path(path)
    if path.suffix in (".pvd", ".vtu"):
        path = path.with_suffix("")
    frames = Frames(path, cloth, system, stem=path.name)
    for state in [states] if isinstance(states, State) else states:
        frames.add(state)
    if not frames.times:
        raise InputError("no states", "needs at least one", f"write_vtk({str(path)!r})")
    return path.with_name(path.name + ".pvd")


def read_frame(path: str | Path, cloth: Cloth) -> State:
    """Read the state of a .vtu that fecloth wrote for the same cloth: t, x and v bit for bit.

    Raises `InputError` if the file cannot be read, has another mesh, or lacks the velocity or
    the time.
    """
    validation.instance("cloth", cloth, Cloth, "system.cloth", "read_frame")
    mesh = read_vtu(path)
    where = str(path)
    cells = mesh.cells_dict.get(MESHIO[cloth.element], np.empty((0, cloth.cells.shape[1]), int))
    for what, count, expected in (
        ("nodes", len(mesh.points), len(cloth.X)),
        (f"{cloth.element} triangles", len(cells), len(cloth.cells)),
    ):
        if count != expected:
            remedy = "Read it onto the cloth that it was written for."
            raise InputError(f"{count} {what}", f"the cloth has {expected}", where, remedy)
    if not np.array_equal(cells, cloth.cells):
        remedy = "Make the cloth from the same mesh."
        raise InputError("its triangles join other nodes than the cloth's", "", where, remedy)
    # Another program may have written a .vtu of the same mesh without them.
    for name, data in (("velocity", mesh.point_data), ("TimeValue", mesh.field_data)):
        if name not in (data or {}):
            remedy = "Give a frame written by fecloth."
            raise InputError(f"no {name}", "a state needs it", where, remedy)
    t = float(np.ravel(mesh.field_data["TimeValue"])[0])
    return State(t, np.array(mesh.points, float), np.array(mesh.point_data["velocity"], float))


def write_mesh(path: Path, cloth: Cloth) -> None:
    """Write the flat mesh by meshio, with the quality and a 0/1 array for each node set.

    The suffix of `path` gives the format. Raises `InputError` for a suffix that meshio does not
    know, and if the file cannot be written.
    """
    import meshio  # here, as its import is slow

    points = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    inside = {f"set {name}": np.zeros(len(points)) for name in cloth.node_sets}
    for name, nodes in cloth.node_sets.items():
        inside[f"set {name}"][nodes] = 1.0
    cells = {MESHIO[cloth.element]: cloth.cells}
    quality = {"quality": [cloth.quality]}
    mesh = meshio.Mesh(points, cells, point_data=inside, cell_data=quality)
    try:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            mesh.write(path)
    except (meshio.ReadError, meshio.WriteError) as error:  # ReadError for an unknown suffix
        what = f"{path} cannot be written: {str(error).rstrip('.')}"
        raise InputError(what, remedy="Try .vtu.") from error
