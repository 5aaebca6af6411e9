"""Predict how much a change of a scene changes its motion, from its dimensionless numbers."""

import math

import numpy as np

from fecloth.errors import FeclothError
from fecloth.simulation.error_control import Adaptive
from fecloth.study.problem import StudyProblem
from fecloth.study.term_variants import Variant
from fecloth.terms import TRAITS, QuadraticBending
from studies.evidence.simplify.numbers import Numbers

FLAT = 1e-9  # of the size of a cloth: what is out of the plane by round-off


def predict_change(variant: Variant, numbers: Numbers) -> float | None:
    """Return the relative change of the motion by a variant, at most 1; None if unknown."""
    try:
        change = _predict_change(variant, numbers) if numbers.w else None
    except FeclothError:  # the coarser mesh or the network of springs is impossible
        change = None
    return None if change is None else min(1.0, change)


def _predict_change(variant: Variant, numbers: Numbers) -> float | None:
    dt, factor = numbers.built.dt or 0.0, variant.by
    match variant.kind:
        case "without":
            return _without(variant.by, numbers)
        case "cheaper":
            return _cheaper(variant.by, numbers)
        case "h":
            return abs(factor**2 - 1) * numbers.mesh_error() + _change_of_reach(variant, numbers)
        case "element":
            return numbers.mesh_error()
        case "dt":
            return abs(numbers.time_error(factor * dt) - numbers.time_error(dt))
        case "rtol":  # relative to the cloth's size, per second; global errors ∝ rtol^(2/3)
            rtol = numbers.scene.time.rtol or Adaptive.rtol
            change = abs(factor ** (2 / 3) - 1) * rtol * numbers.seconds / numbers.moved
            return change * numbers.rest
        case "method":
            if dt and numbers.steps_leave(dt) < 1:  # the full scene is damped, this one swings
                return numbers.rest
            return numbers.time_error(dt) if dt else None
        case "equilibrium":
            return numbers.rest
        case "load steps":  # unless there are several equilibria
            return 0.0
    return None


def _change_of_reach(variant: Variant, numbers: Numbers) -> float:
    """Return the change of the motion because the pins select other nodes on a coarser mesh."""
    # For example, ``inside = "X < 0.02"`` clamps another length of the cloth.
    other = Numbers.of(StudyProblem.of(numbers.scene).at(variant.values).source.scene)
    return abs(other.moved * other.L / (numbers.moved * numbers.L) - 1)


def _cheaper(other: str, numbers: Numbers) -> float:
    """Return the change by another term of the package in place of a membrane or bending term."""
    if TRAITS[other].kind == "membrane":
        return numbers.other_membrane()
    if other == QuadraticBending.__name__:  # 2 sin²(θ/2) for θ²/2 at the angle of the sharpest bend
        bend = numbers.h / numbers.L * (1.0 if numbers.case == "across" else numbers.N ** (1 / 3))
        return bend**2 / 12 * min(1.0, numbers.without_bending())
    return 0.3 * numbers.without_bending()  # hinges carry 0.8 to 1.33 of B, depending on the mesh


def _without(name: str, numbers: Numbers) -> float | None:
    kind = numbers.traits[name].kind
    if kind == "membrane":
        return 1.0
    if kind == "bending":
        return numbers.without_bending()
    if name in numbers.dampings and numbers.is_static:  # nothing moves
        return 0.0
    if name in numbers.dampings:
        fades = 1 - math.exp(-numbers.decay(name))
        others = sum(numbers.decay(other) for other in numbers.dampings if other != name)
        return fades * (math.exp(-others) if numbers.rest < 1 else 1.0)
    if name in numbers.loads and numbers.w:
        return numbers.loads[name] / numbers.w
    return None


def find_limits(numbers: Numbers) -> list[str]:
    """Return which assumptions of the predictions the scene does not fulfil, in words."""
    scene, built = numbers.scene, numbers.built
    x = built.start.x
    normals = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[1]
    known = {*numbers.dampings, *numbers.loads}
    known |= {n for n, traits in numbers.traits.items() if traits.kind in ("membrane", "bending")}
    other = sorted(numbers.traits.keys() - known)
    limits = {
        "no load acts at the start": not numbers.w,
        "nothing is pinned": not len(built.system.constraints.nodes),
        "pins move": any(pin.motion or pin.rotate for pin in scene.pins),
        "the cloth does not start flat": normals[2] > FLAT * normals[0],
        "it does not start at rest": bool(np.any(built.start.v)),
        "the first of several fabrics counts": len(built.system.panel.fabrics) > 1,
        f"no formula has {', '.join(other)}": bool(other),
    }
    return [words for words, is_so in limits.items() if is_so]
