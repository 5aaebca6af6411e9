"""The error in time of a run in words: how large it is, and which step would give 1 %."""

import math

from fecloth.simulation.error_control import Adaptive

LARGEST_STATED = 0.3  # error that the estimate can resolve
PROPOSED_ERROR = 0.01  # for which a step is proposed, where the error is larger
LEAST_STATED = 1e-5  # a smaller error is reported as below it


def describe_time_error(
    error: float,
    method,
    dt: float,
    jump: float = math.inf,
    is_cause: bool = False,
    unknown: str = "",
) -> str:
    """Return a sentence about the relative error in time of a run.

    Parameters
    ----------
    error
        The error by `TimeError`; NaN for no estimate.
    method
        The method, or the choice of its steps.
    dt
        The mean size of the steps [s].
    jump
        Time at which a load first jumps [s]. The jump may fall inside any other step: the error
        is taken as one of order 1.
    is_cause
        Whether most of the error comes from jumps.
    unknown
        Why there is no estimate, or "".
    """
    if unknown:
        return f"error in time: not known, because {unknown}"
    if math.isnan(error):
        return name_time_error(error)
    if error >= LARGEST_STATED:
        finer = "rtol" if isinstance(method, Adaptive) else "dt"
        return f"{name_time_error(error)}; take a smaller {finer}"
    cause = ""
    if is_cause:
        cause = f", as a load jumps at t = {jump:.6g} s, which no step meets"
    if error <= PROPOSED_ERROR:
        return name_time_error(error) + cause
    order = 1 if jump < math.inf else method.traits.order
    return name_time_error(error) + cause + _proposal(error, method, dt, order)


def name_time_error(error: float) -> str:
    """Return how large an error in time is, in words."""
    if math.isnan(error):
        return "error in time: no estimate"
    if error >= LARGEST_STATED:
        return "error in time: not resolved"
    if error < LEAST_STATED:
        return f"error in time below {100 * LEAST_STATED:g} % of the motion"
    return f"error in time about {100 * error:.2g} % of the motion"


def _proposal(error: float, method, dt: float, order: int) -> str:
    """Return which step gives 1 %: to a tolerance the error is proportional."""
    factor = PROPOSED_ERROR / error
    if not isinstance(method, Adaptive):
        proposed = f"dt = {factor ** (1 / order) * dt:.2g} s"
    elif method.rtol:
        proposed = f"rtol = {factor * method.rtol:.2g}"
    else:
        proposed = f"atol = {factor * method.atol:.2g} m/s"
    return f"; {proposed} would give 1 %"
