"""`simplify`: find what a problem does not need, and write the reduced scene."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

from fecloth.errors import FeclothError, InputError
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import relative_difference, size_of
from fecloth.study.command import StudyFailed
from fecloth.study.levels import RTOL_ORDER
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import Asked, StudyProblem
from fecloth.study.result import Table, in_percent, read_tolerance
from fecloth.study.run_table import row_of_run
from fecloth.study.runs import (
    Row,
    Run,
    Runs,
    announce,
    print_doubts,
    record_at,
    refuse_huge,
    run_quantities,
)
from fecloth.study.sensitivities import describe_weak_terms
from fecloth.study.simplification_result import (
    Simplification,
    Trial,
    describe_trials,
    describe_weak_friction,
)
from fecloth.study.status import NO_VALUE, OK, REFUSED, failure
from fecloth.study.term_variants import Variant, list_variants

SIZES = {"h": ("mesh", "m"), "dt": ("time step", "s"), "rtol": ("tolerance of the steps", "1/s")}
NOISE = 0.05  # differences of seconds below this part of them are noise
PATIENCE = 3.0  # CPU seconds that a variant may take, over those of the problem itself


def simplify(
    problem: Scene | str | Path | Callable | Opened,
    tolerance: float | str = 0.01,
    quantity: Asked | Sequence[Asked] | None = None,
    *,
    folder: str | Path | None = None,
    repeats: int = 3,
    **shared: Any,
) -> Simplification:
    """Find the parts of a scene that change its quantities by less than a tolerance; drop them.

    Half of h and half of dt (or a quarter of rtol) show whether the scene itself is resolved.
    Each term is left out or replaced by a cheaper one, and triangles and steps become larger.
    Changes below the tolerance are combined, the greatest saving per change first, as long as
    the combination stays below the tolerance. The reduced scene is run once more.

    Parameters
    ----------
    problem
        As for `of`. The terms of a function's system, its h and its dt are varied, not its
        method.
    tolerance
        Largest relative change of each quantity, as 0.01 or "1%".
    quantity
        One or more; by default all of [interest], the paths of the probes (in a static scene
        their ends), or the displacement.
    folder
        Where reduced.toml is written, for a function a text; None for nowhere.
    repeats
        Runs of each scene of less than about a second; the fastest counts.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache. Seconds of cases that run
        side by side are less certain.

    Raises
    ------
    InputError
        For a tolerance outside 0 to 100 %, an unknown quantity, a function as quantity, or too
        long a time.
    StudyFailed
        If the scene itself fails.
    """
    largest_change = read_tolerance(tolerance)
    study = open_study(problem, shared)
    how = replace(study.runs(), timed=True, repeats=repeats)
    refuse_huge(study.problem, how)
    quantities = study.problem.choose_quantities(quantity)
    if any(quantity.function for quantity in quantities):
        raise InputError("a function as quantity", "must be a text, as 'max tip.z'")
    opened = study.problem.interested_in(quantities)
    doubts = print_doubts(opened)
    weak_terms = describe_weak_terms(opened, quantities, largest_change, replace(how, timed=False))
    variants = list_variants(opened, quantities)
    announce([Run(opened, ""), *(_run_of(opened, variant) for variant in variants)], how, stages=2)
    original = run_original(opened, quantities, largest_change, how)
    trials = judge(original.run(variants), original)
    result = replace(_reduce(original, trials, weak_terms, folder), doubts=doubts)
    return replace(result, scene=result.write_scene(folder))


@dataclass(frozen=True, eq=False)
class Original:
    """The run of the problem itself, with which variants are compared.

    Attributes
    ----------
    quantities
        The quantities that count.
    tolerance
        The largest relative change of each of them.
    how
        How cases are run.
    row
        The row of its run.
    """

    quantities: tuple[Quantity, ...]
    tolerance: float
    how: Runs
    row: Row

    @property
    def seconds(self) -> float:
        """CPU time of its run [s]."""
        return self.row["cpu_seconds"]

    def run(self, variants: Sequence[Variant], fresh: bool = False) -> list[Trial]:
        """Run variants, and compare each with the problem; `fresh` for runs that are not stored.

        A variant that takes much longer than the problem is cut off, unless it is a check.
        """
        most = round(PATIENCE * self.seconds + 1, 1)  # 1 s against noise
        problem = self.row["problem"]
        runs = [_run_of(problem, v, None if v.is_check else most) for v in variants]
        how = replace(self.how, fresh=fresh or self.how.fresh)
        rows = run_quantities(runs, self.quantities, how)
        return [self.compare(variant, row) for variant, row in zip(variants, rows, strict=True)]

    def compare(self, variant: Variant, row: Row) -> Trial:
        """Return a variant with the changes that it makes; with the cause if its run failed."""
        changes = dict[str, float]()
        if row["status"] == OK:
            try:
                changes = self._changes(row)
            except FeclothError as error:  # for example, a signal has no period
                row = failure(NO_VALUE, error)
        if row["status"] != OK:
            words = f"{row['status']}: {row['cause']}"
            return Trial(variant, changes, row_of_run(row, {}, {}), words)
        saved = 1 - row["cpu_seconds"] / self.seconds
        results = {
            **{f"{text} [%]": 100 * change for text, change in changes.items()},
            "seconds saved": saved * self.seconds,
            "saved [%]": 100 * saved,
        }
        text, change = max(changes.items(), key=itemgetter(1))
        saving = f"{'saves' if saved >= 0 else 'adds'} {in_percent(abs(saved))} of the seconds"
        words = f"changes {text} by {in_percent(change)} and {saving}"
        return Trial(variant, changes, row_of_run(row, {}, results), words)

    def _changes(self, row: Row) -> dict[str, float]:
        """Return the relative change of each quantity, by its text."""
        changes = {}
        for quantity in self.quantities:
            records = record_at(self.row, quantity), record_at(row, quantity)
            changes[quantity.text] = relative_difference(quantity, *records)
        return changes


def run_original(
    problem: StudyProblem, quantities: tuple[Quantity, ...], tolerance: float, how: Runs
) -> Original:
    """Run the problem itself.

    Raise `StudyFailed` if the run fails, and `InputError` if all quantities are zero: then no
    relative change is known.
    """
    (row,) = run_quantities([Run(problem, "the scene")], quantities, how)
    if row["status"] != OK:
        raise StudyFailed(f"{problem.where}: the scene itself fails: {row['cause']}")
    if not any(size_of(quantity, record_at(row, quantity)) for quantity in quantities):
        names = ", ".join(quantity.text for quantity in quantities)
        remedy = "Name another with --quantity or in [interest]."
        raise InputError(f"{names} = 0", "cannot show what changes it", problem.where, remedy)
    return Original(quantities, tolerance, how, row)


def _run_of(problem: StudyProblem, variant: Variant, most: float | None = None) -> Run | Row:
    """Return the run of a variant, of at most so many CPU seconds; a row if it is refused."""
    try:
        changed = problem.at(variant.values, variant.name)
    except InputError as error:
        return failure(REFUSED, error)
    return Run(changed, variant.name, arguments={"most": most} if most else {})


def judge(trials: Sequence[Trial], original: Original) -> list[Trial]:
    """Return the trials with their verdicts, the smallest change first.

    A refinement says whether its size is resolved. Another variant is "needed" if the problem
    needs what it changes: it fails, or changes a quantity by more than the tolerance. A small
    change by a larger size is "by chance" where the problem itself is not resolved, or where a
    smaller factor changes more than the tolerance.
    """
    tolerance = original.tolerance
    checked = [check_size(t, original) if t.variant.is_check else t for t in trials]
    judged = list[Trial]()
    for trial in checked:
        variant = trial.variant
        same_size = [t for t in checked if variant.size and t.variant.kind == variant.kind]
        smaller = [t for t in same_size if t.variant.by < variant.by]
        verdict = "not needed, saves nothing"
        if variant.is_check:
            verdict = trial.verdict
        elif trial.change > tolerance:
            verdict = "needed"
        elif any(t.verdict == "not resolved" or t.change > tolerance for t in smaller):
            verdict = "by chance"
        elif is_worth(variant, trial, original.seconds, tolerance):
            verdict = "not needed"
        judged.append(replace(trial, verdict=verdict))
    return sorted(judged, key=attrgetter("change"))


def check_size(check: Trial, original: Original) -> Trial:
    """Return a trial that refines a size, with the error of the problem by this size in words.

    A refinement by r that changes a quantity by c shows the error c/(1 − r^−p) for the order p
    (Richardson 1911); the size for the tolerance t is the present size times (t/error)^(1/p).
    The quantity that needs the smallest size counts.
    """
    kind, size = check.variant.kind, check.variant.size
    what, unit = SIZES[kind]
    if not check.changes:
        words = f"the error of the {what} is not known: {check.variant.name} {check.words}"
        return replace(check, verdict="not resolved", words=words)
    errors = {}  # in words, by the size that would do
    for quantity in original.quantities:
        order_in_h, order_in_dt = original.row["problem"].orders(quantity)
        order = {"h": order_in_h, "dt": order_in_dt, "rtol": RTOL_ORDER}[kind]
        error = check.changes[quantity.text] / (1 - check.variant.by**order)  # `by` is 1/r
        needed = size * (original.tolerance / error) ** (1 / order) if error else math.inf
        errors[needed] = f"the error of the {what} is about {in_percent(error)} ({quantity.text})"
    needed = min(errors)
    words = errors[needed]
    if needed >= size:
        return replace(check, verdict="resolved", words=words)
    words += f"; {kind} of about {needed:.2g} {unit} in place of {size:g} {unit} would do"
    return replace(check, verdict="not resolved", words=words)


def is_worth(variant: Variant, trial: Trial, seconds: float, tolerance: float) -> bool:
    """Whether a variant may be taken, by a run with it; without it the run takes `seconds`.

    All changes have to be within the tolerance. To leave out a term need not save seconds.
    """
    if trial.change > tolerance:  # as of a failure, which has no seconds
        return False
    return variant.kind == "without" or trial.cells["cpu_seconds"] < (1 - NOISE) * seconds


def join(variants: Sequence[Variant]) -> Variant:
    """Return the variant that has the values of several, one for each slot."""
    values = dict[str, Any]()
    for variant in variants:
        values |= variant.values
    return Variant(" + ".join(variant.name for variant in variants), "", values, kind="joined")


def combine(original: Original, trials: Sequence[Trial]) -> tuple[list[Variant], list[Trial]]:
    """Take one needless variant after the other, as long as all together change little.

    The variants that save most time for their change come first. Each variant runs together with
    all variants that are taken so far, and is taken if this run is worth it, see `is_worth`. It
    takes the place of an earlier variant of its slot, unless the earlier variant left out a term.

    Return the variants that are taken, and the runs of several variants.
    """
    taken = dict[str, Variant]()  # by slot
    seconds = original.seconds
    combinations = list[Trial]()
    needless = [trial for trial in trials if trial.verdict == "not needed"]
    for trial in sorted(needless, key=attrgetter("saving_per_change"), reverse=True):
        variant = trial.variant
        if variant.slot in taken and taken[variant.slot].kind == "without":
            continue
        together = {**taken, variant.slot: variant}
        if len(together) > 1:  # alone it has run already
            (trial,) = original.run([join([*together.values()])])
        is_taken = is_worth(variant, trial, seconds, original.tolerance)
        if len(together) > 1:
            verdict = "combined" if is_taken else "combined, not taken"
            combinations.append(replace(trial, verdict=verdict))
        if is_taken:
            taken = together
            seconds = trial.cells["cpu_seconds"]
    return [*taken.values()], combinations


def _reduce(
    original: Original, trials: Sequence[Trial], weak_terms: str, folder: str | Path | None
) -> Simplification:
    """Combine the needless variants, run the reduced problem once more, and return the result.

    `weak_terms` is a sentence on terms that change little, or ""; the verdict names the file of
    the reduced problem if there is a `folder` for it.
    """
    problem = original.row["problem"]
    taken, rows = combine(original, trials)
    reduced = join(taken)
    file = f"reduced.{problem.source.suffix}"
    change = saved = 0.0
    ending = "nothing simpler was found"
    if taken:
        (final,) = original.run([replace(reduced, name=file)], fresh=True)
        rows.append(replace(final, verdict="reduced scene"))
        change, saved = final.change, final.saved
        where = file if folder else "the reduced scene"
        ending = f"{where}: {reduced.name}; it {final.words}"
    remarks = [
        weak_terms,
        describe_weak_friction(problem.first.system, original.row["ends"]),
        *(f"resolved: {trial.words}" for trial in trials if trial.verdict == "resolved"),
    ]
    if problem.h is None:
        remarks.append("whether the mesh is resolved is not known: the scene has no cloth.h")
    return Simplification(
        title=problem.name,
        verdict="\n".join([*describe_trials(trials, original.tolerance), ending]),
        table=Table(tuple(trial.row for trial in [*trials, *rows])),
        tolerance=original.tolerance,
        quantities=tuple(quantity.text for quantity in original.quantities),
        resolved=all(trial.verdict != "not resolved" for trial in trials),
        reduced=problem.at(reduced.values).source.text(),
        file=file,
        change=change,
        saved=saved,
        remarks=tuple(f"{words[0].upper()}{words[1:]}." for words in remarks if words),
    )
