"""Equilibria that have several states: other starts, and levels of different states."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter

import numpy as np

from fecloth.errors import amount
from fecloth.simulation.doubts.doubt import DoubtKind
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.quantity_values import difference_of, is_number, size_of, value_of
from fecloth.study.laying import ways_of_laying
from fecloth.study.runs import Row, Run, Runs, doubts_of, record_at, run_quantities
from fecloth.study.status import OK

# The part of the area that is compressed: above it an equilibrium may have other states.
MOST_COMPRESSED = 0.01
# Other starts may take so many times the time of all levels; one of them always runs.
PATIENCE = 5.0
MOST_OTHER_STARTS = 5
# Over the quantity: states whose values are nearer are one state for an engineer.
SAME_VALUE = 0.005
NO_OTHER_START = "no other start came to rest, so that other states are not excluded"


@dataclass(frozen=True)
class States:
    """What is known of the states of an equilibrium.

    Attributes
    ----------
    states
        The values and the numbers of folds of different states, first that of the finest level;
        of folds None where there is no rim. One or none where no others were found.
    distance
        The largest distance of the other values from the first, in the unit of the quantity.
    why
        Why the uncertainty of the levels alone is not the answer, a sentence; or "".
    is_unknown
        Whether there may be other states that no start showed.
    """

    states: tuple[tuple[float, float | None], ...] = ()
    distance: float = 0.0
    why: str = ""
    is_unknown: bool = False


def may_have_others(row: Mapping) -> bool:
    """Whether the cloth of a row rests in an equilibrium that may have other states.

    Rows of runs in time do not say which part of the cloth is `compressed`.
    """
    return row["status"] == OK and row.get("compressed", 0.0) > MOST_COMPRESSED


def run_other_starts(
    levels: Sequence[Mapping],
    quantities: Sequence[Quantity],
    how: Runs,
    most: float = math.inf,
) -> list[Row]:
    """Lay the cloth in other ways, on the finest level that the time allows; return the rows.

    The `level` of a row is its index. There are none where the levels, from coarse to fine, tell
    that there is one state only. The starts may take `PATIENCE` times as long as the levels, and
    at most `most` seconds; the first of them runs in any case.
    """
    if not may_have_others(levels[-1]):
        return []
    seconds = sum(row["case_seconds"] for row in levels)
    allowed = min(PATIENCE * seconds, most, (how.most_seconds or math.inf) - seconds)
    first = levels[0]
    unit = first["case_seconds"] / first["problem"].work.seconds
    costs = [unit * row["problem"].work.seconds for row in levels]  # from their own start
    level = max([k for k, cost in enumerate(costs) if cost <= allowed], default=0)
    problem = levels[level]["problem"]
    ways = ways_of_laying(problem.first, levels[level]["folds"])[:MOST_OTHER_STARTS]
    if not how.quiet:
        starts = amount(len(ways), "other start")
        words = f"the cloth may have other states: up to {starts}, about {costs[level]:.2g} s each"
        print(words, file=sys.stderr, flush=True)
    rows = list[Row]()
    for way in ways:
        taken = sum(row.get("case_seconds", 0.0) for row in rows)
        if rows and taken * (1 + 1 / len(rows)) > allowed:
            break
        run = Run(problem, f"laid {way}", {"level": level}, arguments={"laid": way})
        rows += run_quantities([run], quantities, how)
    return rows


def find_states(
    quantity: Quantity,
    levels: Sequence[Mapping],
    starts: Sequence[Mapping],
    uncertainty: float,
) -> States:
    """Return the states that levels, coarse to fine, and other starts have, for a quantity.

    Starts and levels have different states if they have different numbers of folds. A start also
    has another state than its level if their values differ by more than the uncertainty of the
    levels and `SAME_VALUE`; an uncertainty that is not known, NaN, does not count. Where a cloth
    may have other states, a last refinement that changes its shape by as much as the one before
    has left the branch.
    """
    finest = levels[-1]
    if not may_have_others(finest):
        return States()
    values = _values(quantity, levels)
    states = [(values[-1], finest["folds"])]
    for row, value in zip(levels[:-1], values, strict=False):
        if row["folds"] not in (None, *(folds for _, folds in states)):
            states.append((value, row["folds"]))
    resting = [row for row in starts if row["status"] == OK and is_stable(row)]
    for row in resting:
        level = row["level"]
        value, own = _values(quantity, [row, levels[level]])
        has_same_folds = row["folds"] == levels[level]["folds"]
        same = SAME_VALUE * abs(own)
        if has_same_folds and abs(value - own) <= np.fmax(uncertainty, same):
            continue
        others = [other for other, folds in states[1:] if folds == row["folds"]]
        if all(abs(value - other) > same for other in others):
            states.append((value, row["folds"]))
    distance = max(abs(value - values[-1]) for value, _ in states)
    if len(states) > 1:
        words = ", ".join(
            _describe(value, folds) for value, folds in sorted(states, key=itemgetter(0))
        )
        return States(tuple(states), distance, f"several states: {words}")
    if not resting:
        return States(tuple(states), is_unknown=True, why=NO_OTHER_START)
    if leaves_branch(levels):
        why = (
            "the levels are different states: the last changes the shape as much as the one before"
        )
        return States(tuple(states), is_unknown=True, why=why)
    return States(tuple(states))


def describe_several_states(folds: Mapping[str, float], finer: Mapping[str, float]) -> list[str]:
    """Return a sentence for each name whose cloth has other numbers of folds on a finer mesh."""
    return [
        f"{name}: several states: {folds[name]:.0f} folds, and {finer[name]:.0f} on the finer "
        "mesh; a part by mesh is the distance between them"
        for name in sorted(folds.keys() & finer.keys())
        if folds[name] != finer[name]
    ]


def leaves_branch(levels: Sequence[Mapping]) -> bool:
    """Whether the last refinement changes the displacement as much as the one before it."""
    shape = parse_quantity("displacement")
    records = [record_at(row, shape) for row in levels[-3:]]
    before, last = (difference_of(shape, a, b) for a, b in pairwise(records))
    return last > max(before, SAME_VALUE * size_of(shape, records[-1]))


def is_stable(row: Mapping) -> bool:
    """Whether a row has an equilibrium that is not said to be unstable."""
    return not any(doubt.kind is DoubtKind.INSTABILITY for doubt in doubts_of(row))


def _values(quantity: Quantity, rows: Sequence[Mapping]) -> list[float]:
    """Return the numbers of a quantity; of fields, paths and vectors their sizes."""
    records = [record_at(row, quantity) for row in rows]
    read = value_of if is_number(quantity, records[0]) else size_of
    return [read(quantity, record) for record in records]


def _describe(value: float, folds: float | None) -> str:
    """Return a value and its folds in words."""
    if folds is None:
        return f"{value:.3g}"
    return f"{value:.3g} with {folds:.0f} folds"
