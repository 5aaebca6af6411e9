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
from fecloth.study.change import FIRST_LEVEL, Change, Level
from fecloth.study.chart_grid import ALL_METHODS, ELEMENTS, change_names, known_names
from fecloth.study.problems import FunctionProblem, Problem
from fecloth.study.run_problems import Point, Runs, record_at, run_or_skip
from fecloth.study.setups import table_of_grading
from fecloth.study.status import NO_VALUE, OK, REFUSED, failure
from fecloth.study.workload import EQUILATERAL, TRIANGLES, in_words

# CPU seconds that a search may take, where the tuned run itself is short.
SEARCH_SECONDS = 60.0
# CPU seconds of a run that the search leaves out if it can do without: a tenth of its time.
COSTLY_SECONDS = 6.0
# A cause of an error counts from this part of the whole error. Of the tolerance, this part is left
# to each cause that is not space or time of the tuned run: steps that all meshes share, changed
# terms, gaps, and the error of the best run.
COUNTING_SHARE = 0.25
HALVINGS = 4  # largest number of halvings of h or dt, until a run serves: a factor of 16
# Nodes along an edge of P2 over the nodes of P1. Explicit steps on P2 are shorter by as much.
NODES_OF_P2 = 2.0
# Seconds of a run with half of h, over the seconds of the run. It lies in the upper half of 2
# to 2^3.2 = 9, by the powers of √triangles with which the seconds of a step grow.
HALF_OF_H_COSTS = 6.0
# Relative distances below it are round-off; they have logarithms in place of 0.
ROUND_OFF_OF_DISTANCES = np.finfo(float).eps
ZERO_SIZE = 1e-12  # size of a quantity that is round-off, in its SI unit
# A component is zero by symmetry below the first part of its vector, which solvers leave. Below
# the second it may be zero: it is, where meshes do not even tell its first digit.
ZERO_PART_OF_VECTOR = 1e-6
SMALL_PART_OF_VECTOR = 1e-2
FIELD = parse_quantity("displacement")
PATTERNS = ("right", "cross", "equilateral", "unstructured")


@dataclass(frozen=True)
class Choice:
    """One setting; "", None and () stand for what the problem itself has.

    Attributes
    ----------
    element
        "P1" or "P2".
    pattern
        Pattern of the mesh; "" also where the mesh has none.
    h
        Edge length [m].
    method
        Method in time.
    steps
        Number of equal steps. Without `steps` and `rtol`, explicit methods take their limit.
    rtol
        Tolerance of the chosen steps [1/s].
    sharper
        Divides a fixed tolerance of the nonlinear solver.
    grading
        Places with smaller triangles.
    """

    element: str = ""
    pattern: str = ""
    h: float | None = None
    method: str = ""
    steps: int | None = None
    rtol: float | None = None
    sharper: float | None = None
    grading: tuple[Grading, ...] = ()

    @property
    def is_explicit(self) -> bool:
        """Whether the steps follow from the stability limit."""
        return self.method in EXPLICIT

    @property
    def mesh(self) -> tuple[str, str, tuple[Grading, ...]]:
        """The kind of the mesh: element, pattern and grading."""
        return self.element, self.pattern, self.grading

    def __str__(self) -> str:
        """Return the setting in words, such as "P1 right, h = 10 mm, bdf2, 64 steps".

        What the problem itself has is left out.
        """
        words = [self.element, self.pattern]
        if self.grading:
            words.append("graded")
        parts = [" ".join(filter(None, words))]
        if self.h:
            parts.append(f"h = {1e3 * self.h:.3g} mm")
        parts.append(self.method)
        if self.steps:
            parts.append(amount(self.steps, "step"))
        elif self.rtol:
            parts.append(f"rtol = {self.rtol:g} 1/s")
        if self.sharper:
            parts.append("sharper tolerance")
        return ", ".join(filter(None, parts))

    def with_half_of_h(self) -> "Choice":
        """Return the choice with half of h, rounded to six digits."""
        assert self.h is not None
        return replace(self, h=float(f"{self.h / 2:.6g}"))

    def with_half_of_dt(self) -> "Choice":
        """Return the choice with twice as many steps."""
        return replace(self, steps=2 * (self.steps or 1))


