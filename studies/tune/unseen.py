"""Scenes that a seed draws: sizes, fabrics, pins and loads that the author of `tune` has not seen.

Their references are made by the study itself, beside their grids, and are not stored. A scene whose
two fine runs differ by too much has no known answer: there `tune` must prove nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from studies.tune.scenes import EXPLICIT, NEEDS, STATIC, Tried

GRAVITY = 9.81
EACH = 3  # scenes of a kind
TOLERANCES = (0.01, 0.01, 0.02, 0.03)
STVK, WEIGHT = {"type": "StVK"}, {"type": "Gravity"}


def draw(seed: int) -> list[Tried]:
    """Return the scenes of a seed: some of each kind, so that the first ten are of all kinds.

    Examples
    --------
    >>> [one.name for one in draw(1)] == [one.name for one in draw(1)]
    True
    """
    rng = np.random.default_rng(seed)
    return [make(rng, f"{make.__name__}_{seed}_{k + 1}") for k in range(EACH) for make in KINDS]


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
    fine = {"cloth.element": "P2", "cloth.h": _short(height / 8)}
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
    fine = {"cloth.element": "P2", "cloth.h": _short(height / 12)}
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


def drawn(rng, name) -> Tried:
    """A flat strip, its grain across, that is drawn out between two plates: a slow motion."""
    height = _draw(rng, 0.02, 0.05)
    width = _short(height * _draw(rng, 2.0, 4.0))
    size = {"shape": "rectangle", "width": width, "height": height, "pattern": _pattern(rng)}
    warp = 10 ** _draw(rng, 3.0, 4.0)
    strain = _draw(rng, 0.02, 0.15)
    changes = {
        "cloth": size | {"element": "P1", "h": _short(height / 6)},
        "fabric": {
            "areal_density": _draw(rng, 0.1, 0.3),
            "tensile_stiffness": [_short(warp), _short(warp * _draw(rng, 0.5, 1.0))],
            "shear_stiffness": _short(warp * _draw(rng, 0.02, 0.3)),
            "poisson_ratio": _draw(rng, 0.0, 0.25),
        },
        "grain_degrees": float(rng.choice([0, 30, 45, 60])),
        "terms": [STVK, {"type": "MassDamping", "rate": 20.0}],
        "pins": [
            {"where": "left"},
            {"where": "right", "name": "plate", "motion": [f"{strain * width:.4g} * t", "0", "0"]},
        ],
        "probes": [{"name": "waist", "point": [width / 2, 0.0]}],
        "time": _time("backward_euler", 20, 1.0),
    }
    fine = {"time.dt": 1 / 40, "cloth.element": "P2", "cloth.h": _short(height / 8)}
    return _tried(rng, name, changes, ("reaction.plate.x", "waist"), fine)


def _fall(rng, time: Callable[[float], dict]) -> tuple[float, dict]:
    """Return the height, and the changes, of a sheet that falls and is caught by its tension."""
    width, height, size = _sizes(rng)
    fabric = _fabric(rng)
    stiffness = min(fabric["tensile_stiffness"])
    sag = 0.3 * (fabric["areal_density"] * GRAVITY / stiffness) ** (1 / 3) * height ** (4 / 3)
    where = ["boundary"] if rng.integers(2) else ["top", "bottom"]
    return height, {
        "cloth": size | {"h": _short(height / 8)},
        "fabric": fabric,
        "terms": [STVK, WEIGHT],
        "pins": [{"where": side} for side in where],
        "probes": [{"name": "middle", "point": [width / 2, height / 2]}],
        "time": time(1.2 * math.sqrt(2 * sag / GRAVITY)),
    }


def drop(rng, name) -> Tried:
    """A sheet, held along two or four edges, that falls and is caught by its tension."""
    height, changes = _fall(rng, lambda end: _time("implicit_midpoint", 40, end))
    fine = EXPLICIT | {"cloth.element": "P1", "cloth.h": _short(height / 32)}
    return _tried(rng, name, changes, ("path of mean_displacement.z",), fine)


def fall(rng, name) -> Tried:
    """The same with explicit steps."""
    steps = {"method": "central_difference", "dt": "auto"}
    height, changes = _fall(rng, lambda end: steps | {"t_end": _short(end)})
    changes |= {"mass": "lumped", "cloth": changes["cloth"] | {"element": "P1"}}
    fine = {"cloth.h": _short(height / 32)}
    return _tried(rng, name, changes, ("path of mean_displacement.z",), fine)


def lash(rng, name) -> Tried:
    """A sheet, held level along one edge, that falls; its fabric damps it."""
    width, height, size = _sizes(rng)
    end = 0.3 * math.sqrt(width)
    changes = {
        "cloth": size | {"h": _short(height / 6)},
        "fabric": _fabric(rng) | {"poisson_ratio": 0.0},
        "terms": [STVK, {"type": "StrainRateDamping", "time": 0.01}, WEIGHT],
        "pins": [{"where": "left"}],
        "probes": [{"name": "tip", "where": "right"}],
        "time": _time("bdf2", 40, end),
    }
    steps = {"time.method": "bdf2", "time.dt": _short(end / 160)}
    fine = steps | {"cloth.element": "P2", "cloth.h": _short(height / 6)}
    return _tried(rng, name, changes, ("path of mean_displacement", "tip.z"), fine)


def swing(rng, name) -> Tried:
    """A sheet with bending that hangs from its top edge and swings from a slope."""
    height = _draw(rng, 0.2, 0.6)
    width = _short(height * _draw(rng, 0.3, 0.6))
    size = {"shape": "rectangle", "width": width, "height": height, "pattern": _pattern(rng)}
    density, end = _draw(rng, 0.1, 0.4), 2.0 * math.sqrt(height / GRAVITY)
    changes = {
        "cloth": size | {"element": "P1", "h": _short(width / 3)},
        "fabric": {
            "areal_density": density,
            "tensile_stiffness": _short(density * GRAVITY * height * 10 ** _draw(rng, 2.0, 3.0)),
            "bending_rigidity": _short(density * GRAVITY * height**3 * _draw(rng, 0.02, 0.2)),
        },
        "terms": [STVK, {"type": "PlateBending"}, {"type": "MassDamping", "rate": 1.0}, WEIGHT],
        "pins": [{"where": "top"}],
        "start": {
            "plane": "xz",
            "rotate": {"axis": [1, 0, 0], "degrees": _draw(rng, 10.0, 40.0)},
        },
        "probes": [{"name": "hem", "where": "bottom"}],
        "time": _time("implicit_midpoint", 60, end),
    }
    steps = {"time.method": "bdf2", "time.dt": _short(end / 300)}
    fine = steps | {"cloth.element": "P2", "cloth.h": _short(width / 3)}
    return _tried(rng, name, changes, ("path of hem", "hem.y"), fine)


def wave(rng, name) -> Tried:
    """A taut strip that starts with a smooth velocity across."""
    height = _draw(rng, 0.05, 0.2)
    width = _short(height * _draw(rng, 3.0, 6.0))
    stretch, stiffness, density = _draw(rng, 1.03, 1.1), 10 ** _draw(rng, 2.3, 3.0), 0.2
    speed = math.sqrt(stiffness * (stretch - 1) / density)
    changes = {
        "cloth": {
            "shape": "rectangle", "width": width, "height": height, "h": _short(height / 2),
            "pattern": _pattern(rng), "element": "P1",
        },
        "fabric": {"areal_density": density, "tensile_stiffness": _short(stiffness)},
        "terms": [STVK],
        "pins": [{"where": "left"}, {"where": "right"}],
        "start": {
            "position": [f"{stretch} * X", "Y", "0"],
            "velocity": ["0", "0", f"{0.1 * speed:.3g} * sin(pi * X / {width})**3"],
        },
        "probes": [{"name": "middle", "point": [width / 2, height / 2]}],
        "time": _time("implicit_midpoint", 40, width / speed),
    }  # fmt: skip
    steps = {"time.dt": _short(width / speed / 300)}
    fine = steps | {"cloth.element": "P2", "cloth.h": _short(height / 3)}
    return _tried(rng, name, changes, ("path of middle.z",), fine)


def crumple(rng, name) -> Tried:
    """A sheet without bending whose held edges come together: its folds are as fine as the mesh."""
    width, height, size = _sizes(rng)
    closer = _draw(rng, 0.2, 0.4) * width
    changes = {
        "cloth": size | {"element": "P1", "h": _short(height / 6)},
        "fabric": _fabric(rng),
        "terms": [STVK, {"type": "MassDamping", "rate": 2.0}, WEIGHT],
        "pins": [
            {"where": "left"},
            {"where": "right", "motion": [f"-{closer:.4g} * t / 0.3", f"{closer:.3g} * t", "0"]},
        ],
        "probes": [{"name": "middle", "point": [width / 2, height / 2]}],
        "time": _time("bdf2", 60, 0.3),
    }
    steps = {"time.method": "bdf2", "time.dt": 0.3 / 100}
    fine = steps | {"cloth.h": _short(height / 10)}
    return _tried(rng, name, changes, ("middle", "path of middle"), fine)


KINDS: tuple[Callable[..., Tried], ...] = (
    pillow, banner, shelf, drawn, drop, fall, lash, swing, wave, crumple,
)  # fmt: skip


def _tried(rng, name, changes, quantities, fine) -> Tried:
    tolerance = float(rng.choice(TOLERANCES))
    more = {"output": None, "solver": None}
    file = f"{NEEDS}/taut.toml"
    return Tried(name, file, tolerance, more | changes, quantities, fine, ratio=1.5)


def _sizes(rng) -> tuple[float, float, dict]:
    """Return width and height [m], and the table of the cloth; the width is not the shorter."""
    height = _draw(rng, 0.2, 1.0)
    width = _short(height * _draw(rng, 1.0, 2.0))
    return width, height, {
        "shape": "rectangle", "width": width, "height": height, "pattern": _pattern(rng),
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


def _pattern(rng) -> str:
    return str(rng.choice(["right", "cross", "equilateral", "unstructured"]))


def _time(method: str, steps: int, t_end: float) -> dict:
    return {"method": method, "dt": _short(t_end / steps), "t_end": _short(t_end)}


def _draw(rng, low: float, high: float) -> float:
    return _short(rng.uniform(low, high))


def _short(value: float) -> float:
    return float(f"{value:.3g}")
