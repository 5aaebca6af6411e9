"""Runs of settings, each made once, within a limit of CPU time."""

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import size_of
from fecloth.simulation.time_error_words import LARGEST_STATED
from fecloth.study.fronts.settings import Setting, Settings
from fecloth.study.runs import Row, Run, Runs, record_at, run_quantities
from fecloth.study.status import LATE, NO_VALUE, OK, REFUSED, failure

PART_OF_TIME_LEFT = 1 / 3  # the CPU time that a run may take, over the time that is left
SHORTEST_LIMIT = 1.0  # CPU seconds that every run may take
# CPU seconds that a case may take for its set-up, beside its run: of any mesh, and of a triangle.
SET_UP = 0.5
SET_UP_OF_TRIANGLE = 2e-4
# The sizes of quantities [SI], and of components over the length of their vector, below which they
# are zero up to what solvers leave: they have no relative error.
ZERO_SIZE = 1e-12
ZERO_PART_OF_VECTOR = 1e-6
SHARPER = 100.0  # divides the solver's tolerance: what is left of it makes nearly no error


@dataclass(frozen=True, eq=False)
class Bench:
    """The settings of a problem, and the rows of the settings that have run.

    Attributes
    ----------
    settings
        The settings.
    quantities
        The q quantities that are read.
    runs
        How cases run.
    seconds
        CPU time of all runs together [s].
    rows
        The row of each setting that has run; `run` adds to them.
    sharper_rows
        The rows of settings that have run with a sharper solver.
    begin
        CPU time of this process at the begin [s].
    before
        CPU time of earlier runs with other settings [s].
    study
        The name of the study, for the lines that it prints.
    """

    settings: Settings
    quantities: tuple[Quantity, ...]
    runs: Runs
    seconds: float
    rows: dict[Setting, Row] = field(default_factory=dict)
    sharper_rows: dict[Setting, Row] = field(default_factory=dict)
    begin: float = field(default_factory=time.process_time)
    before: float = 0.0
    study: str = "front"

    def say(self, words: str) -> None:
        """Print a line on what has been reached, with the CPU time so far."""
        time_words = f"{self.spent:.0f} of {self.seconds:.0f} CPU s"
        print(f"{self.study}: {words} [{time_words}]", file=sys.stderr, flush=True)

    def with_settings(self, settings: Settings) -> "Bench":
        """Return a bench for other settings, whose runs take place in the time that is left."""
        return replace(self, settings=settings, rows={}, sharper_rows={}, before=self._in_runs)

    def with_sharper_solver(self) -> "Bench":
        """Return the same bench, whose settings run with a sharper solver in steps of time.

        The runs of both count for both. An equilibrium has no other solver: its bench stays.
        """
        if self.settings.problem.is_static or self.settings.sharper:
            return self
        settings = replace(self.settings, sharper=SHARPER)
        return replace(self, settings=settings, rows=self.sharper_rows, sharper_rows=self.rows)

    @property
    def _in_runs(self) -> float:
        """CPU time of all runs [s]."""
        rows = [*self.rows.values(), *self.sharper_rows.values()]
        return self.before + sum(float(row.get("cpu_seconds", 0.0)) for row in rows)

    @property
    def spent(self) -> float:
        """CPU time so far [s]: of this process, and of runs in other processes."""
        here = time.process_time() - self.begin
        if self.runs.jobs > 1 or self.runs.scheduler:
            return here + self._in_runs
        return max(here, self._in_runs)  # runs from the store count as what they took

    @property
    def left(self) -> float:
        """CPU time that is left [s]."""
        return self.seconds - self.spent

    def allows(self, seconds: float) -> bool:
        """Whether a run that should take so many CPU seconds may begin."""
        return seconds <= max(PART_OF_TIME_LEFT * self.left, SHORTEST_LIMIT)

    def run(self, setting: Setting, most: float = math.inf) -> Row:
        """Return the row of a setting, which runs unless it has run before.

        A run ends early if its first steps tell that it would take more than `most` CPU seconds,
        or a third of the time that is left. A setting that is refused, or that has no value of a
        quantity, has a row with the reason. The row of a run that ended after `most` seconds is
        not kept, so that the setting may run again with more.
        """
        if setting in self.rows:
            return self.rows[setting]
        longest = max(PART_OF_TIME_LEFT * self.left, SHORTEST_LIMIT)
        row = self._measure(setting, self.runs, round(min(most, longest), 3))
        if row["status"] != LATE or most >= longest:
            self.rows[setting] = row
        return row

    def run_again(self, setting: Setting) -> Row:
        """Run a setting once more, with its CPU seconds measured with care."""
        how = replace(self.runs, timed=True, fresh=True)
        return self._measure(setting, how, most=math.inf)

    def _measure(self, setting: Setting, how: Runs, most: float) -> Row:
        """Return the row of a setting, which runs for at most so many CPU seconds."""
        try:
            problem = self.settings.problem_of(setting)
        except InputError as error:
            return {**failure(REFUSED, error), "problem": self.settings.problem}
        run = Run(problem, f"{setting.line}, {setting.i}, {setting.j}")
        set_up = SET_UP + SET_UP_OF_TRIANGLE * problem.work.triangles
        limit = min(how.time_limit or math.inf, round(most + set_up, 2))
        how = replace(how, quiet=True, time_limit=limit if math.isfinite(limit) else None)
        (row,) = run_quantities([run], self.quantities, how)
        if row["status"] != OK:
            return row
        try:
            for quantity in self.quantities:
                size_of(quantity, record_at(row, quantity))
        except InputError as error:  # as where a signal has no period
            row |= failure(NO_VALUE, error)
        if row["time_error"] >= LARGEST_STATED:
            row |= failure("not resolved", "the run says that its error in time is not resolved")
        return row

    def is_ok(self, setting: Setting) -> bool:
        """Whether a setting has run to its end."""
        return setting in self.rows and self.rows[setting]["status"] == OK

    def took(self, setting: Setting) -> float:
        """Return the CPU seconds of the run of a setting; infinite where it has none."""
        if self.is_ok(setting):
            return float(self.rows[setting]["cpu_seconds"])
        return math.inf

    def late(self) -> list[Setting]:
        """Return the settings that were stopped because the time was short."""
        return [setting for setting, row in self.rows.items() if row["status"] == LATE]


