"""What pins and loads do within a step, which its ends do not show."""

from __future__ import annotations

import numpy as np

from fecloth.integrators.step import Step
from fecloth.system.state import State
from fecloth.system.system import System

# Parts of a step at which it is looked into: uneven, lest a periodic motion hide between them.
PINS = (np.arange(1, 17) + 0.2 * np.sin(np.arange(1, 17) ** 2)) / 17
LOADS = PINS[1::3]


def unseen(system: System, old: State, step: Step) -> tuple[float, float]:
    """How far the motion of pins [m], and the acceleration by loads [m/s²], stray within a step.

    The pins' motion from the cubic that has its ends and its velocities there; the loads, at the
    positions and velocities at the end, from the straight line between their values at the ends.
    What is shorter than a sixteenth of the step may still be missed.
    """
    t, dt = old.t, step.state.t - old.t
    moved = (pin for pin, _ in system.constraints.groups.values() if pin.motion is not None)
    pins = max((_astray(pin, t, dt) for pin in moved), default=0.0)
    return pins, _loads(system, step.state, t, dt)


def _astray(pin, t, dt):
    """The largest distance of a motion from its Hermite cubic."""
    u0, u1 = (np.asarray(pin.displacement(at), float) for at in (t, t + dt))
    v0, v1 = (dt * np.asarray(pin.speed(at, since=t), float) for at in (t, t + dt))
    far = 0.0
    for s in PINS:
        cubic = u0 + s * v0 + s**2 * (3 * (u1 - u0) - 2 * v0 - v1)
        cubic += s**3 * (2 * (u0 - u1) + v0 + v1)
        far = max(far, float(np.abs(pin.displacement(t + s * dt) - cubic).max()))
    return far


def _loads(system, state, t, dt):
    """The largest root mean square over the nodes."""

    def acceleration(s):
        f = system.force(State(t + s * dt, state.x, state.v))
        return system.constraints.project(f / system.diagonal_mass[:, None])

    start, end = acceleration(0.0), acceleration(1.0)
    strays = (acceleration(s) - (start + s * (end - start)) for s in LOADS)
    return max(system.sums.rms(system.diagonal_mass, stray) for stray in strays)
