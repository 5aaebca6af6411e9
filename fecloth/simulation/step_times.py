"""When steps end: at multiples of dt, at stops, at the end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real

import numpy as np

from fecloth.errors import InputError, floats
from fecloth.integrators.protocol import check_method

MOST_STEPS = 10**8  # whose end times alone take 0.8 GB


def end_times(t: float, t_end: float, stops: Sequence[float] = ()) -> np.ndarray:
    """Return the stops after t and before t_end, in order, and t_end."""
    if not isinstance(t_end, Real) or isinstance(t_end, bool):
        raise InputError(f"t_end = {t_end!r}", "must be a number [s]", "march")
    if not (math.isfinite(t_end) and t_end > t):
        raise InputError(f"t_end = {t_end!r}", f"must be finite and > {t} [s]", "march")
    stops = np.unique(floats("stops", stops, "march"))
    if not np.isfinite(stops).all():
        raise InputError(f"stops = {stops.tolist()}", "must be finite [s]", "march")
    outside = stops[(stops < t) | (stops > t_end * (1 + 1e-12))]
    if len(outside):
        allowed = f"must lie in the run, from {t:g} to {t_end:g} s"
        raise InputError(f"stops: {outside[0]:g}", allowed, "march")
    times = np.concatenate([[t], stops[(stops > t) & (stops < t_end)], [t_end]])
    apart = np.diff(times) > 1e-9 * (t_end - t)  # closer times are the same
    return np.append(times[1:-1][apart[:-1] & apart[1:]], t_end)


def step_times(t: float, dt: float, t_end: float, stops: Sequence[float] = ()) -> np.ndarray:
    """Return the end time of every step, t + i dt without accumulated round-off."""
    if not isinstance(dt, Real) or isinstance(dt, bool):
        remedy = "Or leave it out and let Adaptive(method) or Auto() choose the steps."
        raise InputError(f"dt = {dt!r}", "must be a number [s]", "march", remedy)
    if not (math.isfinite(dt) and dt > 0):
        raise InputError(f"dt = {dt!r}", "must be finite and > 0 [s]", "march")
    pieces = []
    for target in end_times(t, t_end, stops):
        steps = max(1, math.ceil((target - t) / dt - 1e-9))
        if steps > MOST_STEPS:
            allowed = f"makes {steps:.2g} steps, and must make at most {MOST_STEPS:.0e}"
            raise InputError(f"dt = {dt:g} s", allowed, "march", "A bare number is in seconds.")
        pieces.append(t + dt * np.arange(1, steps + 1))
        pieces[-1][-1] = t = target
    return np.concatenate(pieces)


def target_times(method, t, dt, t_end, stops):
    """Return the times at which a step must end; refuse a step that the method cannot take."""
    check_method(method)
    if method.traits.explicit and (dt is None or isinstance(dt, str)):
        if dt is not None:
            remedy = "Leave it out for the largest stable step."
            raise InputError(f"dt = {dt!r}", "must be a number [s]", "march", remedy)
        return end_times(t, t_end, stops)
    if not method.traits.chooses_dt:
        return step_times(t, dt, t_end, stops)
    if dt is not None:
        allowed = f"must be left out: {type(method).__name__} chooses its steps"
        raise InputError(f"dt = {dt!r}", allowed, "march")
    return end_times(t, t_end, stops)


def targets_after(targets, t):
    """Return the targets after t."""
    if not targets[-1] > t:
        raise InputError(f"t_end = {targets[-1]}", f"must be > {t} [s]", "march")
    return targets[targets > t]
