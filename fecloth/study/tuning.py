"""`tune`: an accepted error in, the cheapest proven setting out."""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.quantities.units import TIME
from fecloth.quantities.units import quantity as read_quantity
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import relative_difference
from fecloth.study.budgeting.budget import tolerance_of_data
from fecloth.study.fronts.bench import Bench
from fecloth.study.fronts.front import (
    SECONDS,
    USUAL_AXES,
    Plan,
    describe_setting,
    make_rows,
    search_lines,
)
from fecloth.study.fronts.limit import find_limit
from fecloth.study.fronts.search import Search
from fecloth.study.fronts.settings import Line, Setting, Settings
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import StudyProblem, refuse_methods
from fecloth.study.result import Table, in_percent, read_tolerance
from fecloth.study.runs import Run, Runs, print_doubts, record_at, refuse_huge, run_quantities
from fecloth.study.status import OK
from fecloth.study.term_variants import simpler_terms
from fecloth.study.tuning_result import Tuned

# Of the tolerance: what is left to the gaps of contact, and to changed terms.
PART_OF_CAUSE = 0.25
NARROWEST_GAP = 32.0  # gaps are divided by so much at most; the error that is left is stated
NO_H = (
    "the mesh has no h, so it is not refined, and its error in space is not known; "
    "a .geo file with h in [cloth] can be refined"
)
TIGHTER = 10**0.5  # with a budget: a tolerance over the next smaller one that is tried
FIRST_OF_BUDGET = 0.1  # with a budget: the first tolerance
LEAST_OF_BUDGET = 1e-5  # and the last one
COARSE = 2  # how often h and dt are refined where terms and gaps are compared
STEPS_OF_COARSE = 3  # and dt there: 32 steps


def tune(
    problem: Scene | str | Path | Callable | Opened,
    tolerance: float | str | None = None,
    quantity: str | Quantity | Sequence[str | Quantity] | None = None,
    *,
    budget: float | str | None = None,
    to_data: bool = False,
    model: bool = False,
    methods: Sequence[str] | None = None,
    elements: Sequence[str] | None = None,
    folder: str | Path | None = None,
    seconds: float = SECONDS,
    **shared: Any,
) -> Tuned:
    """Find the cheapest setting of a problem that meets a tolerance, and prove its error.

    It is the cheapest setting of the `front` of the problem: settings run in the order of their
    cost, from coarse ones on, and their errors are distances to the limit of the quantities. The
    setting is proved if its error and the uncertainty of the limit together are within the
    tolerance. The limit counts only if its last two changes, from level to level, shrink as the
    order says. The setting is run once more. A run that calls its own error in time "not
    resolved" proves nothing.

    With contact the gaps are divided until their error, of first order, takes at most a quarter
    of the tolerance.

    Parameters
    ----------
    problem
        As for `of`. What the function takes as `method` and `element` varies as `methods` and
        `elements` say; h and dt vary always.
    tolerance
        Largest relative error of each quantity, as 0.01 or "1%"; None for 1 % without a budget.
    quantity
        One or more; by default all of [interest], the paths of the probes (in a static scene
        their ends), or the displacement.
    budget
        Longest CPU time of the tuned run, as 60.0 [s] or "60 s". The most accurate setting
        within it is sought in place of the cheapest one, so that a tolerance beside it is
        refused.
    to_data
        Whether the tolerance is a third of how uncertain the quantities are by [uncertain] and
        [fabric.uncertainty]; see `fecloth.study.budget`. A smaller error is work for nothing.
    model
        Whether terms may be left out or replaced by cheaper ones, if that changes the quantities
        by less than a quarter of the tolerance.
    methods, elements
        Names as in a scene, by default the usual methods with the scene's own, and P1 and P2.
    folder
        Where tuned.toml is written; None for nowhere.
    seconds
        Longest CPU time of all runs together [s]. If it is up, the answer says so.
    shared
        Arguments of `fecloth.study.of`: h, dt, t_end, probes, settings; cache, jobs, scheduler,
        time_limit, fresh.

    Raises
    ------
    InputError
        For a tolerance outside 0 to 100 %, an unknown quantity or one of size zero, or an
        unknown name.
    StudyFailed
        If no run on a coarse mesh reaches its end.
    """
    study = open_study(problem, shared)
    opened, runs = study.problem, study.runs()
    refuse_huge(opened, runs)
    if to_data:
        if tolerance is not None:
            raise InputError("to_data and tolerance are given", "give one of them", "tune")
        tolerance = tolerance_of_data(study, quantity)
        words = f"tune: tolerance by the data: {100 * tolerance:.2g} %"
        print(words, file=sys.stderr, flush=True)
    refuse_methods(opened, methods, "tune")
    goal = read_goal(tolerance, budget)
    validation.number("seconds", seconds, 0.0, "tune")
    quantities = opened.choose_quantities(quantity)
    if any(asked.function for asked in quantities):
        raise InputError("a function as quantity", "must be a text, as 'max tip.z'", "tune")
    axes: dict[str, list | None] = dict.fromkeys(USUAL_AXES)
    axes |= {
        name: list(given) for name, given in (("method", methods), ("element", elements)) if given
    }
    plan = Plan(opened, quantities, axes, goal.tolerance, seconds, runs)
    doubts = print_doubts(opened)
    tuned = find_tuned(plan, goal, model=model)
    tuned = replace(tuned, doubts=doubts)
    return replace(tuned, scene=tuned.write_scene(folder))


