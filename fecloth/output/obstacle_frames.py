"""The obstacles of a run for pictures: frames/obstacles_00000i.vtu, listed in obstacles.pvd.

Obstacles that do not move are written once, with the first frame; otherwise each frame has its
own. An endless one, as a plane, is drawn as far as the cloth is long.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fecloth.output.atomic_files import replace_file, writing
from fecloth.output.vtu_writer import encode_pvd, encode_vtu, read_vtu
from fecloth.system.state import State
from fecloth.system.system import System

LIST = "obstacles.pvd"


class Obstacles(NamedTuple):
    """Points (p, 3) [m] and triangles (q, 3) of all obstacles at one time, as far as drawn."""

    points: np.ndarray
    triangles: np.ndarray


def find_obstacles(system: System, x: np.ndarray, t: float) -> Obstacles | None:
    """Return the surfaces of all obstacles at the time t [s] as one; None without obstacles.

    Endless obstacles are drawn around the middle of the positions x (n, 3) [m], as far as the
    cloth is long.
    """
    place = (x.min(axis=0) + x.max(axis=0)) / 2
    reach = system.cloth.extent
    shown = [term.surface(t, place, reach) for term in system.bound]
    surfaces = [surface for surface in shown if surface is not None]
    if not surfaces:
        return None
    points = [points for points, _ in surfaces]
    counts = [len(points_of_one) for points_of_one in points]
    begins = np.cumsum(counts) - counts  # number of each surface's first point
    triangles = [
        triangles_of_one + begin
        for (_, triangles_of_one), begin in zip(surfaces, begins, strict=True)
    ]
    return Obstacles(np.vstack(points), np.vstack(triangles))


@dataclass(eq=False)
class ObstacleFrames:
    """Writes the obstacles of a system beside the frames of a run.

    Attributes
    ----------
    folder
        The folder of the run.
    system
        Its terms are asked for obstacles.
    around
        (n, 3) positions about which endless obstacles are drawn [m].
    listed
        The files written so far, each with its time [s].
    last
        The obstacles that were written last, or None.
    """

    folder: Path
    system: System
    around: np.ndarray
    listed: list[tuple[str, float]] = field(default_factory=list)
    last: Obstacles | None = None

    def add(self, number: int, state: State) -> None:
        """Write the obstacles at the time of a state, unless they are where they were.

        `number` is the number of the frame, by which the file is named. The list of the files is
        written anew, too.
        """
        now = find_obstacles(self.system, self.around, state.t)
        if now is None:
            return
        if self.last is not None and all(map(np.array_equal, now, self.last)):
            return
        name = _name(number)
        replace_file(self.folder / name, encode_vtu(now.points, now.triangles, state.t, {}, {}))
        self.listed.append((name, state.t))
        replace_file(self.folder / LIST, encode_pvd(self.listed))
        self.last = now

    def cut(self, times: Sequence[float]) -> None:
        """Go back to the frames of these times [s], and remove what was written later."""
        for file in _files(self.folder):
            if file.name >= Path(_name(len(times))).name:
                with writing(file):
                    file.unlink()
        written = [(_name(i), float(t)) for i, t in enumerate(times)]
        self.listed = [(name, t) for name, t in written if (self.folder / name).exists()]
        if self.listed:
            replace_file(self.folder / LIST, encode_pvd(self.listed))
        self.last = read_obstacles(self.folder, len(times) - 1)


def _name(number: int) -> str:
    return f"frames/obstacles_{number:06d}.vtu"


def _files(folder: Path) -> list[Path]:
    return sorted((folder / "frames").glob("obstacles_*.vtu"))


def read_obstacles(folder: Path, number: int) -> Obstacles | None:
    """Return the obstacles in frame `number` of the run in `folder`; None if it has none.

    They are in the last file up to this frame, because they are written only where they move.
    """
    up_to_frame = [file for file in _files(folder) if file.name <= Path(_name(number)).name]
    if not up_to_frame:
        return None
    file = up_to_frame[-1]
    if b'NumberOfPoints="0"' in file.read_bytes():  # meshio refuses a mesh without any
        return Obstacles(np.empty((0, 3)), np.empty((0, 3), np.int64))
    mesh = read_vtu(file)
    return Obstacles(mesh.points, mesh.cells_dict["triangle"])
