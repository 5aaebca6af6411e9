"""Error from pin motion and loads that vary inside a step."""

import numpy as np

from fecloth.integrators.step import Step
from fecloth.system.pins import Pin
from fecloth.system.state import State
from fecloth.system.system import System


def uneven(count: int) -> np.ndarray:
    """Return so many times inside a step, as parts of it.

    They are uneven, so that no periodic motion is zero at all of them.
    """
    number = np.arange(1, count + 1)
    return (number + 0.2 * np.sin(number**2)) / (count + 1)


# Where pins and loads are looked at inside a step; loads cost an evaluation of all forces.
PINS = uneven(16)
LOADS = PINS[1::3]


def deviation_within_step(system: System, old: State, step: Step) -> tuple[float, float]:
    """Return the deviations of pin motion [m] and of acceleration by loads [m/s²] within a step.

    Pin motion is compared with the cubic through its positions and velocities at both ends.
    Loads, at the final positions and velocities, are compared with the straight line between
    both ends. A change shorter than a sixteenth of the step can be missed.
    """
    t = old.t
    dt = step.state.t - old.t
    moved = (pin for pin, _ in system.constraints.groups.values() if pin.motion is not None)
    pins = max((_motion_deviation(pin, t, dt) for pin in moved), default=0.0)
    return pins, _load_deviation(system, step.state, t, dt)


def _motion_deviation(pin: Pin, t: float, dt: float) -> float:
    """Return the largest distance [m] of a pin's motion from its Hermite cubic in a step."""
    u0, u1 = (np.asarray(pin.displacement(end), float) for end in (t, t + dt))
    v0, v1 = (dt * np.asarray(pin.speed(end, since=t), float) for end in (t, t + dt))
    largest = 0.0
    for s in PINS:
        cubic = u0 + s * v0 + s**2 * (3 * (u1 - u0) - 2 * v0 - v1)
        cubic += s**3 * (2 * (u0 - u1) + v0 + v1)
        deviation = np.abs(pin.displacement(t + s * dt) - cubic).max()
        largest = max(largest, float(deviation))
    return largest


def _load_deviation(system: System, state: State, t: float, dt: float) -> float:
    """Return the largest deviation of the acceleration from its line in a step [m/s²].

    It is a root mean square over the nodes, at the positions and velocities of `state`.
    """
    start, *inside, end = (
        acceleration(system, State(t + s * dt, state.x, state.v)) for s in (0.0, *LOADS, 1.0)
    )
    lines = [start + s * (end - start) for s in LOADS]
    deviations = [a - line for a, line in zip(inside, lines, strict=True)]
    return max(system.sums.rms(system.diagonal_mass, deviation) for deviation in deviations)


def acceleration(system: System, state: State) -> np.ndarray:
    """Return f/m (n, 3) [m/s²] of the free directions, with the diagonal mass."""
    return system.constraints.project(system.force(state) / system.diagonal_mass[:, None])
