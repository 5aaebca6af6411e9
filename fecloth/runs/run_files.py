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
from fecloth.runs import restart as restarts
from fecloth.runs.folder import RunFolder
from fecloth.runs.restart import Progress, Restart
from fecloth.scene.problem import Problem
from fecloth.simulation.steps import Memory
from fecloth.system.state import State

TABLES = ("steps", "energies", "observed", "strains")
MOST_FRAMES = 100_000  # of a run: more are taken for a mistake
_FEWER = "Raise every, or lower frames, in [output]."


class RunFiles:
    """The open tables and frames of a run.

    Attributes
    ----------
    opens
        The file to open in ParaView.
    gathered
        The file of all frames of a complete run, if the scene asks for it.
    on_disk
        Number of the frames that would survive a power cut.
    """

    def __init__(self, folder: RunFolder, problem: Problem):
        self.folder = folder
        self.problem = problem
        self.frames = Frames(folder.path / "run", problem.cloth, problem.system)
        self.opens = self.frames.opens
        self.gathered = folder.path / "run.vtkhdf"
        self.obstacles = ObstacleFrames(folder.path, problem.system, problem.start.x)
        self.tables = {name: folder.table(f"{name}.csv") for name in TABLES}
        self.on_disk = 0

    @property
    def sizes(self) -> dict[str, int]:
        """Number of bytes of each table."""
        return {name: table.size for name, table in self.tables.items()}

    def commit(self, restart: Restart) -> None:
        """Write a restart file, when all that it needs would survive a power cut."""
        self.folder.check_in_place()
        frames = self.frames.files(self.on_disk)
        flush_to_disk(*(table.path for table in self.tables.values()), *frames)
        flush_to_disk(*{file.parent for file in frames} - {self.folder.path})
        self.on_disk = len(self.frames.times)
        restarts.write(self.folder.path, restart)  # flushes the folder of the run, too

    def cut(self, progress: Progress) -> None:
        """Go back to a progress: remove the rows, frames and restart files that came after it.

        Raise `InputError` if rows or frames before it were lost, and `WriteError` if the system
        refuses the change.
        """
        if self.gathered.exists():
            self._scatter()
        for name, size in progress.tables.items():
            self.tables[name].cut(size)
        self.frames.cut(self.tables["strains"].column("t"))  # it has a row for each frame
        self.obstacles.cut(self.frames.times)
        self.on_disk = min(self.on_disk, len(self.frames.times))
        last_restart = restarts.path_of(self.folder.path, progress)
        for path in restarts.files(self.folder.path):
            if path.name > last_restart.name:
                with writing(path):
                    path.unlink()

    def add_rows(self, rows: Mapping[str, Mapping[str, object]]) -> None:
        """Write a row of some tables."""
        for name, row in rows.items():
            self.tables[name].add(row)

    def frame(self, state: State, memory: Memory | None) -> Frame:
        """Return the frame of a state, with what terms remember."""
        problem = self.problem
        history = memory.term_history if memory else None
        system = problem.system.after(state.t)
        history = history or system.start_history(state)
        system = system.with_history(history)
        points, cells = fields(system, state, problem.output.error_density)
        return Frame(state.t, state.x, problem.cloth.cells, points, cells)

    def add_frame(self, state: State, memory: Memory | None) -> Arrays:
        """Write the state as a frame, with what terms remember, and return its cell data.

        Also write the obstacles at that time. Raise `WriteError` if the folder has moved, and
        `InputError` for more than `MOST_FRAMES` frames.
        """
        self.folder.check_in_place()
        if len(self.frames.times) >= MOST_FRAMES:
            raise InputError("one frame more", f"must be at most {MOST_FRAMES}", remedy=_FEWER)
        frame = self.frame(state, memory)
        self.obstacles.add(len(self.frames.times), state)
        self.frames.add(state, (frame.point_data, frame.cell_data))
        return frame.cell_data

    def _scatter(self) -> None:
        """Write single frames from the file that a complete run gathered, and remove that file.

        A run that goes on beyond its end adds further frames to them.
        """
        series = Series.open(self.folder.path)
        for i in range(len(series.times)):
            frame = series.read(i)
            state = State(frame.t, frame.points, frame.point_data["velocity"])
            self.frames.add(state, (frame.point_data, frame.cell_data))
        self.gathered.unlink()

    def gather(self) -> None:
        """Put the frames of a whole run into one file, if the scene asks for it."""
        if self.problem.output.format == "vtkhdf":
            self.opens = gather(Series.open(self.folder.path), self.gathered)
            self.frames.remove()
            with suppress(OSError):  # it holds obstacles
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
