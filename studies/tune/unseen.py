"""Scenes that a seed draws: sizes, fabrics, pins and loads that the author of `tune` has not seen.

Their references are made by the study itself, beside their grids, and are not stored.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from studies.tune.scenes import EXPLICIT, NEEDS, STATIC, Tried

GRAVITY = 9.81
COUNT = 4  # scenes of a seed
TOLERANCES = (0.01, 0.01, 0.03, 0.005)
STVK, WEIGHT = {"type": "StVK"}, {"type": "Gravity"}


def draw(seed: int) -> list[Tried]:
    """Return the scenes of a seed.

    Examples
    --------
    >>> [one.name for one in draw(1)] == [one.name for one in draw(1)]
    True
    """
    rng = np.random.default_rng(seed)
    makers = rng.permutation(len(KINDS))[:COUNT]
    return [KINDS[k](rng, f"{KINDS[k].__name__}_{seed}") for k in makers]


def pillow(rng, name) -> Tried:
    """A rectangle, held at its border and blown up: static."""
    width, height, size = _sizes(rng)
    fabric = _fabric(rng)
    load = min(fabric["tensile_stiffness"]) / width * _draw(rng, 0.02, 0.2)
    bump = f"{0.15 * height:.4g} * sin(pi * X / {width}) * sin(pi * Y / {height})"
    changes = {
        "cloth": size | {"h": _short(height / 8)},
        "fabric": fabric,
        "terms": [STVK, {"type": "Pressure", "p": _short(load)}],
        "pins": [{"where": "boundary", "name": "rim"}],
        "start": {"position": ["X", "Y", bump]},
        "probes": [{"name": "middle", "point": [width / 2, height / 2]}],
    }
    fine = {"cloth.element": "P2", "cloth.h": _short(height / 12)}
    return _tried(rng, name, STATIC | changes, ("middle.z", "mean_displacement.z"), fine)


def banner(rng, name) -> Tried:
    """A sheet that hangs from its top edge and stretches: static."""
    _, height, size = _sizes(rng)
    fabric = _fabric(rng, 0.2 * GRAVITY * height / _draw(rng, 0.02, 0.1))
    changes = {
        "cloth": size | {"h": _short(height / 10)},
        "fabric": fabric | {"areal_density": 0.2},
        "terms": [STVK, WEIGHT],
        "pins": [{"where": "top"}],
        "start": {"plane": "xz"},
        "probes": [{"name": "hem", "where": "bottom"}],
    }
    fine = {"cloth.element": "P2", "cloth.h": _short(height / 20)}
    return _tried(rng, name, STATIC | changes, ("hem.z", "mean_displacement.z"), fine)


def shelf(rng, name) -> Tried:
    """A sheet, clamped level along its left edge, that bends under its weight: static."""
    width, height, size = _sizes(rng)
    density = _draw(rng, 0.1, 0.5)
    rigidity = density * GRAVITY * width**3 / _draw(rng, 0.5, 4)
    stretch = 1e5 * rigidity / width**2
    changes = {
        "cloth": size | {"h": _short(height / 6)},
        "fabric": {
            "areal_density": density,
            "tensile_stiffness": _short(stretch),
            "poisson_ratio": _draw(rng, 0.0, 0.3),
            "bending_rigidity": _short(rigidity),
        },
        "terms": [STVK, {"type": "PlateBending"}, WEIGHT],
        "pins": [{"where": "left", "clamp": True}],
        "probes": [{"name": "tip", "where": "right"}],
    }
    fine = {"cloth.element": "P2", "cloth.h": _short(height / 8)}
    return _tried(rng, name, STATIC | changes, ("tip.z", "tip.x"), fine)


def drop(rng, name) -> Tried:
    """A sheet, held along two or four edges, that falls and is caught by its tension."""
    width, height, size = _sizes(rng)
    fabric = _fabric(rng)
    stiffness = min(fabric["tensile_stiffness"])
    sag = 0.3 * (fabric["areal_density"] * GRAVITY / stiffness) ** (1 / 3) * height ** (4 / 3)
    where = ["boundary"] if rng.integers(2) else ["top", "bottom"]
    changes = {
        "cloth": size | {"h": _short(height / 10)},
        "fabric": fabric,
        "terms": [STVK, WEIGHT],
        "pins": [{"where": one} for one in where],
        "probes": [{"name": "middle", "point": [width / 2, height / 2]}],
        "time": _time("implicit_midpoint", 50, 1.2 * math.sqrt(2 * sag / GRAVITY)),
    }
    fine = EXPLICIT | {"cloth.element": "P1", "cloth.h": _short(height / 40)}
    return _tried(rng, name, changes, ("path of mean_displacement.z", "middle.z"), fine)


def lash(rng, name) -> Tried:
    """A sheet, held level along one edge, that falls; its fabric damps it."""
    width, height, size = _sizes(rng)
    changes = {
        "cloth": size | {"h": _short(height / 8)},
        "fabric": _fabric(rng) | {"poisson_ratio": 0.0},
        "terms": [STVK, {"type": "StrainRateDamping", "time": 0.01}, WEIGHT],
        "pins": [{"where": "left"}],
        "probes": [{"name": "tip", "where": "right"}],
        "time": _time("bdf2", 60, 0.3 * math.sqrt(width)),
    }
    steps = {"time.method": "bdf2", "time.dt": _short(0.3 * math.sqrt(width) / 400)}
    fine = steps | {"cloth.element": "P2", "cloth.h": _short(height / 8)}
    return _tried(rng, name, changes, ("path of mean_displacement", "tip.z"), fine)


KINDS: tuple[Callable[..., Tried], ...] = (pillow, banner, shelf, drop, lash)


def _tried(rng, name, changes, quantities, fine) -> Tried:
    tolerance = float(rng.choice(TOLERANCES))
    more = {"output": None, "solver": None}
    return Tried(name, f"{NEEDS}/taut.toml", tolerance, more | changes, quantities, fine)


def _sizes(rng) -> tuple[float, float, dict]:
    """Return width and height [m], and the table of the cloth; the width is not the shorter."""
    height = _draw(rng, 0.2, 1.0)
    width = _short(height * _draw(rng, 1.0, 2.0))
    pattern = str(rng.choice(["right", "cross", "equilateral", "unstructured"]))
    return width, height, {
        "shape": "rectangle", "width": width, "height": height, "pattern": pattern,
        "element": str(rng.choice(["P1", "P2"])),
    }  # fmt: skip


def _fabric(rng, stiffness: float | None = None) -> dict:
    """Return a fabric that is softer along the weft."""
    warp = stiffness or 10 ** _draw(rng, 2.3, 3.7)
    weft = warp * _draw(rng, 0.5, 1.0)
    return {
        "areal_density": _draw(rng, 0.05, 0.4),
        "tensile_stiffness": [_short(warp), _short(weft)],
        "shear_stiffness": _short(warp * _draw(rng, 0.1, 0.4)),
        "poisson_ratio": _draw(rng, 0.0, 0.25),
    }


def _time(method: str, steps: int, t_end: float) -> dict:
    return {"method": method, "dt": _short(t_end / steps), "t_end": _short(t_end)}


def _draw(rng, low: float, high: float) -> float:
    return _short(rng.uniform(low, high))


def _short(value: float) -> float:
    return float(f"{value:.3g}")
