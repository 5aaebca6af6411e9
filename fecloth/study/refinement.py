"""Refine a problem in h, in dt or in both, and say what the result is worth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from fecloth.quantities.digits import with_uncertainty
from fecloth.simulation.doubts.doubt import DoubtKind
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, difference_of, is_number
from fecloth.study.convergence import Convergence, has_no_limit, judge
from fecloth.study.levels import REFINED, levels_to_run, other_shares
from fecloth.study.problem import StudyProblem
from fecloth.study.result import Table
from fecloth.study.run_table import row_of_run, with_values
from fecloth.study.runs import (
    Runs,
    announce,
    doubts_of,
    record_at,
    run_quantities,
)
from fecloth.study.states import find_states, run_other_starts
from fecloth.study.status import OK
from fecloth.study.uncertainty import UNSAFE, Estimate, estimate_uncertainty

# What usually makes an order in h smaller than the theory.
CAUSES = ", as at corners, at the ends of pins, and at round borders of straight edges"


def refine_problem(
    problem: StudyProblem,
    quantity: Quantity,
    refine: str,
    levels: int,
    ratio: float | None,
    how: Runs,
    stages: int = 1,
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
    stages
        Number of such studies, of which this is the first, for the line before the first case.
    """
    problem.check_quantity(quantity)
    runs = levels_to_run(problem, quantity, refine, levels, ratio)
    announce(runs, how, stages)
    rows = run_quantities(runs, [quantity], how)
    starts = run_other_starts(rows[:levels], [quantity], how)
    return summarise(problem, quantity, refine, rows[:levels], rows[levels:], starts)


@dataclass(frozen=True)
class Limit:
    """What the values of refined levels, and of the runs for other errors, say of their limit.

    Attributes
    ----------
    estimate
        The `Estimate` from the values of the levels.
    shares
        Estimated size of each part of the error, first the part of what was refined.
    least_error
        Error of the finest level at least: values that go up and down have no limit but the
        finest value, whose error would then be 0.
    """

    estimate: Estimate
    shares: dict[str, float]
    least_error: float

    @classmethod
    def of(
        cls,
        sizes: Sequence[float],
        values: Sequence[float],
        theory: float,
        refine: str,
        others: Mapping[str, float],
    ) -> "Limit":
        """Return the limit of the values on levels of these sizes, beside other errors."""
        estimate = estimate_uncertainty(sizes, values, theory)
        least_error = 0.0
        if estimate.behaviour not in ("monotone", "constant"):
            least_error = estimate.uncertainty / UNSAFE
        own = {REFINED[refine]: max(abs(estimate.value - estimate.limit), least_error)}
        return cls(estimate, own | dict(others), least_error)

    @property
    def uncertainty(self) -> float:
        """The uncertainty of the levels, plus three times each error that they do not show."""
        _, *others = self.shares.values()
        return self.estimate.uncertainty + sum(UNSAFE * share for share in others)

    def without_uncertainty(self) -> "Limit":
        """Return what is left where no limit is seen: neither an uncertainty nor own errors."""
        refined, *_ = self.shares
        value = self.estimate.value
        estimate = replace(self.estimate, limit=value, uncertainty=math.nan)
        return Limit(estimate, {**self.shares, refined: math.nan}, math.nan)

    def errors(self, values: Sequence[float]) -> Sequence[float | None]:
        """Return the error of each value: its distance from the limit; None without a limit."""
        if math.isnan(self.least_error):
            return [None] * len(values)
        return [max(abs(value - self.estimate.limit), self.least_error) for value in values]


