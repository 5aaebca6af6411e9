"""Detection of jumps in a pin's motion, which no step size can resolve."""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise

import numpy as np

from fecloth.errors import InputError
from fecloth.system.pins import Pin
from fecloth.system.system import System

JUMP = 0.25  # of the velocity; a smooth motion that the steps resolve shows (ω dt)²/12
BACK = 2  # also check the two previous steps: the effect of a jump can appear later


def find_jumping_pin(system: System, t: float, dt: float, steps: int) -> str:
    """Return the name of a pin whose motion jumps in the step from t or the two before, or "".

    `steps` is the number of earlier steps.
    """
    times = t + dt * np.arange(-min(BACK, steps), 2)
    for name, (pin, _) in system.constraints.groups.items():
        if pin.motion is not None and any(has_jump(pin, *ends) for ends in pairwise(times)):
            return name
    return ""


def has_jump(pin: Pin, begin: float, end: float) -> bool:
    """Whether |Δu/Δt − mean of the velocities at both ends| is beyond JUMP of the largest of these.

    A function that fails at such a time counts as smooth.

    Examples
    --------
    >>> has_jump(Pin("left", motion=lambda t: (0, 0, 0.1 * t**2)), 0.4, 0.5)
    False
    >>> has_jump(Pin("left", motion=lambda t: (0, 0, 0.1 if t > 0.42 else 0)), 0.4, 0.5)
    True
    """
    with suppress(InputError, ArithmeticError, ValueError):
        mean = (pin.displacement(end) - pin.displacement(begin)) / (end - begin)
        v0, v1 = pin.speed(begin), pin.speed(end)
        largest = max(abs(v).max() for v in (mean, v0, v1))
        return bool(abs(mean - 0.5 * (v0 + v1)).max() > JUMP * largest)
    return False
