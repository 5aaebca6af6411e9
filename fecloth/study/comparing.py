"""`compare`: variants of a problem, or several problems, beside the error of each."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError, MeshError
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import difference_of, value_of
from fecloth.study.comparison import (
    Comparison,
    Difference,
    describe_difference,
    find_scale,
)
from fecloth.study.convergence import Convergence, best_value, has_no_limit
from fecloth.study.levels import check_levels, levels_to_run, other_shares
from fecloth.study.opened import Opened, open_study
from fecloth.study.overlay import Overlay
from fecloth.study.problem import StudyProblem
from fecloth.study.refinement import Limit, summarise
from fecloth.study.result import Table
from fecloth.study.run_table import row_of_run
from fecloth.study.runs import Run, end_of, print_doubts, record_at, refuse_huge
from fecloth.study.states import run_other_starts
from fecloth.study.status import NO_VALUE, OK, failure
from fecloth.study.variants import Over, combine, name_variant, plan, read_ranges, run_planned


def compare(
    problem: Scene | str | Path | Callable | Opened | Sequence[Scene | str | Path | Callable],
    variants: Over | None = None,
    quantity: str | Callable[[Any], float] | Quantity | None = None,
    refine: str = "h",
    levels: int = 3,
    *,
    ratio: float | None = None,
    **shared: Any,
) -> Comparison:
    """Refine each variant of a problem, and compare them as given and in their limits.

    A difference between two models on one mesh contains the errors of both. Here each variant is
    refined as by `converge`. The difference is refined, too: most of the error of two variants
    is the same, so that the difference is less uncertain than the sum of both uncertainties. Its
    uncertainty contains what was not refined: with "h" the error of the time step, with "dt" the
    error of the mesh. "both" leaves less.

    A variant that fails or is refused has a row with its cause. Before any run `InputError` is
    raised for less than two variants that are not refused, or for too long a time.

    Parameters
    ----------
    problem
        As for `of`: without `variants` a list of several.
    variants
        Values of one or more keys, as for `sweep`: "terms.0.type=StVK,Springs", or a mapping of
        keys to values, where a value may be a table, {"type": "Springs", "kind": "van_gelder"}.
        The others are compared with the first.
    quantity
        As for `converge`; a field, path or vector gives the size of the difference.
    refine, levels, ratio
        As for `converge`.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
    """
    study = open_study(problem, shared)
    how = study.runs()
    check_levels(refine, levels, ratio)
    choices = _name_choices(study.problems, variants)
    first_problem, _ = next(iter(choices.values()))
    for shared_problem, _ in choices.values():
        refuse_huge(shared_problem, how)
    doubts = print_doubts(first_problem)
    chosen_quantity = first_problem.choose_quantity(quantity)

    def make(name: str) -> list[Run]:
        """Return the runs; raise `InputError` if the variant lacks an h or the quantity."""
        shared_problem, values = choices[name]
        variant = shared_problem.at(values)
        variant.check_quantity(chosen_quantity)
        runs = levels_to_run(variant, chosen_quantity, refine, levels, ratio)
        return [replace(run, words=f"{name}, {run.words}") for run in runs]

    planned = plan(make, list(choices))
    refusals = [runs[0]["cause"] for runs in planned if isinstance(runs[0], dict)]
    if len(planned) - len(refusals) < 2:
        what = f"{len(planned) - len(refusals)} variant"
        raise InputError(what, "must be at least 2", "compare", "; ".join(refusals))
    rows_of_variants = run_planned(planned, [chosen_quantity], how)
    studies: dict[str, Convergence | dict] = {}
    for name, rows in zip(choices, rows_of_variants, strict=True):
        studies[name] = rows[0]
        if "problem" in rows[0]:
            variant = rows[0]["problem"]
            parts = rows[:levels], rows[levels:]
            starts = run_other_starts(rows[:levels], [chosen_quantity], how)
            studies[name] = summarise(variant, chosen_quantity, refine, *parts, starts)
    return replace(_conclude(studies, chosen_quantity, refine), doubts=doubts)


def _name_choices(
    problems: Sequence[StudyProblem], variants: Over | None
) -> dict[str, tuple[StudyProblem, dict]]:
    """Return what is compared: a problem and values of it, by the name of the variant.

    A name that occurs again gets a number. Raise `InputError` for several problems with
    `variants`, or a single one without, and for less than two variants.
    """
    if (len(problems) > 1) == (variants is not None):  # both are given, or neither
        allowed = "takes several problems, or one with variants"
        remedy = "Give variants, as in terms.0.type=StVK,Springs."
        raise InputError("compare", allowed, "", remedy)
    combinations = combine(read_ranges(variants)) if variants is not None else [{}]
    opened = [problem.completed(combinations[0]) for problem in problems]
    named: dict[str, tuple[StudyProblem, dict]] = {}
    for problem in opened:
        for values in combinations:
            name = name_variant(values) or problem.name
            if name in named:
                name = f"{name} ({len(named) + 1})"
            named[name] = problem, values
    if len(named) < 2:
        raise InputError(f"{len(named)} variant", "must be at least 2", "compare")
    return named


def _conclude(
    studied: Mapping[str, Convergence | dict], quantity: Quantity, refine: str
) -> Comparison:
    """Return the comparison of the variants that have a value with the first of them.

    `studied` has the convergence of each variant, or its row if it was refused.
    """
    by_name = {name: study for name, study in studied.items() if isinstance(study, Convergence)}
    studies = {name: study for name, study in by_name.items() if study.estimate}
    first = next(iter(studies.values()), None)
    differences = {
        name: _subtract(first, study, quantity)
        for name, study in studies.items()
        if first and study is not first
    }
    overlay, remarks = _make_overlay(list(studies.values())[:2], quantity)
    comparison = Comparison(  # without verdict and table, which are made from it below
        title=", ".join(sorted({study.title for study in by_name.values()})),
        verdict="",
        table=Table(()),
        quantity=quantity.text,
        unit=first.unit if first else "",
        refine=refine,
        studies=studies,
        differences=differences,
        scale=find_scale(first) if first else math.nan,
        overlay=overlay,
        remarks=remarks,
    )
    lines = [describe_difference(comparison, name) for name in differences]
    rows = [{"variant": name, **_cells(comparison, name, s)} for name, s in studied.items()]
    verdict = "\n".join(lines) or "nothing to compare: less than two variants have a value"
    return replace(comparison, verdict=verdict, table=Table(tuple(rows)))


def _subtract(a: Convergence, b: Convergence, quantity: Quantity) -> Difference:
    """Return the difference d = b − a of the variant b from the first variant a.

    It is in % of a, or, if a is zero within its uncertainty, in the unit of the quantity. Fields,
    paths and vectors have no limit: their difference is the size of the one on the finest level.

    There are two estimates of its uncertainty, of which the smaller counts. The first is the
    sum U_a + U_b, because errors of two models on one mesh are not independent. The second takes
    the difference on each level as a value that converges by itself: most of the errors of both
    variants is the same, and drops out. It needs the same levels, and one state, in both
    variants. In % the uncertainty of a itself adds |d| U_a/|a|.
    """
    is_number = math.isfinite(a.limit)

    def subtract(row: Mapping, other: Mapping) -> float:
        record, other_record = (record_at(each, quantity) for each in (row, other))
        if is_number:
            return value_of(quantity, other_record) - value_of(quantity, record)
        return difference_of(quantity, record, other_record)

    differences = [subtract(*pair) for pair in zip(a.levels, b.levels, strict=True)]
    limit = best_value(b) - best_value(a) if is_number else differences[-1]
    uncertainty = a.uncertainty + b.uncertainty
    if _have_same_levels(a, b) and a.is_one_state and b.is_one_state:
        pairs = zip(a.others, b.others, strict=True)
        changes = [abs(subtract(*pair) - differences[0]) for pair in pairs]
        space_order, _ = a.levels[0]["problem"].orders(quantity)
        others = other_shares(a.levels[0], a.others, changes, space_order)
        refined = Limit.of(a.table[a.size_name], differences, a.theory, a.refine, others)
        if not has_no_limit(refined.estimate) and refined.uncertainty < uncertainty:
            limit, uncertainty = refined.estimate.limit, refined.uncertainty
    scale = find_scale(a)
    if math.isnan(scale):
        return Difference(differences[0], limit, uncertainty)
    uncertainty += abs(limit / scale) * a.uncertainty
    factor = 100 / (scale if is_number else abs(scale))
    return Difference(factor * differences[0], factor * limit, abs(factor) * uncertainty)


def _have_same_levels(a: Convergence, b: Convergence) -> bool:
    """Whether both have all runs, on levels in the same ratios."""
    finished = all(row["status"] == OK for row in (*a.others, *b.others))
    sizes, other_sizes = (np.array(s.table[s.size_name]) for s in (a, b))
    are_similar = np.allclose(sizes / sizes[0], other_sizes / other_sizes[0], rtol=0.01)
    return finished and len(a.others) == len(b.others) and are_similar


def _cells(comparison: Comparison, name: str, study: Convergence | dict) -> dict:
    """Return the cells of a variant in the table, without its name.

    They are the value and error on the first level, which has the given mesh and step; the
    limit; and the difference from the first variant, None in the row of the first one.
    """
    if isinstance(study, dict):  # it was refused: these are its cells
        return study
    if not study.estimate:
        failed = (row for row in study.table if row["status"] != OK)
        row = next(failed, failure(NO_VALUE, study.verdict))
        return failure(str(row["status"]), row["cause"])
    bracket = f" [{comparison.unit_of_differences}]".replace(" []", "")
    difference = comparison.differences.get(name)
    results = {
        "value": study.table[0]["value"],
        "error": study.table[0]["error"],
        "limit": best_value(study),
        "uncertainty": study.uncertainty,
        f"difference as given{bracket}": difference and difference.as_given,
        f"difference of limits{bracket}": difference and difference.limit,
        f"±{bracket}": difference and difference.uncertainty,
        "order": study.order,
    }
    return row_of_run(study.levels[0], {}, results)


def _make_overlay(
    studies: Sequence[Convergence], quantity: Quantity
) -> tuple[Overlay | None, tuple]:
    """Return the ends of two variants as given on one mesh, and remarks.

    Return None in place of them for less than two variants, for natural frequencies, and if a
    node of the first is not on the cloth of the second; then a remark says so.
    """
    if len(studies) < 2 or quantity.how == "mode":
        return None, ()
    first, second = (end_of(study.levels[0]) for study in studies)
    try:
        return Overlay.of(first, second), ()
    except MeshError as error:  # as where a node is on one cloth only
        return None, (f"There is no overlay: {error}",)
