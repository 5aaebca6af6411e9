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
    refined as by `converge`, and so is the difference, whose uncertainty is less than the
    uncertainties of both, added: most of their errors is the same. It contains what was not
    refined, too: with "h" the error of the time step, with "dt" the error of the mesh; "both"
    leaves less. A variant that fails or is refused has a row with its cause. Raises `InputError`
    for less than two variants that are not refused, or too long a time: before any run.

    Parameters
    ----------
    problem
        As for `of`: without `variants` a list of several.
    variants
        Values of one or more keys, as for `sweep`: "terms.0.type=StVK,Springs", or a mapping of
        keys to values, where a value may be a table, {"type": "Springs", "kind": "van_gelder"}.
        The first is the one that the others are compared with.
    quantity
        As for `converge`; of a field, path or vector the size of the difference is given.
    refine, levels, ratio
        As for `converge`.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
    """
    study = open_study(problem, shared)
    (first, listed), runs = _open(study.problems, variants), study.runs()
    opened, refused = split_refused(listed)
    for variant in opened.values():
        run_problems.refuse_huge(variant, runs)
    warned = run_problems.print_warnings(first)
    chosen = first.choose_quantity(quantity)

    def plan(variant: Problem) -> list[Level]:
        variant.check(refine)
        variant.check_quantity(chosen)
        return levels_to_run(variant, chosen, refine, levels, ratio)

    made = make_or_refuse(plan, opened.values())
    plans, more = split_refused(dict(zip(opened, made, strict=True)))
    refused |= more
    if len(plans) < 2:
        causes = "; ".join(row["cause"] for row in refused.values())
        raise InputError(f"{len(plans)} variant", "must be at least 2", "compare", causes)
    rows = _run(opened, plans, chosen, runs)
    judged = {name: _judge(rows[name], chosen, refine, levels) for name in plans}
    studied = {name: (judged | refused)[name] for name in listed}
    return replace(_conclude(opened, studied, chosen, refine), doubts=warned)


def _open(problems: Sequence[Problem], variants: Over | None) -> tuple[Problem, dict[str, Any]]:
    """Return a problem that stands for all, and the variants by name, a row where it is refused."""
    several = len(problems) > 1
    if several == (variants is not None):
        allowed = "takes several problems, or one with variants"
        remedy = "Give variants, as in terms.0.type=StVK,Springs."
        raise InputError("compare", allowed, "", remedy)
    if several:
        return problems[0], _named([(each.name, each) for each in problems])
    ranges = read_ranges(variants or ())
    combinations = combine(ranges)
    first = with_first_values(problems[0], ranges)
    made = make_or_refuse(partial(vary, first), combinations)
    return first, _named(list(zip(map(name_variant, combinations), made, strict=True)))


def _named(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
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
    """Return what the levels of one variant say; of one that failed, the cells of its row."""
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
    studies = {name: study for name, study in studied.items() if isinstance(study, Convergence)}
    first, *others = studies.values() or (None,)
    scale = math.nan
    numbers = True
    if first:
        scale = find_scale(first)
        numbers = is_number(quantity, run_problems.record_at(first.levels[0], quantity))
    pairs = zip(list(studies)[1:], others, strict=True)
    given = quantity, scale, numbers
    differences = {name: _difference(first, other, *given) for name, other in pairs if first}
    overlay, remarks = _overlay(list(studies.values())[:2], quantity)
    names = {variant.name for variant in opened.values()}
    comparison = Comparison(
        title=", ".join(sorted(names)),
        verdict="",
        table=Table(()),
        quantity=quantity.text,
        unit=next((variant.unit for variant in studies.values()), ""),
        refine=refine,
        studies=studies,
        differences=differences,
        scale=scale,
        overlay=overlay,
        remarks=remarks,
    )
    lines = [describe_difference(comparison, name, numbers) for name in differences]
    rows = [
        {"variant": name, **_cells(comparison, name, variant)} for name, variant in studied.items()
    ]
    verdict = "\n".join(lines) or "nothing to compare: less than two variants have a value"
    return replace(comparison, verdict=verdict, table=Table(tuple(rows)))


def _difference(
    a: Convergence, b: Convergence, quantity: Quantity, scale: float, numbers: bool
) -> Difference:
    """Return the difference b − a, in per cent d = 100 (b/a − 1) of the scale, if there is one.

    Fields, paths and vectors have no limit: of them it is the size on the finest level. The
    uncertainties of both variants are added, U_d = 100 (U_b + |b/a| U_a)/|a|: errors of two
    models on one mesh are not independent. But most of their errors is the same: the difference
    of each pair of levels converges by itself, and its own uncertainty counts if it is smaller.
    """
    values = [_apart(quantity, scale, *pair) for pair in zip(a.levels, b.levels, strict=True)]
    by = 1.0 if math.isnan(scale) else 100 / abs(scale)
    grown = 1.0
    limit = values[-1]
    if numbers:
        first = best_value(a)
        other = best_value(b)
        grown = 1.0 if math.isnan(scale) else abs(other / first)
        if math.isnan(scale):
            limit = other - first
        else:
            limit = 100 * (other / first - 1)
    spread = by * (b.uncertainty + grown * a.uncertainty)
    both = Difference(values[0], limit, spread)
    column = "dt" if a.refine == "dt" else "h"
    sizes, others = (np.array(each.table[column], dtype=float) for each in (a, b))
    is_whole = len(a.others) == len(b.others) and all(
        r["status"] == OK for r in (*a.others, *b.others)
    )
    if not is_whole or not np.allclose(sizes / sizes[0], others / others[0], rtol=0.01):
        return both
    more = zip(a.others, b.others, strict=True)
    change = [abs(_apart(quantity, scale, *pair) - values[0]) for pair in more]
    estimate = estimate_uncertainty(sizes.tolist(), values, a.theory)
    orders = a.levels[0]["point"].problem.orders(quantity)
    shares = other_shares(a.refine, orders, a.levels[0], a.others, change)
    uncertainty = estimate.uncertainty + sum(UNSAFE * share for share in shares.values())
    if estimate.behaviour == "diverging" or uncertainty >= both.uncertainty:
        return both
    return replace(both, limit=estimate.limit, uncertainty=uncertainty)


def _apart(quantity: Quantity, scale: float, row: Mapping, other: Mapping) -> float:
    """Return the difference of two runs, in % or in the unit of the quantity."""
    a, b = run_problems.record_at(row, quantity), run_problems.record_at(other, quantity)
    if not is_number(quantity, a):
        return difference_of(quantity, a, b) * (1.0 if math.isnan(scale) else 100 / abs(scale))
    first = value_of(quantity, a)
    second = value_of(quantity, b)
    if math.isnan(scale):
        return second - first
    return 100 * (second / first - 1)


def _cells(comparison: Comparison, name: str, variant: Convergence | dict) -> dict:
    if isinstance(variant, dict):
        return variant
    given = variant.table[0]
    unit = comparison.unit if math.isnan(comparison.scale) else "%"
    apart = comparison.differences.get(name)
    sizes = f" [{unit}]" if unit else ""
    return {
        "status": OK,
        "value": given["value"],
        "error": given["error"],
        "limit": best_value(variant),
        "uncertainty": variant.uncertainty,
        f"difference as given{sizes}": apart.as_given if apart else None,
        f"difference of limits{sizes}": apart.limit if apart else None,
        f"±{sizes}": apart.uncertainty if apart else None,
        "order": variant.order,
        "triangles": given["triangles"],
        "cpu_seconds": given["cpu_seconds"],
    }


def _overlay(pair: Sequence[Convergence], quantity: Quantity) -> tuple[Overlay | None, tuple]:
    """Return the ends of two variants as given, and why there are none."""
    if len(pair) < 2 or quantity.how == "mode":
        return None, ()
    first, second = (run_problems.end_of(each.levels[0]) for each in pair)
    try:
        return Overlay.of(first, second), ()
    except MeshError as error:  # as where a node is on one cloth only
        return None, (f"There is no overlay: {error}",)
