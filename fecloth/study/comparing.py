"""`compare`: variants of a problem, or several problems, beside the error of each."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError, MeshError
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import difference_of, value_of
from fecloth.study import run_problems
from fecloth.study.change import Level
from fecloth.study.comparison import (
    Comparison,
    Difference,
    best_value,
    describe_difference,
    find_scale,
)
from fecloth.study.convergence import Convergence
from fecloth.study.opened import Opened, open_study
from fecloth.study.overlay import Overlay
from fecloth.study.problems import Problem
from fecloth.study.refinement import is_number, levels_to_run, other_shares, summarise
from fecloth.study.result import Table
from fecloth.study.status import NO_VALUE, OK, failure
from fecloth.study.uncertainty import UNSAFE, estimate_uncertainty
from fecloth.study.variants import (
    Over,
    combine,
    make_or_refuse,
    name_variant,
    read_ranges,
    split_refused,
    vary,
    with_first_values,
)


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
    runs = study.runs()
    shared_problem, variants_by_name = _open_variants(study.problems, variants)
    opened, refused = split_refused(variants_by_name)
    for variant in opened.values():
        run_problems.refuse_huge(variant, runs)
    doubts = run_problems.print_warnings(shared_problem)
    chosen_quantity = shared_problem.choose_quantity(quantity)

    def plan_levels(variant: Problem) -> list[Level]:
        """Return the levels; raise `InputError` if the variant lacks an h or the quantity."""
        variant.check(refine)
        variant.check_quantity(chosen_quantity)
        return levels_to_run(variant, chosen_quantity, refine, levels, ratio)

    planned_levels = make_or_refuse(plan_levels, opened.values())
    levels_of, refused_levels = split_refused(dict(zip(opened, planned_levels, strict=True)))
    refused |= refused_levels
    if len(levels_of) < 2:
        causes = "; ".join(row["cause"] for row in refused.values())
        raise InputError(f"{len(levels_of)} variant", "must be at least 2", "compare", causes)
    rows = _run(opened, levels_of, chosen_quantity, runs)
    results: dict[str, Convergence | dict] = dict(refused)
    for name in levels_of:
        results[name] = _judge(rows[name], chosen_quantity, refine, levels)
    # in the order of the variants, so that refused ones are not at the begin of the table
    results = {name: results[name] for name in variants_by_name}
    return replace(_conclude(opened, results, chosen_quantity, refine), doubts=doubts)


def _open_variants(
    problems: Sequence[Problem], variants: Over | None
) -> tuple[Problem, dict[str, Any]]:
    """Return the problem whose quantities and warnings count for all, and the variants by name.

    The problem is the first of several, or the one of which the variants are made. A variant
    that is refused has a row with the cause in its place. Raise `InputError` for several
    problems with `variants`, or a single one without, and for less than two variants.
    """
    several = len(problems) > 1
    if several == (variants is not None):  # both are given, or neither
        allowed = "takes several problems, or one with variants"
        remedy = "Give variants, as in terms.0.type=StVK,Springs."
        raise InputError("compare", allowed, "", remedy)
    if several:
        return problems[0], _name_variants([problem.name for problem in problems], problems)
    ranges = read_ranges(variants or ())
    combinations = combine(ranges)
    varied_problem = with_first_values(problems[0], ranges)
    opened = make_or_refuse(partial(vary, varied_problem), combinations)
    names = [name_variant(values) for values in combinations]
    return varied_problem, _name_variants(names, opened)


def _name_variants(names: Sequence[str], variants: Sequence[Any]) -> dict[str, Any]:
    """Return the variants by name; a name that occurs again gets a number.

    Raise `InputError` for less than two variants, and for scenes beside functions.
    """
    pairs = list(zip(names, variants, strict=True))
    if len(pairs) < 2:
        raise InputError(f"{len(pairs)} variant", "must be at least 2", "compare")
    # a variant of type dict is a row of what was refused: neither scene nor function
    if len({type(variant) for _, variant in pairs} - {dict}) > 1:
        raise InputError("scenes beside functions", "must be of one kind", "compare")
    named: dict[str, Any] = {}
    for name, variant in pairs:
        own_name = name
        if name in named:
            own_name = f"{name} ({len(named) + 1})"
        named[own_name] = variant
    return named


def _run(
    opened: Mapping, levels_of: Mapping, quantity: Quantity, runs: run_problems.Runs
) -> dict[str, list[dict]]:
    """Run all levels of all variants; return the rows by the name of the variant.

    `opened` are the variants by name, `levels_of` the levels of each that runs. All runs are in
    one list, so that they run side by side.
    """
    points = [
        run_problems.Point(
            opened[name], level, words=f"{name}, {level}", size=opened[name].workload(level)
        )
        for name, levels in levels_of.items()
        for level in levels
    ]
    run_problems.check_points(points, runs)
    rows = iter(run_problems.run_points(points, [quantity], runs))
    return {name: [next(rows) for _ in levels] for name, levels in levels_of.items()}


def _judge(
    rows: Sequence[dict], quantity: Quantity, refine: str, levels: int
) -> Convergence | dict:
    """Return the convergence of one variant; if it failed, the cells of its row with the cause.

    `rows` are first the rows of the `levels` refined levels, then those that show other errors.
    A failure of the latter is no failure of the variant.
    """
    problem = rows[0]["point"].problem
    failed = next((row for row in rows[:levels] if row["status"] != OK), None)
    if failed:
        return failure(failed["status"], failed["cause"])
    try:
        return summarise(problem, quantity, refine, rows[:levels], rows[levels:])
    except InputError as error:  # as where a signal has no period
        return failure(NO_VALUE, error)


def _conclude(
    opened: Mapping, studied: Mapping[str, Convergence | dict], quantity: Quantity, refine: str
) -> Comparison:
    """Return the comparison of the variants that ran with the first of them.

    `opened` are the variants by name. `studied` has the convergence of each, or the cells of its
    row if it was refused or failed.
    """
    studies = {name: study for name, study in studied.items() if isinstance(study, Convergence)}
    scale = math.nan
    are_numbers = True
    differences = {}
    if studies:
        first_study, *other_studies = studies.values()
        scale = find_scale(first_study)
        record = run_problems.record_at(first_study.levels[0], quantity)
        are_numbers = is_number(quantity, record)
        for name, other_study in zip(list(studies)[1:], other_studies, strict=True):
            difference = _difference(first_study, other_study, quantity, scale, are_numbers)
            differences[name] = difference
    overlay, remarks = _make_overlay(list(studies.values())[:2], quantity)
    names = {variant.name for variant in opened.values()}
    comparison = Comparison(  # without verdict and table, which are made from it below
        title=", ".join(sorted(names)),
        verdict="",
        table=Table(()),
        quantity=quantity.text,
        unit=next((study.unit for study in studies.values()), ""),
        refine=refine,
        studies=studies,
        differences=differences,
        scale=scale,
        overlay=overlay,
        remarks=remarks,
    )
    lines = [describe_difference(comparison, name, are_numbers) for name in differences]
    rows = []
    for name, variant in studied.items():
        rows.append({"variant": name, **_cells(comparison, name, variant)})
    verdict = "\n".join(lines) or "nothing to compare: less than two variants have a value"
    return replace(comparison, verdict=verdict, table=Table(tuple(rows)))


def _difference(
    a: Convergence, b: Convergence, quantity: Quantity, scale: float, are_numbers: bool
) -> Difference:
    """Return the difference of the variant b from the first variant a.

    It is in per cent, d = 100 (b/a − 1), or, if the scale is NaN, b − a in the unit of the
    quantity. Fields, paths and vectors have no limit: their difference is the one on the finest
    level.

    There are two estimates of its uncertainty, of which the smaller counts. The first is the
    sum of the uncertainties of both variants, U_d = 100 (U_b + |b/a| U_a)/|a|, because errors
    of two models on one mesh are not independent. The second takes the difference on each level
    as a value that converges by itself: most of the errors of both variants is the same, and
    drops out. It needs the same levels in both variants.

    Parameters
    ----------
    a, b
        The first variant, and the variant that is compared with it.
    scale
        The value that is 100 %, see `find_scale`.
    are_numbers
        Whether the quantity is a number, not a field, a path or a vector.
    """
    differences = [
        _subtract(quantity, scale, first, second)
        for first, second in zip(a.levels, b.levels, strict=True)
    ]
    difference_of_limits = differences[-1]
    growth = 1.0
    if are_numbers and math.isnan(scale):
        difference_of_limits = best_value(b) - best_value(a)
    elif are_numbers:
        growth = abs(best_value(b) / best_value(a))
        difference_of_limits = 100 * (best_value(b) / best_value(a) - 1)
    factor = 1.0 if math.isnan(scale) else 100 / abs(scale)
    summed = Difference(
        as_given=differences[0],
        limit=difference_of_limits,
        uncertainty=factor * (b.uncertainty + growth * a.uncertainty),
    )
    if not _have_same_levels(a, b):
        return summed
    refined = _refine_difference(a, b, quantity, scale, differences)
    if refined is None or refined.uncertainty >= summed.uncertainty:
        return summed
    return refined


def _have_same_levels(a: Convergence, b: Convergence) -> bool:
    """Whether both have all runs, on levels in the same ratios."""
    finished = all(row["status"] == OK for row in (*a.others, *b.others))
    if not finished or len(a.others) != len(b.others):
        return False
    sizes = _sizes_of_levels(a)
    other_sizes = _sizes_of_levels(b)
    return np.allclose(sizes / sizes[0], other_sizes / other_sizes[0], rtol=0.01)


def _sizes_of_levels(study: Convergence) -> np.ndarray:
    """Return dt of each level [s], or h [m]."""
    return np.array(study.table["dt" if study.refine == "dt" else "h"], dtype=float)


def _refine_difference(
    a: Convergence,
    b: Convergence,
    quantity: Quantity,
    scale: float,
    differences: Sequence[float],
) -> Difference | None:
    """Return the limit of the differences on the levels, and its uncertainty.

    The shares of what was not refined are added to the uncertainty: how much the difference
    changes in the runs with, for instance, a smaller step. Return None if the differences
    diverge.

    Parameters
    ----------
    a, b
        The first variant, and the variant that is compared with it, on the same levels.
    differences
        The difference on each level, coarse to fine, in % of the scale or in the unit.
    """
    estimate = estimate_uncertainty(_sizes_of_levels(a).tolist(), differences, a.theory)
    if estimate.behaviour == "diverging":
        return None
    changes = [
        abs(_subtract(quantity, scale, first, second) - differences[0])
        for first, second in zip(a.others, b.others, strict=True)
    ]
    orders = a.levels[0]["point"].problem.orders(quantity)
    shares = other_shares(a.refine, orders, a.levels[0], a.others, changes)
    uncertainty = estimate.uncertainty + sum(UNSAFE * share for share in shares.values())
    return Difference(differences[0], estimate.limit, uncertainty)


def _subtract(quantity: Quantity, scale: float, row: Mapping, other: Mapping) -> float:
    """Return the difference of the run `other` from the run `row`, by their rows.

    It is in % or, if the scale is NaN, in the unit of the quantity. Of a number it has a sign,
    and 100 % is the value of `row` on its level. Of a field, path or vector it is a size, and
    100 % is the scale.
    """
    record = run_problems.record_at(row, quantity)
    other_record = run_problems.record_at(other, quantity)
    if not is_number(quantity, record):
        size = difference_of(quantity, record, other_record)
        return size * (1.0 if math.isnan(scale) else 100 / abs(scale))
    value = value_of(quantity, record)
    other_value = value_of(quantity, other_record)
    if math.isnan(scale):
        return other_value - value
    return 100 * (other_value / value - 1)


def _cells(comparison: Comparison, name: str, variant: Convergence | dict) -> dict:
    """Return the cells of a variant in the table, without its name.

    They are the value and error on the first level, which has the given mesh and step; the
    limit; and the difference from the first variant, None in the row of the first one.
    """
    if isinstance(variant, dict):  # it was refused or failed: these are its cells
        return variant
    first_level = variant.table[0]
    unit = comparison.unit if math.isnan(comparison.scale) else "%"
    difference = comparison.differences.get(name)
    bracket = f" [{unit}]" if unit else ""
    return {
        "status": OK,
        "value": first_level["value"],
        "error": first_level["error"],
        "limit": best_value(variant),
        "uncertainty": variant.uncertainty,
        f"difference as given{bracket}": difference.as_given if difference else None,
        f"difference of limits{bracket}": difference.limit if difference else None,
        f"±{bracket}": difference.uncertainty if difference else None,
        "order": variant.order,
        "triangles": first_level["triangles"],
        "cpu_seconds": first_level["cpu_seconds"],
    }


def _make_overlay(
    studies: Sequence[Convergence], quantity: Quantity
) -> tuple[Overlay | None, tuple]:
    """Return the ends of two variants as given on one mesh, and remarks.

    Return None in place of them for less than two variants, for natural frequencies, and if a
    node of the first is not on the cloth of the second; then a remark says so.
    """
    if len(studies) < 2 or quantity.how == "mode":
        return None, ()
    first, second = (run_problems.end_of(study.levels[0]) for study in studies)
    try:
        return Overlay.of(first, second), ()
    except MeshError as error:  # as where a node is on one cloth only
        return None, (f"There is no overlay: {error}",)
