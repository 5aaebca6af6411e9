"""The error in time of a run in words: how large it is, and which step would give 1 %."""

import math

from fecloth.simulation.error_control import Adaptive

RESOLVED = 0.3  # largest error that the estimate can resolve
WARNED = 0.1
WANTED = 0.01  # the error for which the step is reported
LONGER = 10.0  # most by which that step may be longer than the one taken
LEAST = 1e-5  # a smaller error is reported as below it


def describe_time_error(
    error: float,  # by `TimeError`; NaN for no estimate
    method,  # the method or the choice of its steps
    dt: float,  # the mean size of the steps [s]
    # Time at which a load first jumps [s]. The jump may fall inside any other step: none
    # longer is proposed, and a shorter one as for an error of order 1.
    jump: float = math.inf,
    is_cause: bool = False,  # whether most of the error comes from jumps
    unknown: str = "",  # why there is no estimate
) -> str:
    """Return a sentence about the relative error in time of a run."""
    if unknown:
        return f"error in time: not known, because {unknown}"
    if math.isnan(error):
        return name_time_error(error)
    if error >= RESOLVED:
        finer = "rtol" if isinstance(method, Adaptive) else "dt"
        return f"{name_time_error(error)}; take a smaller {finer}"
    if is_cause:
        cause = f", as a load jumps at t = {jump:.6g} s, which no step meets"
    else:
        cause = ""
    if error < LEAST or (jump < math.inf and error < WANTED):
        return name_time_error(error) + cause
    order = 1 if jump < math.inf else method.traits.order
    return name_time_error(error) + cause + _proposal(error, method, dt, order)


def name_time_error(error: float) -> str:
    """Return how large an error in time is, in words."""
    if math.isnan(error):
        return "error in time: no estimate"
    if error >= RESOLVED:
        return "error in time: not resolved"
    if error < LEAST:
        return f"error in time below {100 * LEAST:g} % of the motion"
    return f"error in time about {100 * error:.2g} % of the motion"


def _proposal(error: float, method, dt: float, order: int) -> str:
    """Return which step gives 1 %, or "" where that is far away or beyond a stability limit."""
    if isinstance(method, Adaptive):  # its error is proportional to the tolerance
        name = "rtol"
        value = method.rtol
        unit = ""
        factor = WANTED / error
        if not method.rtol:
            name = "atol"
            value = method.atol
            unit = " m/s"
    else:
        name = "dt"
        value = dt
        unit = " s"
        factor = (WANTED / error) ** (1 / order)
    if factor > (1.0 if method.traits.explicit else LONGER):
        return ""
    return f"; {name} = {factor * value:.2g}{unit} would give 1 %"
