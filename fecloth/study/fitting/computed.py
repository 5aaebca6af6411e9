"""What a run gives at the places of measured points, and its derivatives by the constants."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.optimize import minimize_scalar

from fecloth.errors import InputError
from fecloth.study.fitting.measured import Measured

SPARE = 0.05  # part of a curve's length by which it goes on straight beyond its end


@dataclass(frozen=True, eq=False)
class Computed:
    """What the problem gives at the n points of a measured column.

    Attributes
    ----------
    values
        (n,) values of the quantity.
    slopes
        (n, k) their derivatives by the unknown constants.
    along_slope
        (n,) their derivatives by the place along the curve.
    shift
        The measured place where the curve begins.
    start
        The value where the curve begins; 0 of numbers without a curve.
    """

    values: np.ndarray
    slopes: np.ndarray
    along_slope: np.ndarray
    shift: float = 0.0
    start: float = 0.0

    @property
    def changes(self) -> np.ndarray:
        """(n,) changes of the values from the start."""
        return self.values - self.start


def computed_values(row: Mapping, number: int, count: int) -> Computed:
    """The number of a run without a curve, for each of `count` measurements of it."""
    slopes = np.array(row["slopes"][number], dtype=float)
    return Computed(
        values=np.full(count, row["values"][number]),
        slopes=np.tile(slopes, (count, 1)),
        along_slope=np.zeros(count),
    )


def computed_curve(
    row: Mapping, number: int, order: int | None, points: Measured, shift: float | None
) -> Computed:
    """Return the values of a curve q(a) of a run, and their derivatives, at the measured places.

    `number` is the index of the quantity q among the values of the row; `order` is the index of
    a, along which the points are ordered, or None if a is the time. The curve is a spline
    through the rows (a_i, q_i) of the run. A parameter p changes its value at a fixed place by
    ∂q/∂p − (dq/da) ∂a/∂p.

    `shift` is the measured place at which a = 0, or None without an offset. Before it the
    specimen is slack, and has the value of its start. Places a little beyond the end lie on a
    straight line. Raise `InputError` for a run that is no curve; without an offset also for
    points far beyond its end.
    """
    a, da, q, dq = _read_curve(row, number, order)
    assert points.along is not None
    places = points.along - (shift or 0.0)
    # an offset moves the places during the search, so that they are not checked
    _check_order(a, points, places if shift is None else np.zeros(1))
    is_slack = np.zeros(len(places), dtype=bool)
    if shift is not None:
        # the curve may go towards negative a: then slack places are positive
        is_slack = places * np.sign(a[-1] + a[0]) < 0
    places = np.where(is_slack, 0.0, places)
    inside = np.clip(places, a[0], a[-1])
    spline = scipy.interpolate.CubicSpline
    curve = spline(a, q)
    slope = curve(inside, 1)
    begin = np.clip(0.0, a[0], a[-1])
    return Computed(
        values=curve(inside) + slope * (places - inside),  # beyond the rows as at the end
        slopes=spline(a, dq)(inside) - slope[:, None] * spline(a, da)(inside),
        along_slope=np.where(is_slack, 0.0, slope),
        shift=shift or 0.0,
        start=float(curve(begin) - curve(begin, 1) * begin),
    )


def _read_curve(
    row: Mapping, number: int, order: int | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a (s,), ∂a/∂p (s, k), q (s,) and ∂q/∂p (s, k) of a run, by increasing a.

    `number` and `order` are the indices of q and a among the values of the row; for `order` =
    None, a is the time, which no parameter changes. A quantity a counts from its start. Rows
    where a or q has no value are left out.
    """
    q, dq = _rows(row, number)
    if order is None:
        a = np.array(row["times"])
        da = np.zeros_like(dq)
    else:
        a, da = _rows(row, order)
        a = a - a[0]
        da = da - da[0]
    rows = np.flatnonzero(np.isfinite(q) & np.isfinite(a))
    if len(rows) and a[rows[-1]] < a[rows[0]]:  # the grip moves in the negative direction
        rows = rows[::-1]
    return a[rows], da[rows], q[rows], dq[rows]


def best_shift(curve: Callable[[float], Computed], points: Measured, reach: float) -> float:
    """The shift with the least sum of squares, for a curve that is compared only.

    The changes of the curve may have any factor: this is what is compared.
    """

    def misfit(shift: float) -> float:
        computed = curve(shift)
        x = computed.changes / points.sigma
        y = (points.values - computed.start) / points.sigma
        residual = y - x * (x @ y) / (x @ x or 1.0)
        return float(residual @ residual)

    return float(minimize_scalar(misfit, bounds=(-reach, reach), method="bounded").x)


def _rows(row: Mapping, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (s,) over the rows, and derivatives (s, k)."""
    values = np.array(row["values"][number], dtype=float)
    slopes = np.array(row["slopes"][number], dtype=float).reshape(-1, len(values)).T
    return values, slopes


def _check_order(a: np.ndarray, points: Measured, places: np.ndarray) -> None:
    """Raise `InputError` if a run is no curve through all measured places.

    This is so if it has less than two rows, if its places `a` do not increase from row to row,
    or if it ends before the largest of the measured `places` by more than `SPARE`.
    """
    if len(a) < 2:
        what = f"the run has {len(a)} rows with a value of {points.quantity}"
        remedy = "Give more steps: [equilibrium] load_steps = 10, or a smaller dt."
        raise InputError(what, "a curve needs at least 2", "Experiment", remedy)
    if not (np.diff(a) > 0).all():
        what = "the run goes back, or stands still, along the curve"
        raise InputError(what, "each row must be farther", "Experiment", 'Take along = "t".')
    farthest = places.max()
    if farthest - a[-1] > SPARE * np.ptp(a):
        what = f"{points.column} is measured up to {farthest:.6g} {points.along_unit}".rstrip()
        remedy = "Move the grip farther, run longer, or leave points out."
        raise InputError(what, f"the run reaches {a[-1]:.6g}", "Experiment", remedy)
