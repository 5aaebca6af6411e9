"""Frames for ParaView: one .vtu for each state, and a .pvd and a .vtu.series that hold the times.

A frame's points are the current positions, so that it shows without a filter. Its arrays:

    displacement          (n, 3)  x − (X, 0) [m]
    velocity              (n, 3)  [m/s]
    green_strain          (m, 3)  E11, E22, E12
    principal_stretches   (m, 2)  smaller, larger
    quality               (m,)    4√3 A / Σ l² of the reference triangle
    stress_resultants     (m, 3)  S11, S22, S12 [N/m]
    energy_density        (m,)    W [J/m²] per reference area

1 is the warp and 2 the weft, wherever the grain of the system lays them (without a system, X and
Y); ParaView shows the components by these names. Cell values are means over the reference
triangle. Triangles of the element P2 are VTK's quadratic ones, `Cloth.cells`; ParaView draws them
curved from a "Nonlinear Subdivision Level" of 1 on. The time stands in the field data as
TimeValue, where VTK looks for it. Numbers are float64, compressed without loss, so that a frame
read back is the state itself.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.output.atomic_files import lengthen, replace_file, writing
from fecloth.output.vtu_writer import LISTS, Arrays, encode_vtu
from fecloth.system.system import State, System
from fecloth.terms.kinematics import deformation_gradient, principal_stretches

MESHIO = {"P1": "triangle", "P2": "triangle6"}


# --- what a frame shows ---------------------------------------------------------------------------


def fields(system: System, state: State) -> tuple[Arrays, Arrays]:
    """Point data and cell data of a state, named and ordered as at the head of this file.

    Stress resultants and energy density are summed over the membrane terms; a system without one
    has neither.
    """
    points, cells = kinematics(system.cloth, state, system.panel.gradients)
    membranes = [term for term in system.bound if hasattr(term, "add_stress")]
    if membranes:
        stress = np.zeros((len(system.cloth.triangles), 4))
        for term in membranes:
            term.add_stress(state.x, stress)
        cells |= {"stress_resultants": stress[:, :3], "energy_density": stress[:, 3]}
    return points, cells


def kinematics(
    cloth: Cloth, state: State, gradients: np.ndarray | None = None
) -> tuple[Arrays, Arrays]:
    """The point data and cell data that need no material.

    `gradients` are those along warp and weft, `Panel.gradients`; left out, along X and Y.
    """
    moved = state.x.copy()
    moved[:, :2] -= cloth.X
    cells = {
        "green_strain": _green_strain(cloth, state.x, gradients),
        "principal_stretches": principal_stretches(cloth, state.x),
        "quality": cloth.quality,
    }
    return {"displacement": moved, "velocity": state.v}, cells


def _green_strain(cloth, x, gradients):
    """(m, 3) means of E11, E22, E12 over each triangle."""
    F = deformation_gradient(cloth, x, gradients)
    share = cloth.weights / cloth.weights.sum(axis=1, keepdims=True)
    C11, C22 = np.einsum("eq,eqij,eqij->je", share, F, F)
    C12 = np.einsum("eq,eqi,eqi->e", share, F[..., 0], F[..., 1])
    return np.column_stack([(C11 - 1) / 2, (C22 - 1) / 2, C12 / 2])


# --- frames in a folder ---------------------------------------------------------------------------


@dataclass(eq=False)
class Frames:
    """Writes states as frames, one by one; after each the series on disk is whole.

    Every file is replaced in one go, frames before the lists that name them, so that a run killed
    at any moment leaves lists that open. In memory stay the times only, 8 bytes a frame.

    Attributes
    ----------
    path
        Folder and name of the series: ``path``.pvd and ``path``.vtu.series list the frames.
    cloth, system
        What is shown; without a system, no stress and no energy.
    stem
        Frame i is ``stem``_00000i.vtu, relative to the folder.
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

    def add(self, state: State) -> Path:
        """Write the next frame and the lists; returns the frame's file.

        Raises
        ------
        InputError
            If the state is not one of this cloth, or a file cannot be written.
        """
        points, cells = self._fields(state)
        file = self.path.parent / self._name(len(self.times))
        frame = encode_vtu(state.x, self.cloth.cells, state.t, points, cells)
        replace_file(file, frame)
        self.times.append(state.t)
        self._list_last()
        return file

    def keep(self, times: Sequence[float]) -> None:
        """Go on after an earlier run's frames of these times; its later ones are removed."""
        self.times = array("d", times)
        listed = [(self._name(i), t) for i, t in enumerate(self.times)]
        for suffix, encode, _ in LISTS:
            replace_file(self._list(suffix), encode(listed))
        for file in self.path.parent.glob(f"{self.stem}_*.vtu"):
            if file.name >= Path(self._name(len(self.times))).name:
                with writing(file):
                    file.unlink()

    def files(self, after: int) -> list[Path]:
        """The frames from number `after` on, and the lists."""
        frames = [self.path.parent / self._name(i) for i in range(after, len(self.times))]
        return [*frames, *(self._list(suffix) for suffix, *_ in LISTS)]

    def _name(self, number: int) -> str:
        return f"{self.stem}_{number:06d}.vtu"

    def _fields(self, state):
        shape = (len(self.cloth.X), 3)
        if not isinstance(state, State):
            given = f"a {type(state).__name__}"
            raise InputError(given, "must be a State", str(self.path), "Pass the states alone.")
        if state.x.shape != shape or state.v.shape != shape:
            given = f"a state with x {state.x.shape} and v {state.v.shape}"
            raise InputError(given, f"must be of shape {shape} on this cloth", str(self.path))
        return kinematics(self.cloth, state) if self.system is None else fields(self.system, state)

    def _list(self, suffix: str) -> Path:
        return self.path.with_name(self.path.name + suffix)

    def _list_last(self) -> None:
        """Name the last frame in the lists; the first one begins them."""
        last = self._name(len(self.times) - 1), self.times[-1]
        for suffix, encode, tail in LISTS:
            if len(self.times) == 1:
                replace_file(self._list(suffix), encode([last]))
            else:
                entry = encode([last]).removeprefix(encode([]).removesuffix(tail))
                between = b", " if suffix == ".vtu.series" else b""
                lengthen(self._list(suffix), between + entry, len(tail))


