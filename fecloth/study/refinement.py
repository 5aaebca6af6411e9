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

# rtol over rtol of the run that shows the error of chosen steps: the error falls to a fifth, so
# that the change is most of it.
RTOL_RATIO = 10.0
RTOL_ORDER = 2 / 3  # global errors of adaptive steps are about proportional to rtol^(2/3)


def refine_problem(
    opened: Problem, quantity: Quantity, refine: str, levels: int, ratio: float | None, runs: Runs
) -> Convergence:
    """Run the levels of a problem, and return what they say about the quantity.

    Parameters
    ----------
    refine
        "h", "dt" or "both".
    levels
        Their number, from 3.
    ratio
        The size of a level over the size of the next one; None for the usual ratio.
    """
    refined = levels_to_run(opened, quantity, refine, levels, ratio)
    opened.check_quantity(quantity)
    points = [Point(opened, level, str(level), opened.workload(level)) for level in refined]
    check_points(points, runs)
    rows = run_points(points, [quantity], runs)
    return summarise(opened, quantity, refine, rows[:levels], rows[levels:])


def levels_to_run(
    opened: Problem, quantity: Quantity, refine: str, levels: int, ratio: float | None
) -> list[Level]:
    """Return the levels, coarse to fine, and after them the levels that show other errors."""
    space_order, time_order = opened.orders(quantity)
    ratio = ratio or opened.ratio(refine)
    refined_levels = make_levels(refine, levels, ratio, space_order, time_order)
    return refined_levels + _levels_for_other_errors(opened, quantity, refine)


def _levels_for_other_errors(opened: Problem, quantity: Quantity, refine: str) -> list[Level]:
    """Return up to three levels, each of which is the first level with one other refinement.

    They show the errors that the refined levels do not show. One level is finer in dt, if h is
    refined, or in h, if dt is refined. If the error chooses the steps, rtol is divided in place
    of dt. One level halves the gaps of contact, if there is contact. One divides the tolerance
    of the solver, if steps in time solve equations.
    """
    levels = []
    in_time = not (opened.is_static or quantity.how == "mode")
    if in_time and refine == "h" and opened.rtol:
        levels.append(Level(rtol=RTOL_RATIO))
    elif in_time and refine == "h" and opened.can_refine("dt"):
        levels.append(Level(dt=2.0))
    elif in_time and refine == "dt" and opened.can_refine("h"):
        levels.append(Level(h=opened.ratio("h")))
    if opened.has_contact:
        levels.append(Level(gap=2.0))
    if in_time and not opened.is_explicit:
        levels.append(Level(sharper=100.0))
    return levels


