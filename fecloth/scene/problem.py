"""A problem: the objects of a scene."""

import math
from dataclasses import dataclass

from fecloth.scene.schedule import Output
from fecloth.simulation.doubts.before_run import NOTES, find_doubts
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.record_steps import rows_at_least
from fecloth.simulation.setup import Setup
from fecloth.simulation.steps import StepInfo


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(Setup):
    """The objects of a scene, ready to run, and what a run of it writes.

    Attributes
    ----------
    t_end
        The end [s]; in static scenes the part of the loads, 1.
    frame_steps
        Steps between two frames of the output; None: there are frames at the `stops`.
    output
        The table [output] of the scene.
    note
        A line to print before the run, or "".
    unit
        What follows a value of t in words: " s" or " of the loads".
    """

    t_end: float
    frame_steps: int | None
    output: Output
    note: str = ""
    unit: str = " s"

    @property
    def dt(self) -> float | None:
        """The step [s] if it is fixed, else None."""
        return self.steps.dt

    def notes(self) -> list[str]:
        """Return lines to print before the run: facts that are easily overlooked."""
        notes = [self.note] if self.note else []
        return notes + [f"note: {doubt}" for doubt in find_doubts(self.planned, NOTES)]

    def next_row(self, info: StepInfo) -> Wanted:
        """Return the next step after `info` that must have a row, a frame or a restart file."""
        row = rows_at_least(self.output.rows, self.start.t, self.t_end)(info)
        step = row.step
        t = row.t
        if self.frame_steps:
            step = min(step, info.step + self.frame_steps - info.step % self.frame_steps)
        start = self.start.t
        every = self.output.restarts
        if isinstance(every, int):
            step = min(step, info.step + every - info.step % every)
        elif every:
            passed = math.floor((info.t - start) / every + 1e-9)
            t = min(t, start + every * (passed + 1))
        return Wanted(step, t)
