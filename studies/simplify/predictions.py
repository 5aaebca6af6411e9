"""What each change of a scene is foretold to make of its motion, by its dimensionless numbers."""

from __future__ import annotations

import math

from fecloth.errors import FeclothError
from fecloth.scene.toml_text import to_toml
from fecloth.simulation.error_control import Adaptive
from studies.simplify.cases import data_of, scene_of
from studies.simplify.dimensionless import BENDING, DAMPINGS, MEMBRANES, Numbers
from studies.simplify.variants import Variant


def predicted(variant: Variant, of: Numbers) -> float | None:
    """The change of the motion that a variant should make, at most 1; None: not foretold."""
    try:
        found = _predicted(variant, of) if of.w else None
    except FeclothError:  # a coarser mesh, a network of springs that there cannot be
        found = None
    return None if found is None else min(1.0, found)


def _predicted(variant: Variant, of: Numbers) -> float | None:
    dt, factor = of.built.dt or 0.0, variant.by
    match variant.kind:
        case "without":
            return _without(variant.by, of)
        case "springs":
            return of.other_membrane()
        case "quadratic":  # 2 sin²(θ/2) for θ²/2 at the angle of the sharpest bend
            bend = of.h / of.L * (1.0 if of.case == "across" else of.N ** (1 / 3))
            return bend**2 / 12 * min(1.0, of.without_bending())
        case "mesh":
            return (factor**2 - 1) * of.mesh_error() + _reach(variant, of)
        case "P1":
            return of.mesh_error()
        case "dt":
            return abs(of.time_error(factor * dt) - of.time_error(dt))
        case "rtol":  # of the cloth's size in a second; global errors go as rtol^(2/3)
            rtol = of.scene.time.rtol or Adaptive.rtol
            return (factor ** (2 / 3) - 1) * rtol * of.seconds / of.moved * of.rest
        case "explicit":
            if dt and of.steps_leave(dt) < 1:  # the full scene does not swing, this one does
                return of.rest
            return of.time_error(dt) if dt else None
        case "static":
            return of.rest
    return None


def _reach(variant: Variant, of: Numbers) -> float:
    """How the motion changes as the pins take hold of other nodes, and the cloth reaches farther.

    On a coarser mesh ``inside = "X < 0.02"`` is another clamp.
    """
    other = Numbers.of(scene_of(to_toml(variant.apply(data_of(of.scene)))))
    return abs(other.moved * other.L / (of.moved * of.L) - 1)


def _without(name: str, of: Numbers) -> float | None:
    if name in MEMBRANES:
        return 1.0
    if name in BENDING:
        return of.without_bending()
    if name in DAMPINGS:
        fades = 1 - math.exp(-of.decay(name))
        others = sum(of.decay(other) for other in DAMPINGS if other != name)
        return fades * (math.exp(-others) if of.rest < 1 else 1.0)
    if name in of.loads and of.w:
        return of.loads[name] / of.w
    return None