@dataclass(frozen=True)
class Goal:
    """What `tune` looks for: a tolerance, or the longest CPU time of the tuned run [s]."""

    tolerance: float = FIRST_OF_BUDGET
    budget: float = math.inf

    @property
    def has_budget(self) -> bool:
        """Whether the most accurate setting within a time is sought."""
        return math.isfinite(self.budget)


def read_goal(tolerance: float | str | None, budget: float | str | None) -> Goal:
    """Return the goal from the arguments of `tune`; without both, a tolerance of 1 %.

    Raise `InputError` if both are given, for a tolerance outside 0 to 100 %, and for a budget
    that is no time > 0.
    """
    if budget is None:
        return Goal(tolerance=read_tolerance(0.01 if tolerance is None else tolerance))
    if tolerance is not None:
        what = f"tolerance = {tolerance!r} and budget = {budget!r}"
        remedy = "A budget seeks the most accurate setting, a tolerance the cheapest."
        raise InputError(what, "only one of them may be given", "tune", remedy)
    seconds = read_quantity("budget", budget, TIME) if isinstance(budget, str) else budget
    if not 0 < seconds < math.inf:
        allowed = 'must be a time > 0, as 60.0 [s] or "60 s"'
        raise InputError(f"budget = {budget!r}", allowed, "tune")
    return Goal(budget=float(seconds))


@dataclass(frozen=True, eq=False)
class Reduced:
    """A problem with changed terms and gaps, and the errors that these changes make.

    Attributes
    ----------
    problem
        The changed problem.
    errors
        The largest relative error by cause, "model" and "gap".
    changes
        The changes in words.
    """

    problem: StudyProblem
    errors: Mapping[str, float] = field(default_factory=dict)
    changes: tuple[str, ...] = ()


def find_tuned(plan: Plan, goal: Goal, model: bool) -> Tuned:
    """Return the result of a plan."""
    how = replace(plan.runs, jobs=1)  # each setting tells which one is next
    bench = Bench(Settings.of(plan.problem), plan.quantities, how, plan.seconds, study="tune")
    reduced = Reduced(plan.problem)
    if model:
        bench.say("terms: what they change on a coarse mesh")
        reduced = leave_out_terms(reduced, bench, plan.tolerance)
    if reduced.problem.has_contact:
        bench.say("gaps of contact: what halving them changes on a coarse mesh")
        reduced = narrow_gaps(reduced, bench, plan.tolerance)
    plan = replace(plan, problem=reduced.problem)
    bench = bench.with_settings(Settings.of(plan.problem))
    other = sum(reduced.errors.values())
    if not other < plan.tolerance and not goal.has_budget:
        why = f"changed terms and gaps alone make an error of {in_percent(other)}"
        limit = find_limit(bench, plan.lines(), plan.tolerance)
        return make_tuned(plan, goal, reduced, Search(bench, limit, plan.tolerance), why)
    if goal.has_budget:
        search, why = search_within_budget(plan, bench, goal)
    else:
        inner = replace(plan, tolerance=plan.tolerance - other)
        bench.say("stage 1 of 2: the limit, by levels that are ever finer")
        limit = find_limit(bench, inner.lines(), inner.tolerance, report=bench.say)
        search, why = search_lines(inner, bench, limit, inner.lines())
    return make_tuned(plan, goal, reduced, search, why)


def search_within_budget(plan: Plan, bench: Bench, goal: Goal) -> tuple[Search, str]:
    """Search with smaller tolerances, as long as a setting within the budget meets them.

    Return the last search in which one did, or the first one.
    """
    tolerance = FIRST_OF_BUDGET
    best: Search | None = None
    why = ""
    while tolerance >= LEAST_OF_BUDGET:
        bench.say(f"settings with an error of {in_percent(tolerance)}")
        tighter = replace(plan, tolerance=tolerance)
        limit = find_limit(bench, tighter.lines(), tolerance, report=bench.say)
        search, why = search_lines(tighter, bench, limit, tighter.lines(), goal.budget)
        if best is None or search.cheapest:
            best = search
        if why or not search.cheapest:
            break
        tolerance /= TIGHTER
    assert best is not None
    return best, why


