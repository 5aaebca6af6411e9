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
    first, listed = _open_variants(study.problems, variants)
    opened, refused = split_refused(listed)
    for variant in opened.values():
        run_problems.refuse_huge(variant, runs)
    warned = run_problems.print_warnings(first)
    chosen = first.choose_quantity(quantity)

    def plan(variant: Problem) -> list[Level]:
        variant.check(refine)
        variant.check_quantity(chosen)
        return levels_to_run(variant, chosen, refine, levels, ratio)

    planned = make_or_refuse(plan, opened.values())
    plans, refused_plans = split_refused(dict(zip(opened, planned, strict=True)))
    refused |= refused_plans
    if len(plans) < 2:
        causes = "; ".join(row["cause"] for row in refused.values())
        raise InputError(f"{len(plans)} variant", "must be at least 2", "compare", causes)
    rows = _run(opened, plans, chosen, runs)
    judged = {name: _judge(rows[name], chosen, refine, levels) for name in plans}
    studied = {name: (judged | refused)[name] for name in listed}
    return replace(_conclude(opened, studied, chosen, refine), doubts=warned)


def _open_variants(
    problems: Sequence[Problem], variants: Over | None
) -> tuple[Problem, dict[str, Any]]:
    """Return the problem that all share, and the variants by name.

    A variant that is refused has the row with the cause in its place.
    """
    several = len(problems) > 1
    if several == (variants is not None):
        allowed = "takes several problems, or one with variants"
        remedy = "Give variants, as in terms.0.type=StVK,Springs."
        raise InputError("compare", allowed, "", remedy)
    if several:
        return problems[0], _name_variants([problem.name for problem in problems], problems)
    ranges = read_ranges(variants or ())
    combinations = combine(ranges)
    first = with_first_values(problems[0], ranges)
    opened = make_or_refuse(partial(vary, first), combinations)
    return first, _name_variants([name_variant(values) for values in combinations], opened)


def _name_variants(names: Sequence[str], variants: Sequence[Any]) -> dict[str, Any]:
    """Return the variants by name; a name that occurs again gets a number."""
    pairs = list(zip(names, variants, strict=True))
    if len(pairs) < 2:
        raise InputError(f"{len(pairs)} variant", "must be at least 2", "compare")
    if len({type(variant) for _, variant in pairs} - {dict}) > 1:
        raise InputError("scenes beside functions", "must be of one kind", "compare")
    named: dict[str, Any] = {}
    for name, variant in pairs:
        named[name if name not in named else f"{name} ({len(named) + 1})"] = variant
    return named


def _run(
    opened: Mapping, plans: Mapping, quantity: Quantity, runs: run_problems.Runs
) -> dict[str, list[dict]]:
    """Return the rows of all levels by the name of the variant."""
    points = [
        run_problems.Point(opened[name], level, f"{name}, {level}", opened[name].workload(level))
        for name, levels in plans.items()
        for level in levels
    ]
    run_problems.check_points(points, runs)
    rows = iter(run_problems.run_points(points, [quantity], runs))
    return {name: [next(rows) for _ in levels] for name, levels in plans.items()}


def _judge(
    rows: Sequence[dict], quantity: Quantity, refine: str, levels: int
) -> Convergence | dict:
    """Return the result of the levels of one variant; if it failed, the cells of its row."""
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
    """Return the comparison of the variants that ran with the first of them."""
    studies = {name: study for name, study in studied.items() if isinstance(study, Convergence)}
    scale = math.nan
    numbers = True
    differences = {}
    if studies:
        first, *others = studies.values()
        scale = find_scale(first)
        numbers = is_number(quantity, run_problems.record_at(first.levels[0], quantity))
        for name, other in zip(list(studies)[1:], others, strict=True):
            differences[name] = _difference(first, other, quantity, scale, numbers)
    overlay, remarks = _make_overlay(list(studies.values())[:2], quantity)
    names = {variant.name for variant in opened.values()}
    comparison = Comparison(
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
    lines = [describe_difference(comparison, name, numbers) for name in differences]
    rows = []
    for name, variant in studied.items():
        rows.append({"variant": name, **_cells(comparison, name, variant)})
    verdict = "\n".join(lines) or "nothing to compare: less than two variants have a value"
    return replace(comparison, verdict=verdict, table=Table(tuple(rows)))


def _difference(
    a: Convergence, b: Convergence, quantity: Quantity, scale: float, numbers: bool
) -> Difference:
    """Return the difference b − a, in per cent d = 100 (b/a − 1) of the scale, if there is one.

    Fields, paths and vectors have no limit: their difference is the one on the finest level. The
    uncertainties of both variants are added, U_d = 100 (U_b + |b/a| U_a)/|a|: errors of two
    models on one mesh are not independent. But most of their errors is the same: the difference
    of each pair of levels converges by itself, and its own uncertainty counts if it is smaller.
    """
    differences = [
        _subtract(quantity, scale, first, second)
        for first, second in zip(a.levels, b.levels, strict=True)
    ]
    limit = differences[-1]
    growth = 1.0
    if numbers and math.isnan(scale):
        limit = best_value(b) - best_value(a)
    elif numbers:
        growth = abs(best_value(b) / best_value(a))
        limit = 100 * (best_value(b) / best_value(a) - 1)
    factor = 1.0 if math.isnan(scale) else 100 / abs(scale)
    summed = Difference(
        as_given=differences[0],
        limit=limit,
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
    """Return the difference as its values on the levels converge; None where they diverge."""
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
    """Return the difference of two runs, in % of the scale or in the unit of the quantity."""
    a = run_problems.record_at(row, quantity)
    b = run_problems.record_at(other, quantity)
    if not is_number(quantity, a):
        return difference_of(quantity, a, b) * (1.0 if math.isnan(scale) else 100 / abs(scale))
    first = value_of(quantity, a)
    second = value_of(quantity, b)
    if math.isnan(scale):
        return second - first
    return 100 * (second / first - 1)


def _cells(comparison: Comparison, name: str, variant: Convergence | dict) -> dict:
    """Return the cells of a row after its name: the variant as given, and its limit."""
    if isinstance(variant, dict):
        return variant
    given = variant.table[0]
    unit = comparison.unit if math.isnan(comparison.scale) else "%"
    difference = comparison.differences.get(name)
    bracket = f" [{unit}]" if unit else ""
    return {
        "status": OK,
        "value": given["value"],
        "error": given["error"],
        "limit": best_value(variant),
        "uncertainty": variant.uncertainty,
        f"difference as given{bracket}": difference.as_given if difference else None,
        f"difference of limits{bracket}": difference.limit if difference else None,
        f"±{bracket}": difference.uncertainty if difference else None,
        "order": variant.order,
        "triangles": given["triangles"],
        "cpu_seconds": given["cpu_seconds"],
    }


def _make_overlay(
    studies: Sequence[Convergence], quantity: Quantity
) -> tuple[Overlay | None, tuple]:
    """Return the ends of two variants as given, or none and a remark that says why."""
    if len(studies) < 2 or quantity.how == "mode":
        return None, ()
    first, second = (run_problems.end_of(study.levels[0]) for study in studies)
    try:
        return Overlay.of(first, second), ()
    except MeshError as error:  # as where a node is on one cloth only
        return None, (f"There is no overlay: {error}",)
