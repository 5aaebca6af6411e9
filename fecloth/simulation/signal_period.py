"""The period of a swing from its samples."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from fecloth.errors import InputError

LEAST_SAMPLES = 4  # a cubic spline needs them


def signal_period(times: np.ndarray, values: np.ndarray, name: str = "the signal") -> float:
    """Return the period of a signal that swings about a constant level [unit of times].

    The times at which a cubic spline through the samples passes the level are
    t_k = t_0 + k T/2 + (−1)^k c; T is fitted by least squares. c, which is the shift by a wrong
    level, needs three passages; with only two, T is twice the time between them. The level is
    midway between the extremes or, with three passages, the mean over whole periods.

    Raises
    ------
    InputError
        If the signal has fewer than four samples or passes its middle less than twice.

    Examples
    --------
    >>> t = np.linspace(0, 3, 40)
    >>> print(f"{signal_period(t, 5 + np.cos(2 * np.pi * t / 0.7)):.4f}")
    0.7000
    """
    where = f"period of {name}"
    if len(times) < LEAST_SAMPLES:
        raise InputError(f"{len(times)} samples", f"must be at least {LEAST_SAMPLES}", where)
    spline = CubicSpline(times, values)
    turns = spline.derivative().roots(extrapolate=False)
    extremes = spline(np.append(turns[np.isfinite(turns)], [times[0], times[-1]]))
    passed = _passages(spline, (extremes.min() + extremes.max()) / 2)
    if len(passed) > 2:  # over whole periods the mean is the level of the swing
        last = passed[-1 if len(passed) % 2 else -2]
        passed = _passages(spline, spline.integrate(passed[0], last) / (last - passed[0]))
    if len(passed) < 2:
        remedy = "Take a greater t_end."
        raise InputError("the run", "passes its middle less than twice", where, remedy)
    k = np.arange(len(passed))
    columns = [np.ones(len(k)), 0.5 * k, (-1.0) ** k][: 2 if len(k) == 2 else 3]
    return float(np.linalg.lstsq(np.column_stack(columns), passed, rcond=None)[0][1])


def _passages(spline: CubicSpline, level: float) -> np.ndarray:
    """Return the times inside the samples at which the spline passes a level."""
    times = spline.solve(level, extrapolate=False)
    return np.sort(times[np.isfinite(times)])