def meshes_to_try(opened: Problem, elements: Sequence[str] | None) -> list[Choice]:
    """Return a choice for each element and pattern to try, the problem's own pattern first.

    `elements` are the names that the caller gave; None for P1 and P2. Raise `InputError` for an
    unknown name.

    Each other pattern is tried with the first element only: on P2 the patterns differ less. Its
    h gives as many triangles as the scene's own pattern.
    """
    if isinstance(opened, FunctionProblem):
        return [Choice(element, h=opened.h) for element in elements or ("",)]
    cloth = opened.scene.cloth
    element_names = known_names("element", elements or ELEMENTS, ELEMENTS)
    if cloth.shape != "rectangle" or not cloth.pattern:  # only a rectangle has patterns
        return [Choice(element, h=cloth.h) for element in element_names]
    own_pattern = cloth.pattern
    choices = [Choice(element, own_pattern, cloth.h) for element in element_names]
    for pattern in PATTERNS:
        if pattern != own_pattern:
            h = None
            if cloth.h is not None:
                h = cloth.h * _ratio_of_h(pattern, own_pattern)
            choices.append(Choice(element_names[0], pattern, h))
    return choices


def _ratio_of_h(pattern: str, own: str) -> float:
    """Return h of a pattern over h of the scene's own, for as many triangles."""
    triangles = TRIANGLES.get(pattern, EQUILATERAL)
    return math.sqrt(triangles / TRIANGLES.get(own, EQUILATERAL))


def methods_to_try(opened: Problem, methods: Sequence[str] | None) -> list[str]:
    """Return the names of the methods to try; [""] where there is none to choose.

    `methods` are the names that the caller gave; None for the methods that `tune` usually
    tries, the preferred one first, with the scene's own. Raise `InputError` for an unknown name,
    and for methods of an equilibrium, which has none.
    """
    opened.refuse_methods(methods, "tune")
    if opened.span is None or isinstance(opened, FunctionProblem):
        return list(methods or [""])
    if methods:
        return known_names("method", methods, ALL_METHODS)
    usual_methods = sorted(studied_by("tune"), key=_preference)
    own_method = opened.scene.time.method.type
    if own_method not in ("auto", *usual_methods):  # "auto" is no method of its own
        return [*usual_methods, own_method]
    return usual_methods


def _preference(name: str) -> tuple:
    """Return the sort key of a method: explicit first, then by high order, then by damping."""
    traits = ALL_METHODS[name]().traits
    return not traits.explicit, -traits.order, traits.at_infinity


def problem_with(opened: Problem, choice: Choice) -> Problem:
    """Return the problem with a choice, whose `sharper` is left to a `Level`."""
    return opened.changed(change_of(opened, choice))


def change_of(opened: Problem, choice: Choice) -> Change:
    """Return the change of the problem to a choice.

    It leaves out `choice.sharper`, because a `Level`, and no change, sharpens the solver.
    """
    if isinstance(opened, FunctionProblem):
        return _change_of_function(opened, choice)
    names: dict[str, object] = {
        "element": choice.element or opened.scene.cloth.element,
        "model": "",  # the membrane stays as it is
        "method": choice.method or "equilibrium",  # with "equilibrium", [time] stays as it is
    }
    if choice.rtol:
        names["rtol"] = choice.rtol
    elif choice.steps and opened.span:
        names["dt"] = opened.span / choice.steps
    in_time = change_names(opened, names)
    return Change(edits=(*in_time.edits, partial(_set_mesh, choice)))


def _change_of_function(opened: FunctionProblem, choice: Choice) -> Change:
    """Return the change of a function's arguments: h, dt, and where chosen method and element.

    dt is the problem's own unless the choice has a number of steps.
    """
    values: dict[str, object] = {"h": choice.h, "dt": opened.dt}
    if choice.steps and opened.t_end:
        values["dt"] = opened.t_end / choice.steps
    if choice.method:
        values["method"] = choice.method
    if choice.element:
        values["element"] = choice.element
    return Change(values=values)


