"""Numbers of a cloth before its run: wave speed, weight over stiffness, reach from the pins."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from fecloth.fabric.fabric import Fabric
from fecloth.system.system import System

BENDING = ("HingeBending", "QuadraticBending")


def wave_speed(fabric: Fabric) -> float:
    """√(Y / ((1 − ν₁₂ ν₂₁) ρ)) [m/s] along the stiffer direction: a wave that stretches it."""
    warp, weft = fabric.tensile
    across = 1 - fabric.poisson_ratio**2 * weft / warp
    return math.sqrt(max(warp, weft) / across / fabric.areal_density)


def swing_loss(angle: float) -> float:
    """Part of the amplitude that backward Euler takes in a period, with ω dt = angle.

    A step keeps 1/√(1 + ω² dt²), and a period has 2π / (ω dt) of them.
    """
    return -math.expm1(-math.pi / angle * math.log1p(angle**2))


def gravity(system: System) -> float:
    """|g| [m/s²] of all `Gravity` terms."""
    given = [t.acceleration for t in system.terms if type(t).__name__ == "Gravity"]
    return float(np.linalg.norm(np.sum(given, axis=0))) if given else 0.0


def hanging(system: System) -> float:
    """The distance on the cloth of the node farthest from the pins [m]; 0 where nothing holds."""
    held = system.constraints.nodes
    if not len(held):
        return 0.0
    distances, _ = cKDTree(system.cloth.X[held]).query(system.cloth.X)
    return float(distances.max())


def heaviness(system: System) -> float:
    """ρ g L³/B, weight over bending stiffness [-]; 0 where one of them or a pin is missing.

    L is the `reach`, B the least of the rigidities. With 8 a cantilever would sink by its
    length, were its deflection in proportion to the load.
    """
    known = [min(fabric.bending) for fabric in system.panel.fabrics if fabric.bending]
    if not (known and set(BENDING) & set(term_types(system))):
        return 0.0
    weight = gravity(system) * system.nodal_mass.sum() / system.cloth.area
    return weight * reach(system) ** 3 / min(known)


def reach(system: System) -> float:
    """How far the cloth reaches from its pins, twice that if they surround its middle [m]."""
    return hanging(system) * (1 + surrounded(system))


def surrounded(system: System) -> bool:
    """Whether the middle of the cloth, the mean of its nodes, lies within the pins' convex hull."""
    X = system.cloth.X
    try:
        hull = ConvexHull(X[system.constraints.nodes])
    except (QhullError, ValueError):  # pins on a line, or too few
        return False
    return bool((hull.equations @ [*X.mean(axis=0), 1.0] <= 1e-12).all())


def term_types(system: System) -> list[str]:
    """Return the class names of the system's terms."""
    return [type(term).__name__ for term in system.terms]
