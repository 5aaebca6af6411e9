"""Whether a pin's motion jumps: then no step is short enough, and the motion is to be changed."""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise

import numpy as np

from fecloth.errors import InputError
from fecloth.system.pins import Pin
from fecloth.system.system import System

JUMP = 0.25  # of the velocity; a smooth motion that the steps resolve shows (ω dt)²/12
BACK = 2  # steps: what a jump has made may be found out after it


def jumping(system: System, t: float, dt: float, steps: int) -> str:
    """Name of a group of pins whose motion jumps in the step from t, or in the two before, or "".

    `steps` is the number of steps that there were before this one.
    """
    times = t + dt * np.arange(-min(BACK, steps), 2)
    for name, (pin, _) in system.constraints.groups.items():
        if pin.motion is not None and any(jumps(pin, *ends) for ends in pairwise(times)):
            return name
    return ""


def jumps(pin: Pin, begin: float, end: float) -> bool:
    """Whether |Δu/Δt − mean of the velocities at both ends| is beyond JUMP of the largest of these.

    A function that cannot be asked at such a time does not count as jumping.

    Examples
    --------
    >>> jumps(Pin("left", motion=lambda t: (0, 0, 0.1 * t**2)), 0.4, 0.5)
    False
    >>> jumps(Pin("left", motion=lambda t: (0, 0, 0.1 if t > 0.42 else 0)), 0.4, 0.5)
    True
    """
    with suppress(InputError, ArithmeticError, ValueError):
        mean = (pin.displacement(end) - pin.displacement(begin)) / (end - begin)
        v0, v1 = pin.speed(begin), pin.speed(end)
        largest = max(abs(v).max() for v in (mean, v0, v1))
        return bool(abs(mean - 0.5 * (v0 + v1)).max() > JUMP * largest)
    return False
