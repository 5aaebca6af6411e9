"""Detection of jumps in a pin's motion, which no step size can resolve."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import pairwise

import numpy as np

from fecloth.errors import InputError
from fecloth.simulation.between_steps import each, motion_values
from fecloth.system.motion import Motion
from fecloth.system.pins import Pin
from fecloth.system.state import State
from fecloth.system.system import System

JUMP = 0.25  # of the velocity; a smooth motion that the steps resolve shows (ω dt)²/12
BACK = 2  # also check the two previous steps: the effect of a jump can appear later
FORMULAS, FUNCTIONS = 2**13, 2**10  # intervals of a run in which a jump is looked for
MOST = 8  # jumps of a pin that are looked for
HALVINGS = 30  # of an interval, after which what is left of a change is a jump
SMALL = 1e-6  # of the cloth's extent; a smaller jump does nothing
SLOW = 1.0  # m/s, of the motion that a warning proposes instead


def find_motion_jumps(system: System, state: State, t_end: float) -> Iterator[str]:
    """Yield a sentence with a remedy for each pin whose motion jumps between `state` and `t_end`.

    Formulas are evaluated at 8,193 times and functions at 1,025, and the intervals that differ most
    from those beside them are halved until a jump remains, or none. A motion that goes there and
    back within an interval is missed.
    """
    least = SMALL * system.cloth.extent
    for name, (pin, _) in system.constraints.groups.items():
        found: list[tuple[float, float]] = []
        if pin.moves:
            with suppress(Exception):  # whatever a user's function may raise: the run will tell it
                moved = partial(pin.sample, size=system.cloth.extent)
                values, count = each(moved), FUNCTIONS
                if isinstance(pin.motion, Motion) and pin.rotate is None:
                    values, count = motion_values(pin.motion), FORMULAS
                found = find_jumps(values, state.t, t_end, count, least)
        if found:
            yield _sentence(name, found)


def _sentence(name: str, jumps: list[tuple[float, float]]) -> str:
    t, size = max(jumps, key=lambda jump: jump[1])
    later = t + max(size / SLOW, 0.01)
    more = f", the largest of {len(jumps)} jumps" if len(jumps) > 1 else ""
    return (
        f"the motion of the pin {name!r} jumps by {size:.3g} m at t = {t:.6g} s{more}: no step "
        "resolves a jump, and its effect on the cloth depends on dt; let the pin move in a finite "
        f"time, as {size:.3g} * smoothstep({t:.6g}, {later:.6g}, t) does"
    )


def find_jumps(
    values: Callable[[np.ndarray], np.ndarray], begin: float, end: float, count: int, least: float
) -> list[tuple[float, float]]:
    """Return (time, size) of the jumps beyond `least` of a function of times.

    Parameters
    ----------
    values
        Function of times (m,) with values (m, k).
    count
        Number of intervals in which a jump is looked for.

    Examples
    --------
    >>> find_jumps(lambda t: np.sign(t - 0.25)[:, None], 0.0, 1.0, 64, 1e-6)
    [(0.25, 2.0)]
    """
    times = np.linspace(begin, end, count + 1)
    steps = np.abs(np.diff(values(times), axis=0)).max(axis=1)
    beside = np.minimum(np.append(steps[1], steps[:-1]), np.append(steps[1:], steps[-2]))
    most = np.argsort(np.where(steps > least, beside - steps, 0.0), kind="stable")[:MOST]
    jumps: list[tuple[float, float]] = []
    near = 1e-9 * (end - begin)
    for i in sorted(most[steps[most] > least]):
        t, left = _halve(values, times[i], times[i + 1])
        if left > least and not (jumps and t - jumps[-1][0] <= near):
            around = np.clip([t - near, t + near], begin, end)
            t = begin if t - begin <= near else t
            jumps.append((t, float(np.abs(np.diff(values(around), axis=0)).max())))
    return jumps


def _halve(values, begin: float, end: float) -> tuple[float, float]:
    """Return the time of the largest change in an interval, and the change left after HALVINGS."""
    ends = np.array([begin, 0.5 * (begin + end), end])
    changes = np.zeros(2)
    for _ in range(HALVINGS):
        ends[1] = 0.5 * (ends[0] + ends[2])
        changes = np.abs(np.diff(values(ends), axis=0)).max(axis=1)
        ends[[0, 2]] = ends[[0, 1]] if changes[0] > changes[1] else ends[[1, 2]]
    return float(ends[2]), float(changes.max())


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