def summarise(
    opened: Problem,
    quantity: Quantity,
    refine: str,
    rows: Sequence[Mapping],
    more: Sequence[Mapping],
) -> Convergence:
    """Return the result from the rows of all levels.

    If a refined level failed or has no value, the result has a table, but no value. Else the
    uncertainty is the uncertainty of the refined levels, plus three times each error that they
    do not show.

    Parameters
    ----------
    rows
        Rows of the refined levels, coarse to fine.
    more
        Rows of the levels that show other errors. A failed one is left out.
    """
    space_order, time_order = opened.orders(quantity)
    theory = time_order if refine == "dt" else space_order
    described: dict[str, Any] = {  # the fields of the result that say what was studied
        "levels": rows,
        "others": more,
        "title": opened.name,
        "quantity": quantity.text,
        "unit": quantity.unit(rows[0].get("energies", ())),
        "refine": refine,
        "theory": theory,
    }
    rows = [{**row, "h": _edge(opened, rows[0], row)} for row in rows]
    if failure := _find_failure(rows):
        return _make_unknown_result(failure, rows, described)
    values, judged_numbers = _values_of_levels(quantity, rows)
    if not np.isfinite(judged_numbers).all():
        why = f"{quantity.text} has no value on a level"
        return _make_unknown_result(why, rows, described)
    sizes = [row["step"] if refine == "dt" else row["h"] for row in rows]
    estimate = estimate_uncertainty(sizes, judged_numbers, theory)
    least_error = 0.0
    if estimate.behaviour not in ("monotone", "constant"):
        # Such values have no limit but the finest one, whose error would then be 0.
        least_error = estimate.uncertainty / UNSAFE
    name = {"h": "mesh", "dt": "time step"}.get(refine, "mesh and time step")
    own_share = {name: max(abs(estimate.value - estimate.limit), least_error)}
    finished = [row for row in more if row["status"] == OK]
    first_record = record_at(rows[0], quantity)
    changes = []  # of the quantity, by each of the other refinements
    for row in finished:
        changes.append(difference_of(quantity, first_record, record_at(row, quantity)))
    other_errors = other_shares(refine, (space_order, time_order), rows[0], finished, changes)
    uncertainty = estimate.uncertainty + sum(UNSAFE * share for share in other_errors.values())
    obstacles = []
    if refine != "dt":  # they are obstacles to convergence in h
        obstacles = list(rows[-1]["obstacles"])
    wrinkles = (doubt for doubt in doubts_of(rows[-1]) if doubt.kind is DoubtKind.WRINKLES)
    doubt = next(wrinkles, None)
    size = abs(values[-1])
    converges, verdict = judge(estimate, sizes, judged_numbers, obstacles, size, doubt)
    value_words = with_uncertainty(values[-1], uncertainty, described["unit"])
    answer = f"{quantity.text} = {value_words}"
    errors = [max(abs(number - estimate.limit), least_error) for number in judged_numbers]
    shares = own_share | other_errors
    return Convergence(
        verdict=f"{verdict}: {answer}" if converges else f"{verdict}\nFinest level: {answer}",
        table=_make_table(rows, values, errors),
        value=values[-1],
        uncertainty=uncertainty,
        # the limit of differences between levels is no limit of the quantity
        limit=estimate.limit if judged_numbers is values else math.nan,
        order=estimate.order,
        converges=converges,
        shares=shares,
        estimate=estimate,
        remarks=tuple(_remarks(rows, shares)),
        **described,
    )


def _make_unknown_result(why: str, rows: Sequence[Mapping], described: Mapping) -> Convergence:
    """Return a result without a value, whose verdict says `why` there is none.

    `described` are the fields of the result that say what was studied.
    """
    table = Table(tuple(map(_table_row, rows)))
    return Convergence(verdict=f"not known: {why}", table=table, **described)


def _make_table(rows: Sequence[Mapping], values: Sequence[float], errors: Sequence[float]) -> Table:
    """Return a table of levels with the value and the error of each."""
    table_rows = []
    for row, value, error in zip(rows, values, errors, strict=True):
        table_rows.append(_table_row(row) | {"value": value, "error": error})
    return Table(tuple(table_rows))


def _find_failure(rows: Sequence[Mapping]) -> str:
    """Return in words how many levels failed and the cause of the first; "" if none failed."""
    failed = [row for row in rows if row["status"] != OK]
    if not failed:
        return ""
    cause = failed[0]["status"]
    if failed[0]["cause"]:
        cause = failed[0]["cause"].splitlines()[0]
    return f"{len(failed)} of {len(rows)} levels failed; the first: {cause}"


def _values_of_levels(quantity: Quantity, rows: Sequence[Mapping]) -> tuple[list, list]:
    """Return two lists with an item for each level: the values, and the numbers that are judged.

    The judged numbers are the values themselves. But of a field, path or vector the number of a
    level is the sum of the differences between successive levels, from this level to the finest
    one: it falls with the same order as the error.
    """
    records = [record_at(row, quantity) for row in rows]
    values = [value_of(quantity, record) for record in records]
    if is_number(quantity, records[0]):
        return values, values
    changes = [difference_of(quantity, coarse, fine) for coarse, fine in pairwise(records)]
    return values, [sum(changes[k:]) for k in range(len(records))]


def is_number(quantity: Quantity, record: RunRecord) -> bool:
    """Whether the quantity is a number, not a field, a path or a vector."""
    if quantity.is_field or quantity.how == "path":
        return False
    return quantity.how != "value" or record.column(quantity).shape[1] == 1


