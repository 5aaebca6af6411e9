"""Specimens of the synthetic tests: functions of h and of the constants that a fit seeks.

Each takes the pattern and the element of its mesh, so that data can come from another one.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

import fecloth as fc

DENSITY = 0.2  # kg/m²
TENSILE = 1000.0  # of specimens whose membrane hardly counts [N/m]
LENGTH, WIDTH, EXTENSION = 0.2, 0.04, 0.03  # of a strip in tension [m, m, 1]
SAG = 6.0  # ρ g L³/B of a strip that hangs: its end drops by about half of its length
SWING, TURN = 0.3, math.pi / 3  # length of the strip that swings [m], and where it begins [rad]
GRIP = (fc.Probe("grip", "right"), fc.Probe("mark", point=(LENGTH / 2, WIDTH)))
TIP = (fc.Probe("tip", "right"),)


@cache
def rectangle(width, height, h, pattern, element="P1") -> fc.Cloth:
    """A mesh that is made once: a fit asks for the same one for each constant."""
    return fc.Cloth.rectangle(width, height, h, pattern, element)


def overhang(bending: float) -> float:
    """The length [m] at which a strip with this B sags well."""
    return (SAG * bending / (DENSITY * 9.81)) ** (1 / 3)


def period(warp: float) -> float:
    """The period [s] of a strip of 1 m that swings in its plane: a quarter of a wave is on it."""
    return 4.0 / math.sqrt(warp / DENSITY)


def pull(h, warp=1e3, weft=1e3, shear=100.0, poisson=0.2, angle=0.0, pattern="right", element="P2"):
    """A strip that two clamps have drawn; the warp is at `angle` [rad].

    At an angle the clamps hold the strip along its pull only. Its strain is uniform then; between
    rigid clamps it is singular at the corners, and its mesh error falls as the root of h only.
    """
    cloth = rectangle(LENGTH, WIDTH, h, pattern, element)
    pins = [fc.Pin("left"), fc.Pin("right")]
    if angle:
        across = {"direction": (0, 1, 0)}
        corner = fc.Pin(lambda X: X[:, 0] + X[:, 1] < 1e-9, name="corner")
        rest = fc.Slide(lambda X: (X[:, 0] < 1e-9) & (X[:, 1] > 1e-9), name="left", **across)
        pins = [corner, rest, fc.Slide("right", **across)]
    fabric = fc.Fabric(DENSITY, (warp, weft), poisson, shear)
    system = fc.System(cloth, fabric, [fc.StVK()], pins, grain=angle)
    return cloth, system, None, system.state(system.rest().x * [1.0 + EXTENSION, 1.0, 1.0])


def hang(h, bending=1e-5, length=0.1, pattern="right", element="P2"):
    """A strip, clamped level, that hangs under its weight; h is a part of its length."""
    cloth = rectangle(length, 0.25 * length, h * length, pattern, element)
    fabric = fc.Fabric(DENSITY, TENSILE, bending_rigidity=bending)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    x, y = cloth.X.T
    return cloth, system, None, system.state(np.column_stack([x, y, -0.3 * x**2 / length]))


def bounce(h, dt, warp=1000.0, damping=1e-3, pattern="right", element="P1"):
    """A strip of 1 m that was drawn along its warp and is let go: it swings in its own plane."""
    cloth = rectangle(1.0, 0.125, h, pattern, element)
    fabric = fc.Fabric(DENSITY, (warp, warp), 0.0, 100.0)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.StrainRateDamping(damping)], ["left"])
    x = system.rest().x
    x[:, 0] += 0.0127 * np.sin(np.pi / 2 * x[:, 0])  # 2 % at the clamp
    return cloth, system, fc.ImplicitMidpoint(), system.state(x)


def swing(h, dt, drag=1.0, pattern="right"):
    """A strip, hinged above, that falls from one side and swings in air."""
    cloth = rectangle(SWING, 0.25 * SWING, h, pattern)
    fabric = fc.Fabric(DENSITY, TENSILE, bending_rigidity=1e-4)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), *([fc.Drag(drag)] if drag else [])]
    system = fc.System(cloth, fabric, terms, ["left"])
    x, y = cloth.X.T
    start = np.column_stack([np.cos(TURN) * x, y, -np.sin(TURN) * x])
    return cloth, system, fc.ImplicitMidpoint(), system.state(start)