def write_vtk(
    path: str | Path, cloth: Cloth, states: State | Iterable[State], system: System | None = None
) -> Path:
    """Write states as a series that opens in ParaView; returns the .pvd file.

    Parameters
    ----------
    path
        Folder and name: "out/swing" makes out/swing.pvd, out/swing.vtu.series and
        out/swing_000000.vtu and so on. Folders are made; files of these names are replaced.
    states
        One state or any iterable; a generator is written as it goes.
    system
        Adds stress resultants and energy density.

    Raises
    ------
    InputError
        If there is no state, one is not of this cloth, or a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    >>> steps = fc.march(system, fc.BackwardEuler(), system.rest(), dt=0.01, t_end=0.03)
    >>> states = (state for state, info in steps)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pvd = write_vtk(f"{folder}/swing", cloth, states, system)
    ...     print(pvd.name, len(list(pvd.parent.glob("*.vtu"))))
    swing.pvd 3
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
    """The state of a .vtu that fecloth wrote for the same cloth: t, x and v bit for bit.

    Raises
    ------
    InputError
        If the file cannot be read, shows another mesh, or lacks the velocity or the time.
    """
    from meshio import vtu

    validation.instance("cloth", cloth, Cloth, "system.cloth", "read_frame")
    where = str(path)
    try:
        mesh = vtu.read(path)
    except Exception as error:  # meshio lets pass whatever a broken file provokes
        remedy = "Give a frame written by fecloth."
        raise InputError(f"cannot be read ({error})", where=where, remedy=remedy) from error
    cells = mesh.cells_dict.get(MESHIO[cloth.element], np.empty((0, cloth.cells.shape[1]), int))
    for what, found, known in (
        ("nodes", len(mesh.points), len(cloth.X)),
        (f"{cloth.element} triangles", len(cells), len(cloth.cells)),
    ):
        if found != known:
            remedy = "Read it onto the cloth that it was written for."
            raise InputError(f"{found} {what}", f"the cloth has {known}", where, remedy)
    if not np.array_equal(cells, cloth.cells):
        remedy = "Make the cloth from the same mesh."
        raise InputError("its triangles join other nodes than the cloth's", "", where, remedy)
    for name, data in (("velocity", mesh.point_data), ("TimeValue", mesh.field_data)):
        if name not in (data or {}):
            remedy = "Give a frame written by fecloth."
            raise InputError(f"no {name}", "a state needs it", where, remedy)
    t = float(np.ravel(mesh.field_data["TimeValue"])[0])
    return State(t, np.array(mesh.points, float), np.array(mesh.point_data["velocity"], float))