def _set_mesh(choice: Choice, tables: dict) -> dict:
    """Set the mesh of a choice in the tables of a scene, and return the tables.

    What no longer fits the method goes, too: the solver of explicit steps, and frames that come
    more often than steps.
    """
    grading = list(map(table_of_grading, choice.grading))
    values = {"pattern": choice.pattern, "h": choice.h, "grading": grading}
    tables["cloth"] |= {name: value for name, value in values.items() if value}
    if choice.is_explicit:
        tables.pop("solver", None)  # explicit steps have no nonlinear solver
    dt = tables.get("time", {}).get("dt", "auto")
    every = tables["output"].get("every")
    if dt != "auto" and every and every < dt:
        tables["output"]["every"] = dt  # frames come no more often than steps
    return tables


@dataclass(frozen=True, eq=False)
class Trial:
    """The run of a choice.

    Attributes
    ----------
    choice
        The setting.
    row
        Its row of `measure`.
    records
        What each quantity is computed from; empty if the run failed or measured seconds only.
    """

    choice: Choice
    row: Mapping
    records: tuple[RunRecord, ...] = ()

    @property
    def is_ok(self) -> bool:
        """Whether the run reached its end and has the quantities."""
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
        """The cloth of the run, for its displacement."""
        cloth = self.row["point"].refined.cloth_for(FIELD)
        assert cloth is not None
        return cloth


