"""Two results on one mesh, for ParaView: the positions of both, and their difference."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.output.frame_arrays import fields
from fecloth.output.frame_reader import Frame, Series, straight
from fecloth.output.frames import Frames, write_vtk
from fecloth.output.vtu_writer import Arrays
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True, eq=False)
class Overlay:
    """Two states, each with its system; the meshes may differ, the piece of cloth must not.

    Attributes
    ----------
    first
        Result A: its system and its state.
    second
        Result B: its system and its state.
    arrays
        `other`, the positions x_B(X), and `difference`, x_B(X) − x_A(X). Both are (n, 3), at the
        nodes of A.
    """

    first: tuple[System, State]
    second: tuple[System, State]
    arrays: Arrays

    @classmethod
    def of(cls, first: tuple[System, State], second: tuple[System, State]) -> "Overlay":
        """Return the overlay of two results.

        Raises `MeshError` if a node of A does not lie on the cloth of B.
        """
        system_a, state_a = first
        system_b, state_b = second
        arrays = overlay_arrays(system_a.cloth, state_a.x, system_b.cloth, state_b.x)
        return cls(first, second, arrays)

    def write(self, folder: str | Path) -> Path:
        """Write both results to the folder, for ParaView; return the path of first.pvd.

        first.pvd has the first result with `other` and `difference`, second.pvd the second one.
        """
        folder = Path(folder)
        system, state = self.first
        points, cells = fields(system, state)
        frames = Frames(folder / "first", system.cloth, system, stem="first")
        frames.add(state, (points | self.arrays, cells))
        other_system, other_state = self.second
        write_vtk(folder / "second", other_system.cloth, other_state, other_system)
        return frames.opens


def overlay_arrays(cloth: Cloth, x: np.ndarray, other: Cloth, other_x: np.ndarray) -> Arrays:
    """Return `other` and `difference` (n, 3) at the nodes of `cloth`, by material points."""
    positions = other.interpolator(cloth.X) @ other_x
    return {"other": positions, "difference": positions - x}


def compare_runs(folder_a: str | Path, folder_b: str | Path, output: str | Path) -> Path:
    """Write the frames of run A with the positions of run B and the difference, for ParaView.

    The folders are of two runs of one piece of cloth, whose meshes may differ: a position is
    interpolated linearly at the material point. `output` is folder and name of the new series,
    as "out/springs/overlay". Returns the .pvd file. Its frames are the frames of A whose time
    B has, too, with `displacement`, `velocity`, `reference`, `other` = x_B(X) and `difference`
    = x_B(X) − x_A(X). Raises `InputError` if a folder has no frames, or the runs have no time
    in common, and `MeshError` if a node of A does not lie on the cloth of B.
    """
    series_a = Series.open(folder_a)
    series_b = Series.open(folder_b)
    # times that differ by less are the same time
    round_off = 1e-9 * max(abs(series_a.times[-1]), abs(series_b.times[-1]), 1e-300)
    pairs = []  # numbers of the frames of A and B at the same time
    for i, t in enumerate(series_a.times):
        nearest = series_b.at(t)
        if abs(series_b.times[nearest] - t) <= round_off:
            pairs.append((i, nearest))
    if not pairs:
        remedy = "Give both scenes the same t_end and output.frames."
        raise InputError(f"{folder_a} and {folder_b}", "have no time in common", "", remedy)
    cloth = _cloth_of(series_a.read(0))
    other_cloth = _cloth_of(series_b.read(0))
    path = Path(output)
    frames = Frames(path, cloth, stem=path.name)
    for i, nearest_b in pairs:
        frame = series_a.read(i)
        other_points = series_b.read(nearest_b).points
        arrays = overlay_arrays(cloth, frame.points, other_cloth, other_points)
        for name in ("displacement", "velocity", "reference"):
            arrays[name] = frame.point_data[name]
        state = State(frame.t, frame.points, frame.point_data["velocity"])
        frames.add(state, (arrays, {}))
    return frames.opens


def _cloth_of(frame: Frame) -> Cloth:
    """Return the reference mesh of a frame, quadratic triangles as four linear ones."""
    X = frame.point_data["reference"][:, :2]
    return Cloth.from_arrays(X, straight(frame.cells), renumber=False)
