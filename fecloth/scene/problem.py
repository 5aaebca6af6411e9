"""A problem: the objects of a scene."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fecloth.scene.schedule import Output
from fecloth.simulation.doubts.before_run import NOTES, find_doubts
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.record_steps import rows_at_least
from fecloth.simulation.setup import Setup
from fecloth.simulation.step_times import SAME_TIME
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
        A line for the plan of the run, or "".
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

    def doubts(self) -> list[Doubt]:
        """Return what is doubtful before the first step, also of [output]."""
        return [*super().doubts(), *self._doubt_spacings()]

    def _doubt_spacings(self) -> Iterator[Doubt]:
        """Doubt each time between two frames or restart files that is longer than the run."""
        span = self.t_end - self.start.t
        for key, files in {"every": "frames", "restart_every": "restart files"}.items():
            every = getattr(self.output, key)
            if every and every > span * (1 + SAME_TIME):
                words = (
                    f"output.{key} = {every:g} s is longer than the run of {span:g} s: there are "
                    f"{files} at the start and the end only"
                )
                remedy = f"take {key} below {span:g} s; a bare number is in seconds"
                yield Doubt(DoubtKind.STEP, words, remedy)

    def notes(self) -> list[str]:
        """Return lines for the plan of the run: facts that are easily overlooked."""
        notes = [f"note: mesh: {note}" for note in self.cloth.notes]
        notes += [self.note] if self.note else []
        return notes + [f"note: {doubt}" for doubt in find_doubts(self.planned, NOTES)]

    def next_row(self, info: StepInfo) -> Wanted:
        """Return the next step after `info` that must have a row, a frame or a restart file.

        It is wanted by its number and by its time: the step that reaches one of them first.
        """
        row = rows_at_least(self.output.rows, self.start.t, self.t_end)(info)
        step = row.step
        t = row.t
        if self.frame_steps:  # the next multiple of it
            step = min(step, info.step + self.frame_steps - info.step % self.frame_steps)
        start = self.start.t
        interval = self.output.restarts
        if isinstance(interval, int):  # steps between two restart files
            step = min(step, info.step + interval - info.step % interval)
        elif interval:  # seconds between two restart files
            # A t that round-off puts just before its restart file has reached it.
            passed = math.floor((info.t - start) / interval + 1e-9)
            t = min(t, start + interval * (passed + 1))
        return Wanted(step, t)
