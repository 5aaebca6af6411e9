"""Errors and seconds between and beyond measured runs: powers of a size."""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from fecloth.study.uncertainty import SAFE, UNSAFE

Run = TypeVar("Run")
CAREFUL = 0.75  # times the theoretical order, where no two errors are clear
LOWEST = 0.5  # order that is assumed at least, where refinement helps at all
STALLED = 0.3  # observed order below which refinement does not help


@dataclass(frozen=True, eq=False)
class Curve:
    """Values y at sizes x, with powers of x between and beyond them."""

    x: np.ndarray  # (k,) increasing sizes, as √triangles or the number of steps
    y: np.ndarray  # (k, q) positive values
    slope: np.ndarray | float  # power of x beyond the largest x
    below: np.ndarray | float  # power of x below the smallest x
    order: np.ndarray | float = LOWEST  # (q,) orders of errors over all runs, see `clear_orders`

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return (m, q) values at (m,) sizes."""
        s = np.log(np.asarray(x, dtype=float))
        t = np.log(self.x)
        inside = np.stack([np.interp(s, t, column) for column in np.log(self.y).T], axis=1)
        beyond = np.maximum(s - t[-1], 0.0)[:, None] * self.slope
        before = np.minimum(s - t[0], 0.0)[:, None] * self.below
        return np.exp(inside + beyond + before)

    def scaled(self, factor: float | np.ndarray) -> "Curve":
        """Return the curve of `factor`, one or (q,), times the values."""
        return replace(self, y=factor * self.y)


def error_curve(
    x: Sequence[float], apart: Sequence[np.ndarray], theory: np.ndarray, left: np.ndarray | float
) -> Curve:
    """Return errors that do not grow with x, with their order beyond the measured ones.

    `apart` are distances to a reference, and `left` is its own error, which is added. An error
    smaller than the error of a finer run is small by chance: the finer run's replaces it. The
    order of the last two runs holds beyond them, but is at least 1/2 and at most the theory; the
    order of the first two holds below them, but is at least 1.
    """
    sizes, values = _sorted(x, apart)
    values = np.maximum.accumulate((values + left)[::-1])[::-1]
    slope = first = -CAREFUL * theory
    if len(sizes) > 1:
        powers = np.diff(np.log(values), axis=0) / np.diff(np.log(sizes))[:, None]
        first = powers[0]
        slope = powers[-1]
    beyond = np.clip(slope, -theory, -np.minimum(LOWEST, theory))
    below = np.clip(first, -theory, -np.minimum(1.0, theory))
    return Curve(sizes, values, beyond, below, clear_orders(sizes, values, theory, left))


def clear_orders(
    x: np.ndarray, errors: np.ndarray, theory: np.ndarray, left: np.ndarray | float
) -> np.ndarray:
    """Return (q,) orders between the first and the last clear error, at least 1/2.

    An error is clear if it is above twice `left`, the error of the reference that it contains:
    the others say more of the reference. With less than two it is `CAREFUL` times the theory.
    """
    orders = CAREFUL * theory
    for k, is_clear in enumerate((errors > 2 * np.asarray(left)).T):
        at = np.flatnonzero(is_clear)
        if len(at) > 1:
            a, b = at[0], at[-1]
            orders[k] = math.log(errors[a, k] / errors[b, k]) / math.log(x[b] / x[a])
    return np.clip(orders, LOWEST, theory)


def error_of_finest(
    distance: Callable[[Run, Run], np.ndarray],
    runs: Sequence[Run],
    sizes: Sequence[float],
    theory: np.ndarray | float,
) -> np.ndarray:
    """Return (q,) errors of the finest of two or more runs: the grid convergence index.

    With d the change by the last refinement, r the ratio of its sizes and p the observed order,
    these are 1.25 d/(rᵖ − 1). From two runs no order is observed: p is the theory, in place of
    1.25 comes 3 (Roache 1994, J. Fluids Eng. 116, 405–413).
    """
    ratio = sizes[-1] / sizes[-2]
    change = distance(runs[-1], runs[-2])
    if len(runs) == 2:
        return UNSAFE * change / (ratio**theory - 1)
    order = np.log(distance(runs[-2], runs[-3]) / change) / math.log(ratio)
    return SAFE * change / (ratio ** np.clip(order, LOWEST, theory) - 1)


def grouped(
    runs: Sequence[Run], group: Callable[[Run], Hashable], size: Callable[[Run], float]
) -> list[list[Run]]:
    """Return the runs of each group, coarse to fine."""
    groups: dict[Hashable, list[Run]] = {}
    for run in sorted(runs, key=size):
        groups.setdefault(group(run), []).append(run)
    return list(groups.values())


def cost_curve(x: Sequence[float], seconds: Sequence[float], low: float, high: float) -> Curve:
    """Return seconds over a size; beyond the measured runs their power lies in [low, high].

    A run that takes longer than a finer one does so by chance, as the first one of a process,
    which loads compiled code: the seconds of the finer run replace its seconds.
    """
    sizes, values = _sorted(x, seconds)
    values = np.minimum.accumulate(np.maximum(values, 1e-6)[::-1])[::-1]
    power = (low + high) / 2
    if len(sizes) > 1:
        power = float(np.log(values[-1] / values[-2]) / np.log(sizes[-1] / sizes[-2]))
    power = min(max(power, low), high)
    return Curve(sizes, values[:, None], power, power)


def _sorted(x: Sequence[float], values: Sequence) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(x)
    return np.asarray(x, dtype=float)[order], np.asarray(values, dtype=float)[order]
