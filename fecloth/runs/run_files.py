"""The tables and frames of a running scene, and the space on the disk that frames need."""

import math
import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from fecloth.errors import InputError, amount
from fecloth.output.atomic_files import flush_to_disk, writing
from fecloth.output.frame_arrays import fields
from fecloth.output.frame_reader import Frame, Series
from fecloth.output.frames import Frames
from fecloth.output.obstacle_frames import ObstacleFrames
from fecloth.output.vtkhdf_writer import gather
from fecloth.output.vtu_writer import Arrays
from fecloth.runs.folder import RunFolder
from fecloth.runs.restart import Progress
from fecloth.scene.problem import Problem
from fecloth.simulation.steps import Memory
from fecloth.system.state import State

GATHERED = "run.vtkhdf"
TABLES = ("steps", "energies", "observed", "strains")
MOST_FRAMES = 100_000  # of a run: more are taken for a mistake
_FEWER = "Raise every, or lower frames, in [output]."


class RunFiles:
    """The open tables and frames of a run.

    Attributes
    ----------
    opens
        The file to open in ParaView.
    on_disk
        Number of the frames that would survive a power cut.
    """

    def __init__(self, folder: RunFolder, problem: Problem):
        self.folder = folder
        self.problem = problem
        self.frames = Frames(folder.path / "run", problem.cloth, problem.system)
        self.opens = self.frames.opens
        self.obstacles = ObstacleFrames(folder.path, problem.system, problem.start.x)
        self.tables = {name: folder.table(f"{name}.csv") for name in TABLES}
        self.on_disk = 0

    def keep(self) -> None:
        """Continue after the frames of the rows in strains.csv; remove later ones."""
        if (self.folder.path / GATHERED).exists() and not self.opens.exists():
            self._scatter()
        self.frames.keep(self.tables["strains"].column("t"))
        self.on_disk = len(self.frames.times)
        self.obstacles.keep(self.frames.times)

    @property
    def sizes(self) -> dict[str, int]:
        """Number of bytes of each table."""
        return {name: table.size for name, table in self.tables.items()}

    def cut(self, progress: Progress) -> None:
        """Remove the rows and frames that were written since."""
        del self.frames.times[progress.frames :]
        for name, size in progress.tables.items():
            self.tables[name].cut(size)

    def add_rows(self, rows: Mapping[str, Mapping[str, object]]) -> None:
        """Write a row of some tables."""
        for name, row in rows.items():
            self.tables[name].add(row)

    def frame(self, state: State, memory: Memory | None) -> Frame:
        """Return the frame of a state, with what terms remember."""
        problem = self.problem
        history = memory.term_history if memory else None
        history = history or problem.system.start_history(state)
        system = problem.system.with_history(history)
        points, cells = fields(system, state, problem.output.error_density)
        return Frame(state.t, state.x, problem.cloth.cells, points, cells)

    def add_frame(self, state: State, memory: Memory | None) -> Arrays:
        """Write the state as a frame, with what terms remember, and return its cell data.

        Also write the obstacles at that time. Raise `FolderMoved` if the folder has moved, and
        `InputError` for more than `MOST_FRAMES` frames.
        """
        self.folder.check_in_place()
        if len(self.frames.times) >= MOST_FRAMES:
            raise InputError("one frame more", f"must be at most {MOST_FRAMES}", remedy=_FEWER)
        frame = self.frame(state, memory)
        self.obstacles.add(len(self.frames.times), state)
        self.frames.add(state, (frame.point_data, frame.cell_data))
        return frame.cell_data

    def flush(self) -> None:
        """Hand the tables and new frames to the disk, so that they survive a power cut.

        Their folders, too, but not the folder of the run itself: `restart.write` does that.
        """
        frames = self.frames.files(self.on_disk)
        flush_to_disk(*(table.path for table in self.tables.values()), *frames)
        flush_to_disk(*{file.parent for file in frames} - {self.folder.path})
        self.on_disk = len(self.frames.times)

    def _scatter(self) -> None:
        """Write single frames from the file that a complete run gathered, and remove that file.

        A run that goes on beyond its end adds further frames to them.
        """
        series = Series.open(self.folder.path)
        for i in range(len(series.times)):
            frame = series.read(i)
            state = State(frame.t, frame.points, frame.point_data["velocity"])
            self.frames.add(state, (frame.point_data, frame.cell_data))
        (self.folder.path / GATHERED).unlink()

    def gather(self) -> None:
        """Write the frames of a whole run into one file, if the scene asks for it."""
        if self.problem.output.format == "vtkhdf":
            self.opens = gather(Series.open(self.folder.path), self.folder.path / GATHERED)

    def remove_gathered(self) -> None:
        """Remove the frames, first the lists of them, if they are in one file."""
        if self.opens != self.frames.opens:
            for file in reversed(self.frames.files(0)):
                with writing(file):
                    file.unlink()
        with suppress(OSError):  # it holds frames, or obstacles
            (self.folder.path / "frames").rmdir()

    def close(self) -> None:
        """Close the tables."""
        for table in self.tables.values():
            table.close()


def count_frames(problem: Problem) -> int:
    """Return the number of frames of a run; 1 where the number of steps is not known."""
    if problem.frame_steps is None:
        return len(problem.stops) + 2
    if not problem.dt:
        return 1
    steps = math.ceil((problem.t_end - problem.start.t) / problem.dt - 1e-9)
    return 1 + math.ceil(steps / problem.frame_steps)


def check_space(folder: Path, problem: Problem, size: int) -> None:
    """Raise `InputError` if a run has more than `MOST_FRAMES` frames, or no space for them.

    `size` is the size of a frame in bytes; the space is that of the disk of `folder`.
    """
    count = count_frames(problem)
    free = shutil.disk_usage(folder).free
    if count > MOST_FRAMES:
        raise InputError(f"{count} frames", f"must be at most {MOST_FRAMES}", "output", _FEWER)
    if count * size > free:
        what = f"{amount(count, 'frame')} of {size / 1e6:.3g} MB"
        allowed = f"the disk of {folder} has {free / 1e9:.3g} GB left"
        raise InputError(what, allowed, "output", _FEWER)