# --- terms and gaps, compared on a coarse mesh ---------------------------------------------------


def coarse_problem(problem: StudyProblem, settings: Settings) -> StudyProblem:
    """Return a problem on a coarse mesh with a method of second order, to compare terms on it."""
    line = Line() if problem.is_static else Line(method=_method_to_compare(problem))
    setting = Setting(line, COARSE, STEPS_OF_COARSE)
    return problem.choose(**settings.choice(setting))


def _method_to_compare(problem: StudyProblem) -> str:
    """Return the method with which terms are compared: "bdf2" where the problem can have it."""
    return "bdf2" if "method" in problem.source.usual_variations else ""


def leave_out_terms(reduced: Reduced, bench: Bench, tolerance: float) -> Reduced:
    """Leave out terms, or replace them by cheaper ones, as long as the quantities change little.

    Each change runs alone on a coarse mesh; those within a quarter of the tolerance that save
    time are combined, the fastest first, as long as the combination changes no more. Membranes
    are not left out: in free fall they change nothing. Raise `InputError` for a function, whose
    terms cannot be written into a scene.
    """
    problem = reduced.problem
    if "method" not in problem.source.usual_variations:
        remedy = "Write a scene file, or compare the models with compare."
        raise InputError("model = True", "needs a scene: it changes its terms", "tune", remedy)
    base = coarse_problem(problem, bench.settings)
    full = run_problem(bench, base)
    if full["status"] != OK:
        return reduced

    def change_by(variants: Sequence[Any]) -> tuple[float, float]:
        """Return the largest change of a quantity by variants, and the CPU seconds with them."""
        try:
            changed = base
            for variant in variants:
                changed = changed.at(variant.values, variant.name)
        except InputError:
            return math.inf, math.inf
        row = run_problem(bench, changed)
        return distance(bench, full, row), row.get("cpu_seconds", math.inf)

    most = PART_OF_CAUSE * tolerance
    variants = [v for v in simpler_terms(base) if not v.leaves_out_membrane]
    tried = [(change_by([variant]), variant) for variant in variants]
    cheaper = [
        (seconds, i)
        for i, ((change, seconds), _) in enumerate(tried)
        if change <= most and seconds < full["cpu_seconds"]
    ]
    taken: dict[str, Any] = {}  # by the slot: at most one change of each term
    error = 0.0
    for _, i in sorted(cheaper):
        variant = variants[i]
        if variant.slot in taken:
            continue
        change, _ = change_by([*taken.values(), variant])
        if change <= most:
            taken[variant.slot] = variant
            error = change
    for variant in taken.values():
        problem = problem.at(variant.values, variant.name)
    names = tuple(variant.name for variant in taken.values())
    return Reduced(problem, {"model": error}, names)


def narrow_gaps(reduced: Reduced, bench: Bench, tolerance: float) -> Reduced:
    """Divide the gaps of contact until their error is at most a quarter of the tolerance.

    The error is of first order in the gap, so that halving the gaps shows half of it. They are
    divided by `NARROWEST_GAP` at most. If one of the two runs fails, the error is not known and
    counts as infinite.
    """
    base = coarse_problem(reduced.problem, bench.settings)
    rows = [run_problem(bench, base), run_problem(bench, base.finer(gap=2.0))]
    error = math.inf
    divisor = 1.0
    if all(row["status"] == OK for row in rows):
        error = 2 * distance(bench, rows[1], rows[0])
        divisor = min(max(1.0, error / (PART_OF_CAUSE * tolerance)), NARROWEST_GAP)
    errors = {**reduced.errors, "gap": error / divisor}
    changes = reduced.changes
    if divisor > 1:
        changes = (*changes, f"gaps / {divisor:.3g}")
    return Reduced(reduced.problem.finer(gap=divisor), errors, changes)


def run_problem(bench: Bench, problem: StudyProblem) -> dict:
    """Run a problem that is no setting of the bench."""
    how: Runs = replace(bench.runs, quiet=True)
    (row,) = run_quantities([Run(problem, "comparison")], bench.quantities, how)
    return row


def distance(bench: Bench, a: dict, b: dict) -> float:
    """Return the largest relative difference of the quantities of b from those of a.

    It is infinite if a run failed, or has no value of a quantity.
    """
    if a["status"] != OK or b["status"] != OK:
        return math.inf
    try:
        apart = [
            relative_difference(quantity, record_at(a, quantity), record_at(b, quantity))
            for quantity in bench.quantities
        ]
    except InputError:
        return math.inf
    return float(np.nan_to_num(apart, nan=np.inf).max())


# --- the answer --------------------------------------------------------------------------------


