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
from fecloth.study.levels import Level
from fecloth.study.measured_runs import record_of
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.run_problems import Point, Runs, run_points
from fecloth.study.status import OK
from fecloth.study.tuning.choices import Choice, problem_with
from fecloth.study.workload import Workload, in_words

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
        point = self.row["point"]
        cloth = point.problem.cloth_of(point.level, FIELD)
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
        most = self.runs.most_seconds or math.inf
        rows: dict[int, Mapping] = {}
        points = {}
        for i, choice in enumerate(choices):
            try:
                problem = problem_with(self.opened, choice)
                level = Level(sharper=choice.sharper)
                size = size_of_run(problem)
                if size.seconds > most:
                    cause = f"it would take about {in_words(size.seconds)}, too long"
                    rows[i] = {"status": "refused", "cause": cause}
                else:
                    points[i] = Point(problem, level, str(choice), size)
            except InputError as error:
                rows[i] = {"status": "refused", "cause": str(error).splitlines()[0]}
        if points:
            runs = replace(self.runs, timed=timed, quiet=True)
            found = run_points(list(points.values()), self.quantities, runs)
            rows |= dict(zip(points, found, strict=True))
        return [self._trial(choice, rows[i]) for i, choice in enumerate(choices)]

    def within(self, seconds: float) -> Bench:
        """Return it with a time limit of its runs, in place of a longer one [s]."""
        limit = min(seconds, self.runs.time_limit or math.inf)
        return replace(self, runs=replace(self.runs, time_limit=limit))

    def _trial(self, choice: Choice, row: Mapping) -> Trial:
        if row["status"] != OK:
            return Trial(choice, row)
        problem = row["point"].problem
        try:
            records = tuple(
                record_of(row, one, problem.cloth_of(row["point"].level, one), problem.probes)
                for one in self.quantities
            )
            for one, record in zip(self.quantities, records, strict=True):
                size_of(one, record)  # raises where the run has none, as of a period
        except InputError as error:
            return Trial(choice, {**row, "status": "no value", "cause": str(error)})
        return Trial(choice, row, records)

    def distance(self, a: Trial, b: Trial) -> np.ndarray:
        """Return (q,) distances of the quantities of `b` from those of `a`, relative to `a`."""
        if a is b:
            return np.zeros(len(self.quantities))
        pairs = zip(self.quantities, a.records, b.records, strict=True)
        apart = [difference_of(one, x, y) / max(size_of(one, x), ZERO) for one, x, y in pairs]
        return np.nan_to_num(np.maximum(apart, LEAST), nan=np.inf)

    def check_sizes(self, trial: Trial) -> None:
        """Raise `InputError` for a quantity of size zero: it has no relative error."""
        for one, record in zip(self.quantities, trial.records, strict=True):
            if not size_of(one, record) > ZERO:
                remedy = "Choose another quantity, or its path or maximum over the run."
                raise InputError(f"{one} = 0", "has no relative error", "tune", remedy)


def spent(trials: Sequence[Trial]) -> float:
    """Return the CPU time of trials [s], each counted once."""
    return sum(one.spent for one in each_once(trials))


def each_once(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials without copies: a run that comes again from the store has its seconds."""
    return list({(one.choice, one.row.get("cpu_seconds")): one for one in trials}.values())


def size_of_run(problem: Problem) -> Workload:
    """Predict the size of a run without its mesh, where that is possible."""
    if not isinstance(problem, SceneProblem):
        return problem.workload(Level())
    return Workload.of(problem.scene)
