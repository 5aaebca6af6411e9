"""Refine a problem in h, in dt or in both, and say what the result is worth."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fecloth.simulation.doubts.doubt import DoubtKind
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, difference_of, value_of
from fecloth.study.change import Level, make_levels
from fecloth.study.convergence import Convergence, judge
from fecloth.study.problems import Problem
from fecloth.study.result import Table, with_uncertainty
from fecloth.study.run_problems import Point, Runs, check_points, doubts_of, record_at, run_points
from fecloth.study.status import OK
from fecloth.study.uncertainty import UNSAFE, estimate_uncertainty

CLOSER = 10.0  # rtol over rtol of the run that shows the error of chosen steps
RTOL_ORDER = 2 / 3  # global errors of adaptive steps are about proportional to rtol^(2/3)


def refine_problem(
    opened: Problem, quantity: Quantity, refine: str, levels: int, ratio: float | None, runs: Runs
) -> Convergence:
    """Run the levels, and return what they say."""
    cases = levels_to_run(opened, quantity, refine, levels, ratio)
    opened.check_quantity(quantity)
    points = [Point(opened, case, str(case), opened.workload(case)) for case in cases]
    check_points(points, runs)
    rows = run_points(points, [quantity], runs)
    return summarise(opened, quantity, refine, rows[:levels], rows[levels:])


def levels_to_run(
    opened: Problem, quantity: Quantity, refine: str, levels: int, ratio: float | None
) -> list[Level]:
    """Return the levels, coarse to fine, and after them the levels for the other shares."""
    orders = opened.orders(quantity)
    made = make_levels(refine, levels, ratio or opened.ratio(refine), *orders)
    return made + _cases_for_shares(opened, quantity, refine)


def _cases_for_shares(opened: Problem, quantity: Quantity, refine: str) -> list[Level]:
    """Return cases on the first level: finer in what is not refined, and a sharper solver.

    Of steps that their error chooses rtol is divided, in place of dt. With contact the gaps are
    halved in one of them.
    """
    gaps = [Level(gap=2.0)] if opened.has_contact else []
    if opened.is_static or quantity.how == "mode":
        return gaps
    other = {"h": Level(dt=2.0), "dt": Level(h=opened.ratio("h"))}.get(refine)
    if other and opened.can_refine("dt" if refine == "h" else "h"):
        cases = [other]
    else:
        cases = []
    if refine == "h" and opened.rtol:
        cases = [Level(rtol=CLOSER)]
    return cases + gaps + ([] if opened.is_explicit else [Level(sharper=100.0)])


def summarise(
    opened: Problem,
    quantity: Quantity,
    refine: str,
    rows: Sequence[Mapping],
    more: Sequence[Mapping],
) -> Convergence:
    """Return the result from the rows of all levels, coarse to fine, and the rows for shares."""
    orders = opened.orders(quantity)
    theory = orders[1] if refine == "dt" else orders[0]
    shown: dict[str, Any] = {
        "levels": rows,
        "others": more,
        "title": opened.name,
        "quantity": quantity.text,
        "unit": quantity.unit(rows[0].get("energies", ())),
        "refine": refine,
        "theory": theory,
    }
    rows = [{**row, "h": _edge(opened, rows[0], row)} for row in rows]
    failed = [row for row in rows if row["status"] != OK]
    if failed:
        if failed[0]["cause"]:
            cause = failed[0]["cause"].splitlines()[0]
        else:
            cause = failed[0]["status"]
        verdict = f"not known: {len(failed)} of {len(rows)} levels failed; the first: {cause}"
        return Convergence(verdict=verdict, table=Table(tuple(map(_table_row, rows))), **shown)
    values, sequence = _values_of_levels(quantity, rows)
    if not np.isfinite(sequence).all():
        verdict = f"not known: {quantity.text} has no value on a level"
        return Convergence(verdict=verdict, table=Table(tuple(map(_table_row, rows))), **shown)
    sizes = [row["step"] if refine == "dt" else row["h"] for row in rows]
    estimate = estimate_uncertainty(sizes, sequence, theory)
    name = {"h": "mesh", "dt": "time step"}.get(refine, "mesh and time step")
    known = estimate.behaviour in ("monotone", "constant")
    least = 0.0 if known else estimate.uncertainty / UNSAFE  # the finest is not exact
    shares = {name: max(abs(estimate.value - estimate.limit), least)}
    base = record_at(rows[0], quantity)
    able = [row for row in more if row["status"] == OK]
    apart = [difference_of(quantity, base, record_at(row, quantity)) for row in able]
    shares |= other_shares(refine, orders, rows[0], able, apart)
    added = sum(UNSAFE * part for part in list(shares.values())[1:])
    uncertainty = estimate.uncertainty + added
    obstacles = list(rows[-1]["obstacles"]) if refine != "dt" else []
    wrinkles = (doubt for doubt in doubts_of(rows[-1]) if doubt.kind is DoubtKind.WRINKLES)
    doubt = next(wrinkles, None)
    converges, verdict = judge(estimate, sizes, sequence, obstacles, abs(values[-1]), doubt)
    answer = f"{quantity.text} = {with_uncertainty(values[-1], uncertainty, shown['unit'])}"
    lines = [
        _table_row(row) | {"value": value, "error": max(abs(difference - estimate.limit), least)}
        for row, value, difference in zip(rows, values, sequence, strict=True)
    ]
    return Convergence(
        verdict=f"{verdict}: {answer}" if converges else f"{verdict}\nFinest level: {answer}",
        table=Table(tuple(lines)),
        value=values[-1],
        uncertainty=uncertainty,
        limit=estimate.limit if sequence is values else math.nan,
        order=estimate.order,
        converges=converges,
        shares=shares,
        estimate=estimate,
        remarks=tuple(_remarks(rows, shares)),
        **shown,
    )


def _values_of_levels(quantity: Quantity, rows: Sequence[Mapping]) -> tuple[list, list]:
    """Return the values, and the numbers that are judged.

    These are the values or, of fields, paths and vectors, the sum of the differences between
    levels up to the finest one: it falls with the same order, to the error of the finest level.
    """
    records = [record_at(row, quantity) for row in rows]
    values = [value_of(quantity, record) for record in records]
    if is_number(quantity, records[0]):
        return values, values
    apart = [difference_of(quantity, a, b) for a, b in pairwise(records)]
    return values, [sum(apart[k:]) for k in range(len(records))]


def is_number(quantity: Quantity, record: RunRecord) -> bool:
    """Whether the quantity is a number, not a field, a path or a vector."""
    if quantity.is_field or quantity.how == "path":
        return False
    return quantity.how != "value" or record.column(quantity).shape[1] == 1


def _edge(opened: Problem, first: Mapping, row: Mapping) -> float | None:
    """Return h of a level: h of the first times the ratio of √(area of a triangle)."""
    # Of a failed level it is the nominal one.
    if "edge" not in row or "edge" not in first:
        return row["point"].refined.h
    return (opened.h or first["edge"]) * row["edge"] / first["edge"]


def other_shares(
    refine: str,
    orders: tuple[float, float],
    first: Mapping,
    more: Sequence[Mapping],
    apart: Sequence[float],
) -> dict[str, float]:
    """Return the estimated errors that the levels do not show."""
    # `apart` is by how much each of the runs `more` differs from the `first` level.
    errors = {}
    for row, change in zip(more, apart, strict=True):
        if (row["point"].level.sharper or 1.0) > 1:
            errors["solver"] = change
        elif row["point"].level.gap > 1:
            errors["gap"] = change / (1 - 1 / row["point"].level.gap)  # of first order
        elif row["point"].level.rtol > 1:
            errors["time step"] = change / (1 - CLOSER**-RTOL_ORDER)
        elif refine == "h":
            errors["time step"] = change / (1 - 2.0 ** -orders[1])
        else:
            ratio = first["edge"] / row["edge"]
            errors["mesh"] = change / (1 - ratio ** -orders[0])
    return errors


def _table_row(row: Mapping) -> dict:
    """Return the columns of a level that a reader wants."""
    names = ("triangles", "steps", "newton", "cpu_seconds")
    problem = row["point"].problem
    level = row["point"].level
    dt = None if problem.is_static else problem.first.steps.dt
    sizes = {"h": row["h"], "dt": row.get("step", dt and dt / level.dt)}
    if isinstance(sizes["dt"], float) and not math.isfinite(sizes["dt"]):
        del sizes["dt"]
    state = {"status": row["status"]} if row["status"] != OK else {}
    return sizes | {name: row.get(name) for name in names} | state


def _remarks(rows: Sequence[Mapping], shares: Mapping[str, float]) -> list[str]:
    """Return sentences on large other parts of the error, and on what the runs warned of."""
    lines = []
    refined, *others = shares
    for other in others:
        if shares[other] > shares[refined]:
            remedy = "take a smaller gap" if other == "gap" else "refine it too"
            lines.append(
                f"The {other} contributes more than the {refined} that was refined: {remedy}."
            )
    if "time step" not in " ".join(shares) and rows[-1]["time_order"]:
        estimated = rows[-1]["time_error"]
        if estimated >= 0:
            known = f"at {100 * estimated:.2g} % of the motion"
        else:
            known = "not at all"
        lines.append(
            f"The finest run estimates its error in time {known}: the uncertainty does not "
            "contain it."
        )
    warned = [doubt for row in rows for doubt in doubts_of(row)]
    if warned:
        if len(warned) == 1:
            words = "1 warning"
        else:
            words = f"{len(warned)} warnings; the first"
        lines.append(f"The runs gave {words}: {warned[0]}")
    return lines
