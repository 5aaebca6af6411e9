"""Runs of choices, and the distances between their quantities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.quantity_values import RunRecord, difference_of, size_of
from fecloth.study.change import FIRST, Level
from fecloth.study.problems import Problem
from fecloth.study.run_problems import Point, Runs, record_at, run_or_skip
from fecloth.study.status import OK, REFUSED, failure
from fecloth.study.tuning.choices import Choice, problem_with
from fecloth.study.workload import in_words

ZERO = 1e-12  # size of a quantity that is round-off, in its SI unit
FIELD = parse_quantity("displacement")
LEAST = 1e-13  # relative: distances below it are round-off


@dataclass(frozen=True, eq=False)
class Trial:
    """The run of a choice: its row of `measure`, and what each quantity is computed from."""

    choice: Choice
    row: Mapping
    records: tuple[RunRecord, ...] = ()

    @property
    def is_ok(self) -> bool:
        """Whether it ran to its end and has all quantities."""
        return self.row["status"] == OK

    @property
    def seconds(self) -> float:
        """CPU seconds of the run."""
        return float(self.row["cpu_seconds"])

    @property
    def steps(self) -> int:
        """Number of steps, at least 1."""
        return max(int(self.row["steps"]), 1)

    @property
    def spent(self) -> float:
        """CPU seconds of the case, with its warm-up and repeated runs."""
        return float(self.row.get("case_seconds", 0.0))

    @property
    def edges(self) -> float:
        """√(number of triangles): a size of the mesh that is comparable between patterns."""
        return float(np.sqrt(self.row["triangles"]))

    @cached_property
    def cloth(self) -> Cloth:
        """The mesh, made again."""
        cloth = self.row["point"].refined.cloth_for(FIELD)
        assert cloth is not None
        return cloth


@dataclass(frozen=True, eq=False)
class Bench:
    """A problem whose choices are run for quantities."""

    opened: Problem
    quantities: tuple[Quantity, ...]
    runs: Runs

    def run(self, choices: Sequence[Choice], timed: bool = False) -> list[Trial]:
        """Run choices; one that is refused, fails or is too long gives a trial that is not ok."""
        quiet = replace(self.runs, timed=timed, quiet=True)
        rows = run_or_skip(list(map(self._point, choices)), self.quantities, quiet)
        return [self._trial(choice, row) for choice, row in zip(choices, rows, strict=True)]

    def _point(self, choice: Choice) -> Point | dict:
        """Return what runs for a choice; a row with the reason if it is refused or too long."""
        try:
            problem = problem_with(self.opened, choice)
            size = problem.workload(FIRST)
        except InputError as error:
            return failure(REFUSED, error)
        if size.seconds > (self.runs.most_seconds or math.inf):
            cause = f"it would take about {in_words(size.seconds)}, too long"
            return failure(REFUSED, cause)
        return Point(problem, Level(sharper=choice.sharper), str(choice), size)

    def within(self, seconds: float) -> Bench:
        """Return it with a time limit of its runs, in place of a longer one [s]."""
        limit = min(seconds, self.runs.time_limit or math.inf)
        return replace(self, runs=replace(self.runs, time_limit=limit))

    def _trial(self, choice: Choice, row: Mapping) -> Trial:
        if row["status"] != OK:
            return Trial(choice, row)
        try:
            records = tuple(record_at(row, quantity) for quantity in self.quantities)
            for quantity, record in zip(self.quantities, records, strict=True):
                size_of(quantity, record)  # raises where the run has none, as of a period
        except InputError as error:
            return Trial(choice, {**row, "status": "no value", "cause": str(error)})
        return Trial(choice, row, records)

    def distance(self, a: Trial, b: Trial) -> np.ndarray:
        """Return (q,) distances of the quantities of `b` from those of `a`, relative to `a`."""
        if a is b:
            return np.zeros(len(self.quantities))
        pairs = zip(self.quantities, a.records, b.records, strict=True)
        apart = [difference_of(q, x, y) / max(size_of(q, x), ZERO) for q, x, y in pairs]
        return np.nan_to_num(np.maximum(apart, LEAST), nan=np.inf)

    def check_sizes(self, trial: Trial) -> None:
        """Raise `InputError` for a quantity of size zero: it has no relative error."""
        for quantity, record in zip(self.quantities, trial.records, strict=True):
            if not size_of(quantity, record) > ZERO:
                remedy = "Choose another quantity, or its path or maximum over the run."
                raise InputError(f"{quantity} = 0", "has no relative error", "tune", remedy)


def spent(trials: Sequence[Trial]) -> float:
    """Return the CPU time of trials [s], each counted once."""
    return sum(trial.spent for trial in each_once(trials))


def each_once(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials without copies: a run that comes again from the store has its seconds."""
    return list({(run.choice, run.row.get("cpu_seconds")): run for run in trials}.values())
