"""The error in time of a run in words: how large it is, and which step would give 1 %."""

from __future__ import annotations

import math

from fecloth.simulation.error_control import Adaptive

RESOLVED = 0.3  # largest error that the estimate can tell
WARNED = 0.1
WANTED = 0.01  # the error for which the step is told
LONGER = 10.0  # most by which that step may be longer than the one taken
LEAST = 1e-5  # a smaller error is not told apart from it


def describe_time_error(error: float, method, dt: float) -> str:
    """Return a sentence about the relative error in time of a run.

    Parameters
    ----------
    error
        By `relative_error`; NaN for no estimate.
    method, dt
        The method or the choice of its steps, and their mean size [s].

    Examples
    --------
    >>> import fecloth as fc
    >>> describe_time_error(0.16, fc.BDF2(), dt=0.004)
    'error in time about 16 %; dt = 0.001 s would give 1 %'
    """
    if math.isnan(error):
        return "error in time: no estimate"
    if error >= RESOLVED:
        finer = "rtol" if isinstance(method, Adaptive) else "dt"
        return f"error in time: not resolved; take a smaller {finer}"
    if error < LEAST:
        return f"error in time below {100 * LEAST:g} %"
    return f"error in time about {100 * error:.2g} %{_proposal(error, method, dt)}"


def is_warned_of(error: float) -> bool:
    """Whether the sentence is a warning."""
    return error > WARNED


def _proposal(error, method, dt):
    """Return which step gives 1 %, or "" where that is far away or beyond a stability limit."""
    if isinstance(method, Adaptive):  # its error is proportional to the tolerance
        name, value, unit, factor = "rtol", method.rtol, "", WANTED / error
        if not method.rtol:
            name, value, unit = "atol", method.atol, " m/s"
    else:
        name, value, unit = "dt", dt, " s"
        factor = (WANTED / error) ** (1 / method.traits.order)
    if factor > (1.0 if method.traits.explicit else LONGER):
        return ""
    return f"; {name} = {factor * value:.2g}{unit} would give 1 %"
