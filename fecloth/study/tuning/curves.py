"""Errors and seconds between and beyond measured runs: powers of a size."""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from fecloth.study.uncertainty import SAFE, UNSAFE

Run = TypeVar("Run")
# Part of the theoretical order that is assumed where no two errors are clear.
CAREFUL_PART_OF_ORDER = 0.75
# Order that is assumed at least, where refinement helps at all: also the least one that the grid
# convergence index trusts.
LEAST_ORDER = 0.5
STALLED_ORDER = 0.3  # observed order below which refinement does not help; not far below it


@dataclass(frozen=True, eq=False)
class Curve:
    """Values y at sizes x, with powers of x between and beyond them.

    Attributes
    ----------
    x
        (k,) increasing sizes, as √triangles or the number of steps.
    y
        (k, q) positive values.
    slope
        Power of x beyond the largest x.
    below
        Power of x below the smallest x.
    order
        (q,) orders of errors over all runs, see `clear_orders`.
    """

    x: np.ndarray
    y: np.ndarray
    slope: np.ndarray | float
    below: np.ndarray | float
    order: np.ndarray | float = LEAST_ORDER

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return (m, q) values at (m,) sizes."""
        # a power of x is a straight line in the logarithms
        at = np.log(np.asarray(x, dtype=float))
        measured = np.log(self.x)
        columns = [np.interp(at, measured, column) for column in np.log(self.y).T]
        inside = np.stack(columns, axis=1)
        beyond = np.maximum(at - measured[-1], 0.0)[:, None] * self.slope
        before = np.minimum(at - measured[0], 0.0)[:, None] * self.below
        return np.exp(inside + beyond + before)

    def scaled(self, factor: float | np.ndarray) -> "Curve":
        """Return the curve of `factor`, one or (q,), times the values."""
        return replace(self, y=factor * self.y)


def error_curve(
    x: Sequence[float], apart: Sequence[np.ndarray], theory: np.ndarray, left: np.ndarray | float
) -> Curve:
    """Return the curve of the errors over the sizes x of k runs; a larger x is a finer run.

    `apart` are k distances (q,) to a reference run. `left` is the error of the reference itself,
    which is added to them. `theory` (q,) are the theoretical orders.

    Between the runs errors never grow with x: an error that is smaller than the error of a finer
    run is small by chance, and gets the finer run's. Beyond the finest run errors fall with the
    order of the last two runs, but with at least 1/2 and at most the theory. Below the coarsest
    run they grow with the order of the first two, but with at least 1. From a single run no
    order is seen: then three quarters of the theory count as observed.
    """
    sizes, values = _sorted(x, apart)
    # the largest error of this run and of all finer ones
    values = np.maximum.accumulate((values + left)[::-1])[::-1]
    if len(sizes) > 1:
        powers = np.diff(np.log(values), axis=0) / np.diff(np.log(sizes))[:, None]
    else:
        powers = -CAREFUL_PART_OF_ORDER * theory[None]
    return Curve(
        x=sizes,
        y=values,
        slope=np.clip(powers[-1], -theory, -np.minimum(LEAST_ORDER, theory)),
        below=np.clip(powers[0], -theory, -np.minimum(1.0, theory)),
        order=clear_orders(sizes, values, theory, left),
    )


def clear_orders(
    x: np.ndarray, errors: np.ndarray, theory: np.ndarray, left: np.ndarray | float
) -> np.ndarray:
    """Return the (q,) observed orders, of at least 1/2 and at most the theory.

    `errors` (k, q) are the errors at increasing sizes x (k,). Each contains `left`, the error of
    the reference. An error is clear if it is above twice `left`: a smaller one says more of the
    reference than of the run. The order is observed between the first and the last clear error.
    With less than two clear errors it is three quarters of the theory.
    """
    orders = CAREFUL_PART_OF_ORDER * theory
    for k, is_clear in enumerate((errors > 2 * np.asarray(left)).T):
        clear = np.flatnonzero(is_clear)
        if len(clear) > 1:
            first, last = clear[0], clear[-1]
            fall = errors[first, k] / errors[last, k]
            orders[k] = math.log(fall) / math.log(x[last] / x[first])
    return np.clip(orders, LEAST_ORDER, theory)


def error_of_finest(
    distance: Callable[[Run, Run], np.ndarray],
    runs: Sequence[Run],
    sizes: Sequence[float],
    theory: np.ndarray | float,
) -> np.ndarray:
    """Return (q,) errors of the finest of two or more runs: the grid convergence index.

    Let d be the change by the last refinement, r the ratio of its sizes and p the observed
    order: the errors are 1.25 d/(rᵖ − 1). From two runs no order is observed; then p is the
    theory, and the factor 1.25 becomes 3. Source: Roache (1994), J. Fluids Eng. 116, 405–413.
    """
    ratio = sizes[-1] / sizes[-2]
    change = distance(runs[-1], runs[-2])
    if len(runs) == 2:
        return UNSAFE * change / (ratio**theory - 1)
    order = np.log(distance(runs[-2], runs[-3]) / change) / math.log(ratio)
    return SAFE * change / (ratio ** np.clip(order, LEAST_ORDER, theory) - 1)


def grouped(
    runs: Sequence[Run], group: Callable[[Run], Hashable], size: Callable[[Run], float]
) -> list[list[Run]]:
    """Return the runs of each group, coarse to fine."""
    groups: dict[Hashable, list[Run]] = {}
    for run in sorted(runs, key=size):
        groups.setdefault(group(run), []).append(run)
    return list(groups.values())


def cost_curve(x: Sequence[float], seconds: Sequence[float], low: float, high: float) -> Curve:
    """Return the curve of measured CPU seconds over a size x, such as √triangles.

    Beyond the measured runs the seconds follow the power of x that the last two runs show, but
    at least `low` and at most `high`; a single run gets their middle.

    A run that takes longer than a finer one does so by chance. The first run of a process does,
    for example, because it loads compiled code. The seconds of the finer run replace its own.
    """
    sizes, values = _sorted(x, seconds)
    # a clock may show 0, which has no logarithm
    values = np.maximum(values, np.finfo(float).eps)
    # the least seconds of this run and of all finer ones
    values = np.minimum.accumulate(values[::-1])[::-1]
    if len(sizes) > 1:
        measured = float(np.log(values[-1] / values[-2]) / np.log(sizes[-1] / sizes[-2]))
        power = min(max(measured, low), high)
    else:
        power = (low + high) / 2
    return Curve(x=sizes, y=values[:, None], slope=power, below=power)


def _sorted(x: Sequence[float], values: Sequence) -> tuple[np.ndarray, np.ndarray]:
    """Return sizes and their values by increasing sizes."""
    order = np.argsort(x)
    return np.asarray(x, dtype=float)[order], np.asarray(values, dtype=float)[order]