def _edge(opened: Problem, first: Mapping, row: Mapping) -> float | None:
    """Return h of a level: h of the first level times the ratio of √(mean triangle area).

    A failed level has its nominal h.
    """
    if "edge" not in row or "edge" not in first:
        return row["point"].refined.h
    return (opened.h or first["edge"]) * row["edge"] / first["edge"]


def other_shares(
    refine: str,
    orders: tuple[float, float],
    first: Mapping,
    more: Sequence[Mapping],
    changes: Sequence[float],
) -> dict[str, float]:
    """Return the estimated errors that the refined levels do not show, by their names.

    An error ∝ s^p of the first level changes by the share 1 − r^−p of itself if the size s is
    divided by r. So the error is the change of the quantity divided by this share.

    Parameters
    ----------
    refine
        "h", "dt" or "both": what the refined levels divide.
    orders
        Theoretical orders in h and in dt.
    first
        Row of the first level.
    more, changes
        Rows of the levels that show other errors, and how far each is from the first level.
    """
    space_order, time_order = orders
    errors = {}
    for row, change in zip(more, changes, strict=True):
        level = row["point"].level
        if (level.sharper or 1.0) > 1:
            errors["solver"] = change  # a hundredth of the tolerance leaves nearly no error
        elif level.gap > 1:
            errors["gap"] = change / (1 - 1 / level.gap)  # of first order
        elif level.rtol > 1:
            errors["time step"] = change / (1 - RTOL_RATIO**-RTOL_ORDER)
        elif refine == "h":  # then the other level halves dt
            errors["time step"] = change / (1 - 2.0**-time_order)
        else:  # the ratio of edge lengths as meshed
            ratio = first["edge"] / row["edge"]
            errors["mesh"] = change / (1 - ratio**-space_order)
    return errors


def _table_row(row: Mapping) -> dict:
    """Return the cells of a level that the table shows, without its value and error.

    A failed level has its nominal step, and its status.
    """
    cells = {"h": row["h"]}
    dt = row["step"] if "step" in row else _nominal_step(row)
    if dt is None or math.isfinite(dt):
        cells["dt"] = dt
    for name in ("triangles", "steps", "newton", "cpu_seconds"):
        cells[name] = row.get(name)
    if row["status"] != OK:
        cells["status"] = row["status"]
    return cells


def _nominal_step(row: Mapping) -> float | None:
    """Return the step of a level that failed [s]; None where there is no fixed step."""
    problem = row["point"].problem
    if problem.is_static or not problem.first.steps.dt:
        return None
    return problem.first.steps.dt / row["point"].level.dt


def _remarks(rows: Sequence[Mapping], shares: Mapping[str, float]) -> list[str]:
    """Return sentences on what a reader should know of the errors and of the runs.

    They say which error is larger than the error of what was refined, that an error in time is
    not in the uncertainty, and how many warnings there were.

    Parameters
    ----------
    rows
        Rows of the refined levels, coarse to fine.
    shares
        The parts of the error by their names; the first one is of what was refined.
    """
    lines = []
    refined_part, *other_parts = shares
    for other_part in other_parts:
        if shares[other_part] > shares[refined_part]:
            remedy = "refine it too"
            if other_part == "gap":
                remedy = "take a smaller gap"
            lines.append(
                f"The {other_part} contributes more than the {refined_part} that was refined: "
                f"{remedy}."
            )
    # the name of the share may also be "mesh and time step"
    if "time step" not in " ".join(shares) and rows[-1]["time_order"]:
        estimated = rows[-1]["time_error"]
        size = "not at all"
        if estimated >= 0:
            size = f"at {100 * estimated:.2g} % of the motion"
        lines.append(
            f"The finest run estimates its error in time {size}: the uncertainty does not "
            "contain it."
        )
    doubts = [doubt for row in rows for doubt in doubts_of(row)]
    if doubts:
        if len(doubts) == 1:
            words = "1 warning"
        else:
            words = f"{len(doubts)} warnings; the first"
        lines.append(f"The runs gave {words}: {doubts[0]}")
    return lines