def check_sizes(quantities: Sequence[Quantity], row: Row, where: str) -> None:
    """Raise `InputError` if a quantity of a run is zero: then it has no relative error.

    A component of a vector counts as zero below 1e-6 of the length of the vector, such as tip.y
    of a symmetric cloth.
    """
    for quantity in quantities:
        size = size_of(quantity, record_at(row, quantity))
        length = _length_of_vector(quantity, row)
        if size > max(ZERO_SIZE, ZERO_PART_OF_VECTOR * length):
            continue
        what = f"{quantity} = 0"
        allowed = "has no relative error"
        if length:
            what = f"{quantity} is {size:.2g}, where the whole vector is {length:.2g}: it is zero"
            allowed = f"as by symmetry, and {allowed}"
        remedy = "Choose another quantity, or its path or maximum over the run."
        raise InputError(what, allowed, where, remedy)


def _length_of_vector(quantity: Quantity, row: Mapping) -> float:
    """Return the length of the vector at the end of a run, of which a quantity is a component.

    The vector of a probe is its displacement from the start to the end of the run, because the
    length of a position depends on the origin. Return 0 for a quantity that is no component of a
    vector.
    """
    name = quantity.column.rpartition(".")[0]
    components = [row["ends"].get(f"{name}.{axis}") for axis in "xyz"]
    if not name or None in components:
        return 0.0
    is_probe = name in row["problem"].source.probes
    return float(np.linalg.norm([end - is_probe * start for start, end in components]))


Measure = Callable[[Setting], Row]
Cells = dict[str, Any]
