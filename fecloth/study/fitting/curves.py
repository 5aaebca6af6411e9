"""Computed values at the measured points, and their derivatives by the unknowns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from fecloth.errors import InputError
from fecloth.study.fitting.measured import Measured

SPARE = 0.05  # of the curve: how far beyond its end it goes on straight


@dataclass(frozen=True, eq=False)
class Computed:
    """What the problem gives at the points of a measured column."""

    values: np.ndarray  # (n,)
    slopes: np.ndarray  # (n, k) by the unknown constants
    along_slope: np.ndarray  # (n,) by the place along the curve
    shift: float = 0.0  # where the measured places begin


def computed_values(row: Mapping, number: int, count: int) -> Computed:
    """The number of a run without a curve, for each of `count` measurements of it."""
    slopes = np.array(row["slopes"][number], dtype=float)
    same = np.ones(count)
    return Computed(row["values"][number] * same, np.outer(same, slopes), 0.0 * same)


def computed_curve(
    row: Mapping, number: int, order: int | None, points: Measured, shift: float
) -> Computed:
    """The curve of a run at the measured places, which begin at `shift`.

    `number` is the place of the quantity among the values of the row, and `order` of what orders
    the points; None for t. With the curve q(a) of the rows (a_i, q_i) a parameter p changes a value
    at a fixed place A by ∂q/∂p − (dq/da) ∂a/∂p.
    """
    q, dq = _finite(row, number)
    if order is None:
        a, da = np.array(row["times"], dtype=float), np.zeros_like(dq)
    else:
        a, da = _finite(row, order)
        a = a - a[0]
        da = da - da[0]
    known = np.isfinite(q) & np.isfinite(a)
    a, q, da, dq = a[known], q[known], da[known], dq[known]
    if len(a) and a[-1] < a[0]:
        a, q, da, dq = a[::-1], q[::-1], da[::-1], dq[::-1]
    assert points.along is not None
    places = points.along - shift
    _check_order(a, points, places if shift == 0 else np.zeros(1))
    inside = np.clip(places, a[0], a[-1])
    curve = CubicSpline(a, q)
    slope = curve(inside, 1)
    values = curve(inside) + slope * (places - inside)  # beyond the rows as at the end
    slopes = CubicSpline(a, dq)(inside) - slope[:, None] * CubicSpline(a, da)(inside)
    return Computed(values, slopes, slope, shift)


def best_shift(curve: Callable[[float], Computed], points: Measured, reach: float) -> float:
    """The shift with the least sum of squares, for a curve that is compared only."""

    def misfit(shift: float) -> float:
        r = (curve(shift).values - points.values) / points.sigma
        return float(r @ r)

    return float(minimize_scalar(misfit, bounds=(-reach, reach), method="bounded").x)


def _finite(row: Mapping, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (s,) over the rows, and derivatives (s, k)."""
    values = np.array(row["values"][number], dtype=float)
    slopes = np.array(row["slopes"][number], dtype=float).reshape(-1, len(values)).T
    return values, slopes


def _check_order(a: np.ndarray, points: Measured, places: np.ndarray) -> None:
    """Refuse a run with too few rows, that goes back, or that ends before the last place."""
    if len(a) < 2:
        what = f"the run has {len(a)} rows with a value of {points.quantity}"
        remedy = "Give more steps: [equilibrium] load_steps = 10, or a smaller dt."
        raise InputError(what, "a curve needs at least 2", "Experiment", remedy)
    if not (np.diff(a) > 0).all():
        what = "the run goes back, or stands still, along the curve"
        raise InputError(what, "each row must be farther", "Experiment", 'Take along = "t".')
    if places.max() - a[-1] > SPARE * np.ptp(a):
        what = f"{points.column} is measured up to {places.max():.6g} {points.along_unit}".rstrip()
        remedy = "Move the grip farther, run longer, or leave points out."
        raise InputError(what, f"the run reaches {a[-1]:.6g}", "Experiment", remedy)