def make_tuned(plan: Plan, goal: Goal, reduced: Reduced, search: Search, why: str) -> Tuned:
    """Return the result: the cheapest proved setting, run once more, or the best there is.

    With a budget it is the most accurate setting within it. `why` says why the search ended
    before its end, or is "".
    """
    bench = search.bench
    setting = choose_setting(search, goal)
    row = bench.rows.get(setting, search.limit.finest)
    errors = search.limit.error(row)
    k = int(np.argmax(errors + search.limit.uncertainty))
    parts = {
        "mesh, step and solver": float(errors[k]),
        "limit": float(search.limit.uncertainty[k]),
        **reduced.errors,
    }
    error = sum(parts.values())
    again = bench.run_again(setting)
    seconds = float((row | again)["cpu_seconds"])  # measured again, if it has not failed
    meets = error <= goal.tolerance or goal.has_budget
    in_time = seconds <= goal.budget or row["cpu_seconds"] <= goal.budget
    proved = bool(meets and in_time and again["status"] == OK and math.isfinite(error))
    if bench.settings.coarsest is None:
        proved = False
        why = NO_H
    words = describe_setting(bench, setting)
    rows = make_rows(bench, search.limit)
    for line in rows:
        line["tuned"] = line["seconds"] == row["cpu_seconds"] if line["status"] == OK else False
    problem = bench.settings.problem_of(setting)
    return Tuned(
        title=plan.problem.name,
        verdict=describe_answer(search, goal, words, error, seconds, proved, why),
        table=Table(tuple(rows)),
        error=error if math.isfinite(error) else math.nan,
        seconds=seconds,
        proved=proved,
        tolerance=math.nan if goal.has_budget else goal.tolerance,
        budget=goal.budget if goal.has_budget else math.nan,
        quantities=tuple(quantity.text for quantity in plan.quantities),
        parts=parts if math.isfinite(error) else {},  # without a limit no part is known
        settings=describe_choice(bench, setting, row),
        text=problem.source.file_text,
        search_seconds=bench.spent,
        remarks=tuple(_remarks(reduced, search, why)),
    )


def choose_setting(search: Search, goal: Goal) -> Setting:
    """Return the cheapest setting within the tolerance, or the most accurate one.

    The most accurate one is chosen with a budget, within it, and where no setting meets the
    tolerance; where no error is known, the finest level of the limit.
    """
    if search.cheapest and not goal.has_budget:
        return search.cheapest
    known = [setting for setting in search.bench.rows if math.isfinite(search.bound(setting))]
    within = [setting for setting in known if search.bench.took(setting) <= goal.budget]
    if within or known:
        return min(within or known, key=search.bound)
    return search.limit.settings[-1]


def describe_answer(
    search: Search,
    goal: Goal,
    words: str,
    error: float,
    seconds: float,
    proved: bool,
    why: str,
) -> str:
    """Return the answer: whether it is proved, the setting in `words`, its error and CPU time.

    Without a proof it also says why there is none.
    """
    error_words = in_percent(error) if math.isfinite(error) else "unknown"
    setting = f"{words}: estimated error {error_words}, CPU time {seconds:.2g} s"
    allowed = f"{goal.budget:g} s" if goal.has_budget else in_percent(goal.tolerance)
    if proved:
        return f"proved: {setting} (allowed: {allowed})"
    if not why and goal.has_budget:
        why = f"no setting takes less than {allowed}"
    obstacles = "; ".join(search.limit.finest["obstacles"])
    if obstacles and not search.limit.is_known:
        why = f"{why}: {obstacles}"
    why = why or f"no setting has an error below {allowed}"
    return f"not proved: {why}. What can be had: {setting}"


def describe_choice(bench: Bench, setting: Setting, row: Mapping) -> dict[str, Any]:
    """Return the names and sizes of a setting, by the names of `Tuned.settings`."""
    choice = bench.settings.choice(setting)
    choice = {"element": row["element"], **choice}
    if row["step"] == row["step"]:  # an equilibrium has no step
        choice["dt"] = row["step"]
    return choice


def _remarks(reduced: Reduced, search: Search, why: str) -> list[str]:
    """Return sentences on changed terms, on the time, and on runs that were stopped."""
    lines = []
    if reduced.changes:
        lines.append(f"Changed terms: {', '.join(reduced.changes)}.")
    bench = search.bench
    if why and search.next:
        words = f"{bench.spent:.0f} of {bench.seconds:.0f} CPU s"
        next_setting = describe_setting(bench, search.next)
        lines.append(f"Ended after {words}; the next setting would be {next_setting}.")
    if late := bench.late():
        first = describe_setting(bench, late[0])
        lines.append(f"Stopped, as the time that was left was short: {len(late)}; first {first}.")
    return lines
