"""The settings among which `tune` chooses, their runs, and the distances between these."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from fecloth.errors import InputError, amount
from fecloth.integrators import EXPLICIT, studied_by
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.quantity_values import RunRecord, difference_of, size_of
from fecloth.study.change import FIRST, Change, Level
from fecloth.study.chart_grid import ALL_METHODS, ELEMENTS, change_names, known_names
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.run_problems import Point, Runs, record_at, run_or_skip
from fecloth.study.setups import table_of_grading
from fecloth.study.status import NO_VALUE, OK, REFUSED, failure
from fecloth.study.workload import EQUILATERAL, TRIANGLES, in_words

SEARCH, COSTLY = 60.0, 6.0  # CPU time [s] of a search, and of a run that it can do without
PATTERNS = ("right", "cross", "equilateral", "unstructured")


@dataclass(frozen=True)
class Choice:
    """One setting; "", None and () stand for what the problem has."""

    element: str = ""  # "P1" or "P2"
    pattern: str = ""  # of the mesh; "" also where it has none
    h: float | None = None  # edge length [m]
    method: str = ""
    steps: int | None = None  # equal ones; without steps and rtol explicit methods take their limit
    rtol: float | None = None  # [1/s]
    sharper: float | None = None  # divides a fixed tolerance of the nonlinear solver
    grading: tuple[Grading, ...] = ()  # places with smaller triangles

    @property
    def is_explicit(self) -> bool:
        """Whether the steps follow from the stability limit."""
        return self.method in EXPLICIT

    @property
    def mesh(self) -> tuple[str, str, tuple[Grading, ...]]:
        return self.element, self.pattern, self.grading

    def __str__(self) -> str:
        mesh = self.element, self.pattern, "graded" if self.grading else ""
        size = f"h = {1e3 * self.h:.3g} mm" if self.h else ""
        how = f"rtol = {self.rtol:g} 1/s" if self.rtol else ""
        how = amount(self.steps, "step") if self.steps else how
        exact = "sharper tolerance" if self.sharper else ""
        parts = (" ".join(filter(None, mesh)), size, self.method, how, exact)
        return ", ".join(filter(None, parts))

    def with_half_of_h(self) -> "Choice":
        assert self.h is not None
        return replace(self, h=float(f"{self.h / 2:.6g}"))

    def with_half_of_dt(self) -> "Choice":
        return replace(self, steps=2 * (self.steps or 1))


def meshes_to_try(opened: Problem, elements: Sequence[str] | None) -> list[Choice]:
    """Return the elements and patterns of a problem, its own pattern first.

    Other patterns are tried with the first element only: on P2 they differ less. They have as
    many triangles as the scene's own.
    """
    if isinstance(opened, FunctionProblem):
        return [Choice(element, h=opened.h) for element in elements or ("",)]
    cloth = opened.scene.cloth
    own = cloth.pattern if cloth.shape == "rectangle" else ""
    h = cloth.h
    chosen = known_names("element", elements or ELEMENTS, ELEMENTS)
    choices = []
    for pattern in dict.fromkeys([own, *PATTERNS]) if own else [""]:
        count = [TRIANGLES.get(name, EQUILATERAL) for name in (pattern, own)]
        if h is None or pattern == own:
            size = h
        else:
            size = h * math.sqrt(count[0] / count[1])
        tried = chosen if pattern == own else chosen[:1]
        choices += [Choice(element, pattern, size) for element in tried]
    return choices


def methods_to_try(opened: Problem, methods: Sequence[str] | None) -> list[str]:
    """Return the methods of a problem; [""] where there is none to choose."""
    opened.refuse_methods(methods, "tune")
    if opened.span is None or isinstance(opened, FunctionProblem):
        return list(methods or [""])
    if methods:
        return known_names("method", methods, ALL_METHODS)
    own = opened.scene.time.method.type
    tried = sorted(studied_by("tune"), key=_preference)
    return list(dict.fromkeys([*tried, *([own] if own != "auto" else [])]))


def _preference(name: str) -> tuple:
    """Return the sort key of a method: explicit first, then by high order, then by damping."""
    traits = ALL_METHODS[name]().traits
    return not traits.explicit, -traits.order, traits.at_infinity


def problem_with(opened: Problem, choice: Choice) -> Problem:
    return opened.changed(change_of(opened, choice))


def change_of(opened: Problem, choice: Choice) -> Change:
    """Return the change to a choice; without `sharper`, which a level of the problem has."""
    if isinstance(opened, FunctionProblem):
        names = {"method": choice.method, "element": choice.element}
        dt = opened.t_end / choice.steps if choice.steps and opened.t_end else opened.dt
        return Change(values={"h": choice.h, "dt": dt} | {k: v for k, v in names.items() if v})
    names = {"element": choice.element or opened.scene.cloth.element, "model": ""}
    names["method"] = choice.method or "equilibrium"  # keeps its time as it is
    if choice.steps and opened.span:
        steps = {"dt": opened.span / choice.steps}
    else:
        steps = {}
    in_time = change_names(opened, names | ({"rtol": choice.rtol} if choice.rtol else steps))
    return Change(edits=(*in_time.edits, partial(_set_mesh, choice)))


def _set_mesh(choice: Choice, tables: dict) -> dict:
    grading = list(map(table_of_grading, choice.grading))
    values = {"pattern": choice.pattern, "h": choice.h, "grading": grading}
    tables["cloth"] |= {name: value for name, value in values.items() if value}
    if choice.is_explicit:
        tables.pop("solver", None)
    dt = tables.get("time", {}).get("dt", "auto")
    every = tables["output"].get("every")
    if dt != "auto" and every and every < dt:
        tables["output"]["every"] = dt  # frames come no more often than steps
    return tables


ZERO = 1e-12  # size of a quantity that is round-off, in its SI unit
FIELD = parse_quantity("displacement")
NOTHING, SMALL = 1e-6, 1e-2  # parts of a vector: components that are zero, or may be
LEAST = 1e-13  # relative: distances below it are round-off


@dataclass(frozen=True, eq=False)
class Trial:
    """The run of a choice: its row of `measure`, and what each quantity is computed from."""

    choice: Choice
    row: Mapping
    records: tuple[RunRecord, ...] = ()

    @property
    def is_ok(self) -> bool:
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
        cloth = self.row["point"].refined.cloth_for(FIELD)
        assert cloth is not None
        return cloth


@dataclass(frozen=True, eq=False)
class Bench:
    """A problem whose choices are run for quantities, and all runs so far."""

    opened: Problem
    quantities: tuple[Quantity, ...]
    runs: Runs
    begin: float = field(default_factory=time.process_time)  # CPU time of this process then [s]
    done: list[Trial] = field(default_factory=list)  # each run is added
    changed: int = 0  # number of the first one of this problem: those before have other terms

    def run(self, choices: Sequence[Choice], timed: bool = False) -> list[Trial]:
        """Run choices; one that is refused, fails or is too long gives a trial that is not ok."""
        quiet = replace(self.runs, timed=timed, quiet=True)
        rows = run_or_skip(list(map(self._point, choices)), self.quantities, quiet)
        trials = [self._trial(choice, row) for choice, row in zip(choices, rows, strict=True)]
        self.done.extend(trials)
        return trials

    def with_problem(self, opened: Problem) -> "Bench":
        """Return it with another problem, whose runs follow."""
        return replace(self, opened=opened, changed=len(self.done))

    def other_than(self, run: Trial | None) -> list[Trial]:
        """Return all runs but one."""
        return [trial for trial in self.done if trial is not run]

    def _point(self, choice: Choice) -> Point | dict:
        """Return what runs for a choice; a row with the reason if it is refused or too long."""
        try:
            problem = problem_with(self.opened, choice)
            size = problem.workload(FIRST)
        except InputError as error:
            return failure(REFUSED, error)
        if size.seconds > (self.runs.most_seconds or math.inf):
            return failure(REFUSED, f"it would take about {in_words(size.seconds)}, too long")
        return Point(problem, Level(sharper=choice.sharper), str(choice), size)

    def within(self, seconds: float) -> "Bench":
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
            return Trial(choice, {**row, **failure(NO_VALUE, error)})
        return Trial(choice, row, records)

    def spent(self, without: Trial | None = None) -> float:
        """Return the CPU time of the search so far [s]: of this process, and of all its runs.

        It counts what lies between the runs, as meshes and estimates of errors. Runs in other
        processes are added; of runs from the store it counts what they took.
        """
        here = time.process_time() - self.begin
        runs = spent(self.other_than(without))
        is_elsewhere = self.runs.jobs > 1 or self.runs.scheduler
        if is_elsewhere:
            return here + runs
        return max(here, runs)

    def distance(self, a: Trial, b: Trial) -> np.ndarray:
        """Return (q,) distances of the quantities of `b` from those of `a`, relative to `a`."""
        if a is b:
            return np.zeros(len(self.quantities))
        pairs = zip(self.quantities, a.records, b.records, strict=True)
        apart = [difference_of(q, x, y) / max(size_of(q, x), ZERO) for q, x, y in pairs]
        return np.nan_to_num(np.maximum(apart, LEAST), nan=np.inf)

    def check_sizes(self, trial: Trial, errors: np.ndarray | None = None) -> None:
        """Raise `InputError` for a quantity of size zero: it has no relative error.

        A component of a vector, as tip.y of a symmetric cloth, is zero below 1e-6 of the
        vector, and below a hundredth of it where the (q,) relative errors say that meshes do
        not tell it.
        """
        for k, (quantity, record) in enumerate(zip(self.quantities, trial.records, strict=True)):
            size = size_of(quantity, record)
            whole = size_of_vector(quantity, trial)
            is_unknown = errors is not None and errors[k] > 1 and size < SMALL * whole
            if size > max(ZERO, NOTHING * whole) and not is_unknown:
                continue
            what = f"{quantity} = 0"
            allowed = "has no relative error"
            if whole:
                what = f"{quantity} is {size:.2g}, where the whole vector is {whole:.2g}"
                what = f"{what}: it is zero"
                allowed = f"as by symmetry, and {allowed}"
            remedy = "Choose another quantity, or its path or maximum over the run."
            raise InputError(what, allowed, "tune", remedy)


def size_of_vector(quantity: Quantity, trial: Trial) -> float:
    """Return the length at the end of the vector whose component a quantity is; else 0."""
    name = quantity.column.rpartition(".")[0]
    ends = trial.row.get("ends", {})
    parts = [ends.get(f"{name}.{c}") for c in "xyz"]
    if not name or None in parts:
        return 0.0
    begin = name in trial.row["point"].problem.probes
    return float(np.linalg.norm([part[1] - begin * part[0] for part in parts]))


def spent(trials: Sequence[Trial]) -> float:
    """Return the CPU time of trials [s], each counted once."""
    return sum(trial.spent for trial in each_once(trials))


def each_once(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials without copies: a run that comes again from the store has its seconds."""
    seen = {(r.choice, bool(r.records), r.row.get("cpu_seconds")): r for r in trials}
    return list(seen.values())
