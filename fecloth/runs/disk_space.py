"""The space on the disk that the frames of a run need."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

from fecloth.errors import InputError
from fecloth.scene.problem import Problem

MOST_FRAMES = 100_000


def count_frames(problem: Problem) -> int:
    """Return the number of frames of a run; 1 where the number of steps is not known."""
    if problem.frame_steps is None:
        return len(problem.stops) + 2
    if not problem.dt:
        return 1
    steps = math.ceil((problem.t_end - problem.state.t) / problem.dt - 1e-9)
    return 1 + math.ceil(steps / problem.frame_steps)


def check_space(folder: Path, problem: Problem, size: int) -> None:
    """Raise `InputError` for too many frames, or if the disk has no space for them.

    Parameters
    ----------
    folder
        Of the run.
    size
        Bytes of the first frame.
    """
    count, free = count_frames(problem), shutil.disk_usage(folder).free
    remedy = "Raise every, or lower frames, in [output]."
    if count > MOST_FRAMES:
        raise InputError(f"{count} frames", f"must be at most {MOST_FRAMES}", "output", remedy)
    if count * size > free:
        what = f"{count} frames of {size / 1e6:.3g} MB"
        allowed = f"the disk of {folder} has {free / 1e9:.3g} GB left"
        raise InputError(what, allowed, "output", remedy)