@dataclass(frozen=True, eq=False)
class Bench:
    """A problem whose choices are run for quantities, and all runs so far.

    Attributes
    ----------
    opened
        The problem.
    quantities
        The q quantities that count.
    runs
        How cases are run.
    begin
        CPU time of this process when the search began [s].
    done
        All runs so far; `run` adds to them.
    changed
        The index in `done` of the first run of this problem. Earlier runs have other terms.
    """

    opened: Problem
    quantities: tuple[Quantity, ...]
    runs: Runs
    begin: float = field(default_factory=time.process_time)
    done: list[Trial] = field(default_factory=list)
    changed: int = 0

    def run(self, choices: Sequence[Choice], timed: bool = False) -> list[Trial]:
        """Run choices, add their trials to `done`, and return them in the same order.

        Where a choice is refused, fails or is too long, its trial is not `is_ok`. With `timed`
        the seconds are measured with care: after a warm-up, and by repeated runs if they are
        short.
        """
        quiet = replace(self.runs, timed=timed, quiet=True)
        rows = run_or_skip(list(map(self._point_of, choices)), self.quantities, quiet)
        trials = [self._trial_of(choice, row) for choice, row in zip(choices, rows, strict=True)]
        self.done.extend(trials)
        return trials

    def with_problem(self, opened: Problem) -> "Bench":
        """Return the bench with another problem, whose runs follow."""
        return replace(self, opened=opened, changed=len(self.done))

    def other_than(self, run: Trial | None) -> list[Trial]:
        """Return all runs but one."""
        return [trial for trial in self.done if trial is not run]

    def _point_of(self, choice: Choice) -> Point | dict:
        """Return the point to run for a choice.

        If the problem refuses the choice, or the run is predicted to take too long, return in
        its place the row of a failed run, with the reason.
        """
        try:
            problem = problem_with(self.opened, choice)
            workload = problem.workload(FIRST_LEVEL)
        except InputError as error:
            return failure(REFUSED, error)
        if workload.seconds > (self.runs.most_seconds or math.inf):
            how_long = in_words(workload.seconds)
            return failure(REFUSED, f"it would take about {how_long}, too long")
        return Point(problem, Level(sharper=choice.sharper), str(choice), workload)

    def within(self, seconds: float) -> "Bench":
        """Return the bench with a time limit of its runs, in place of a longer one [s]."""
        limit = min(seconds, self.runs.time_limit or math.inf)
        return replace(self, runs=replace(self.runs, time_limit=limit))

    def _trial_of(self, choice: Choice, row: Mapping) -> Trial:
        """Return the trial of a run, from its row of `measure`.

        If the run reached its end but has no value of a quantity, as where a signal has no
        period, the trial is not `is_ok`, and its row says why.
        """
        if row["status"] != OK:
            return Trial(choice, row)
        try:
            records = tuple(record_at(row, quantity) for quantity in self.quantities)
            for quantity, record in zip(self.quantities, records, strict=True):
                size_of(quantity, record)  # raises `InputError` where the run has no value
        except InputError as error:
            return Trial(choice, {**row, **failure(NO_VALUE, error)})
        return Trial(choice, row, records)

    def spent(self, without: Trial | None = None) -> float:
        """Return the CPU time of the search so far [s]: of this process, and of all its runs.

        It counts what lies between the runs, as meshes and estimates of errors. Runs in other
        processes are added; of runs from the store it counts what they took.
        """
        in_this_process = time.process_time() - self.begin
        in_runs = spent(self.other_than(without))
        if self.runs.jobs > 1 or self.runs.scheduler:  # the runs are elsewhere
            return in_this_process + in_runs
        return max(in_this_process, in_runs)

    def distance(self, a: Trial, b: Trial) -> np.ndarray:
        """Return how far the quantities of `b` lie from the ones of `a`, (q,), relative to `a`.

        A distance that is not known, as of a NaN, is infinite. Of two different runs it is never
        0, because its logarithm is taken.
        """
        if a is b:
            return np.zeros(len(self.quantities))
        distances = []
        for quantity, of_a, of_b in zip(self.quantities, a.records, b.records, strict=True):
            size = max(size_of(quantity, of_a), ZERO_SIZE)
            distances.append(difference_of(quantity, of_a, of_b) / size)
        return np.nan_to_num(np.maximum(distances, ROUND_OFF_OF_DISTANCES), nan=np.inf)

    def check_sizes(self, trial: Trial, errors: np.ndarray | None = None) -> None:
        """Raise `InputError` if a quantity of a run is zero: then it has no relative error.

        A component of a vector counts as zero below 1e-6 of the length of the vector, such as
        tip.y of a symmetric cloth. If its relative error is above 1, it counts as zero already
        below a hundredth of that length. `errors` (q,) are the relative errors of the
        quantities; None if they are not known yet.
        """
        for k, (quantity, record) in enumerate(zip(self.quantities, trial.records, strict=True)):
            size = size_of(quantity, record)
            length = size_of_vector(quantity, trial)
            is_zero = size <= max(ZERO_SIZE, ZERO_PART_OF_VECTOR * length)
            is_small = size < SMALL_PART_OF_VECTOR * length
            has_error_above_1 = errors is not None and errors[k] > 1
            if not is_zero and not (is_small and has_error_above_1):
                continue
            what = f"{quantity} = 0"
            allowed = "has no relative error"
            if length:
                what = f"{quantity} is {size:.2g}, where the whole vector is {length:.2g}"
                what = f"{what}: it is zero"
                allowed = f"as by symmetry, and {allowed}"
            remedy = "Choose another quantity, or its path or maximum over the run."
            raise InputError(what, allowed, "tune", remedy)


def size_of_vector(quantity: Quantity, trial: Trial) -> float:
    """Return the length of the vector at the end of a run, of which a quantity is a component.

    For a probe it is the distance from its start to its end: a place alone has no size. Return 0
    for a quantity that is no component of a vector.
    """
    name = quantity.column.rpartition(".")[0]
    ends = trial.row.get("ends", {})
    components = [ends.get(f"{name}.{axis}") for axis in "xyz"]
    if not name or None in components:
        return 0.0
    is_probe = name in trial.row["point"].problem.probes
    return float(np.linalg.norm([end - is_probe * start for start, end in components]))


def spent(trials: Sequence[Trial]) -> float:
    """Return the CPU time of trials [s], each counted once."""
    return sum(trial.spent for trial in each_once(trials))


def each_once(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials without copies: a run from the store has the same seconds again."""
    by_run = {
        (trial.choice, bool(trial.records), trial.row.get("cpu_seconds")): trial for trial in trials
    }
    return list(by_run.values())