def summarise(
    problem: StudyProblem,
    quantity: Quantity,
    refine: str,
    rows: Sequence[Mapping],
    more: Sequence[Mapping],
    starts: Sequence[Mapping] = (),
) -> Convergence:
    """Return the result from the rows of all levels.

    If a refined level failed or has no value, the result has a table, but no value.

    Parameters
    ----------
    rows
        Rows of the refined levels, coarse to fine.
    more
        Rows of the runs for other errors. A failed one is left out.
    starts
        Rows of `run_other_starts`.
    """
    space_order, time_order = problem.orders(quantity)
    described: dict[str, Any] = {  # the fields of the result that say what was studied
        "levels": rows,
        "others": more,
        "title": problem.name,
        "quantity": quantity.text,
        "unit": quantity.unit(rows[0].get("energies", ())),
        "refine": refine,
        "theory": time_order if refine == "dt" else space_order,
    }
    sizes = [_sizes_of(row, rows[0]) for row in rows]
    rows = [with_values(row, [quantity]) for row in rows]
    failure = _find_failure(rows)
    if not failure:
        records = [record_at(row, quantity) for row in rows]
        values = [row["values"][quantity.text] for row in rows]
        judged_numbers = (
            values if is_number(quantity, records[0]) else _distances(quantity, records)
        )
        if not np.isfinite(judged_numbers).all():
            failure = f"{quantity.text} has no value on a level"
    if failure:
        cells = [row_of_run(row, size, {}) for row, size in zip(rows, sizes, strict=True)]
        return Convergence(verdict=f"not known: {failure}", table=Table(tuple(cells)), **described)
    finished = [row for row in more if row["status"] == OK]
    changes = [difference_of(quantity, records[0], record_at(row, quantity)) for row in finished]
    others = other_shares(rows[0], finished, changes, space_order)
    refined_sizes = [size["dt" if refine == "dt" else "h"] for size in sizes]
    limit = Limit.of(refined_sizes, judged_numbers, described["theory"], refine, others)
    obstacles = [] if refine == "dt" else rows[-1]["obstacles"]  # to convergence in h
    has_limit = not has_no_limit(limit.estimate, obstacles)
    if not has_limit:
        limit = limit.without_uncertainty()
    doubts = doubts_of(rows[-1])
    converges, verdict = judge(
        limit.estimate,
        judged_numbers,
        obstacles=obstacles,
        size=abs(values[-1]),
        doubt=next((doubt for doubt in doubts if doubt.kind is DoubtKind.WRINKLES), None),
        usual_cause="" if refine == "dt" else CAUSES,
    )
    states = find_states(quantity, rows, starts, limit.uncertainty)
    is_known = has_limit and not states.is_unknown
    uncertainty = max(limit.uncertainty, states.distance) if is_known else math.nan
    if states.why:
        converges = False
        verdict = states.why if has_limit else f"{states.why}; no limit seen"
    answer = f"{quantity.text} = {with_uncertainty(values[-1], uncertainty, described['unit'])}"
    errors = limit.errors(judged_numbers)
    cells = []
    for row, size, value, error in zip(rows, sizes, values, errors, strict=True):
        cells.append(row_of_run(row, size, {"value": value, "error": error}))
    return Convergence(
        verdict=f"{verdict}: {answer}" if converges else f"{verdict}\nFinest level: {answer}",
        table=Table(tuple(cells)),
        value=values[-1],
        uncertainty=uncertainty,
        states=states.states,
        may_have_other_states=states.is_unknown,
        # the limit of differences between levels is no limit of the quantity
        limit=limit.estimate.limit if judged_numbers is values else math.nan,
        order=limit.estimate.order,
        converges=converges,
        shares=limit.shares,
        estimate=limit.estimate,
        doubts=tuple(doubts),
        remarks=tuple(_remarks(rows[-1], limit.shares)),
        **described,
    )


def _find_failure(rows: Sequence[Mapping]) -> str:
    """Return in words how many levels failed and the cause of the first; "" if none failed."""
    failed = [row for row in rows if row["status"] != OK]
    if not failed:
        return ""
    cause = (failed[0]["cause"] or failed[0]["status"]).splitlines()[0]
    return f"{len(failed)} of {len(rows)} levels failed; the first: {cause}"


def _distances(quantity: Quantity, records: Sequence[RunRecord]) -> list[float]:
    """Return the numbers by which a field, path or vector is judged, one for each level.

    The number of a level is the sum of the differences between successive levels, from this
    level to the finest one: it falls with the same order as the error.
    """
    changes = [difference_of(quantity, coarse, fine) for coarse, fine in pairwise(records)]
    return [sum(changes[k:]) for k in range(len(records))]


def _sizes_of(row: Mapping, first: Mapping) -> dict[str, Any]:
    """Return h of a level, and dt if it has steps in time.

    h is h of the first level times the ratio of √(mean triangle area). A level that failed has
    its nominal sizes.
    """
    problem = row["problem"]
    sizes = {"h": problem.h, "dt": row.get("step", problem.dt)}
    if "edge" in row and "edge" in first:
        sizes["h"] = (first["problem"].h or first["edge"]) * row["edge"] / first["edge"]
    if problem.is_static or math.isnan(sizes["dt"] or 0.0):
        del sizes["dt"]
    return sizes


def _remarks(finest: Mapping, shares: Mapping[str, float]) -> list[str]:
    """Return sentences on which error is larger than the error of what was refined.

    They also say that an error in time is not in the uncertainty.

    Parameters
    ----------
    finest
        Row of the finest level.
    shares
        The parts of the error by their names; the first one is of what was refined.
    """
    lines = []
    refined, *others = shares
    for name in others:
        if shares[name] > shares[refined]:
            remedy = "take a smaller gap" if name == "gap" else "refine it too"
            lines.append(
                f"The {name} contributes more than the {refined} that was refined: {remedy}."
            )
    # the name of the share may also be "mesh and time step"
    if "time step" not in " ".join(shares) and finest["time_order"]:
        size = "not at all"
        if finest["time_error"] >= 0:
            size = f"at {100 * finest['time_error']:.2g} % of the motion"
        lines.append(
            f"The finest run estimates its error in time {size}: the uncertainty does not "
            "contain it."
        )
    return lines
