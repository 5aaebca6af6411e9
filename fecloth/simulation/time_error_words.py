"""The error in time of a run in words: how large it is, and which step would give at most 1 %."""

import math

from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.shorter_steps import name_shorter_steps

LARGEST_STATED = 0.5  # bound from which on the steps do not resolve the motion
PROPOSED_ERROR = 0.01  # for which a step is proposed, where the bound is larger
LEAST_STATED = 1e-5  # a smaller bound is reported as below it


def describe_time_error(most: float, estimate, method, dt: float, unknown: str = "") -> str:
    """Return a sentence about the relative error in time of a run.

    Parameters
    ----------
    most
        What the error is at most; NaN for no estimate.
    estimate
        The `SampledError` or the `Companion` that it is by. Where a load has jumped, it may have
        jumped inside any other step: the error is taken as one of order 1.
    method
        The method, or the choice of its steps.
    dt
        The mean size of the steps [s].
    unknown
        Why there is no estimate, or "".
    """
    if unknown:
        return f"error in time: not known, because {unknown}"
    words = name_time_error(most, estimate.safety)
    if estimate.safety == 1.0 and not math.isnan(most):
        words += f" (a run with other steps is {estimate.whole:.2g} m away, at most)"
    if most >= LARGEST_STATED:
        return f"{words}; take {name_shorter_steps(method)}"
    if not most > 1.05 * PROPOSED_ERROR:  # a bound of 1 % in two digits needs no proposal
        return words
    order = 1 if estimate.kicked < math.inf else method.traits.order
    return words + _proposal(most, method, dt, order)


def name_time_error(most: float, safety: float = 1.0) -> str:
    """Return how large an error in time is, and at most, in words."""
    if math.isnan(most):
        return "error in time: no estimate"
    if most >= LARGEST_STATED:
        return "error in time: not resolved, or small errors have grown"
    if most < LEAST_STATED:
        return f"error in time below {100 * LEAST_STATED:g} % of the motion"
    if safety == 1.0:
        return f"error in time at most {100 * most:.2g} % of the motion"
    return f"error in time {100 * most / safety:.2g} % of the motion (at most {100 * most:.2g} %)"


def _proposal(error: float, method, dt: float, order: int) -> str:
    """Return which step gives 1 %: to a tolerance the error is proportional."""
    factor = PROPOSED_ERROR / error
    if not isinstance(method, Adaptive):
        proposed = f"dt = {factor ** (1 / order) * dt:.2g} s"
    elif method.rtol:
        proposed = f"rtol = {factor * method.rtol:.2g}"
    else:
        proposed = f"atol = {factor * method.atol:.2g} m/s"
    return f"; {proposed} would give at most 1 %"
