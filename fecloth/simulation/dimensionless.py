"""Numbers of a cloth before its run: wave speed, weight over stiffness, reach, wrinkles."""

import math

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from fecloth.fabric.fabric import Fabric
from fecloth.system.system import System
from fecloth.terms import Gravity
from fecloth.terms.traits import has_kind


def wave_speed(fabric: Fabric) -> float:
    """Return the speed √(Y / ((1 − ν₁₂ ν₂₁) ρ)) of a stretching wave [m/s].

    It is that along the stiffer direction.
    """
    warp, weft = fabric.tensile
    across = 1 - fabric.poisson_ratio**2 * weft / warp
    return math.sqrt(max(warp, weft) / across / fabric.areal_density)


def swing_loss(angle: float) -> float:
    """Return the part of the amplitude that backward Euler removes in a period; angle = ω dt.

    Each step multiplies the amplitude by 1/√(1 + ω² dt²), and a period has 2π / (ω dt) steps.
    """
    return -math.expm1(-math.pi / angle * math.log1p(angle**2))


def gravity_magnitude(system: System) -> float:
    """Return the magnitude [m/s²] of the sum of all `Gravity` terms."""
    accelerations = [t.acceleration for t in system.terms if isinstance(t, Gravity)]
    if accelerations:
        return float(np.linalg.norm(np.sum(accelerations, axis=0)))
    return 0.0


def distance_from_pins(system: System) -> float:
    """Return the distance of the node farthest from the pins, in the flat cloth [m].

    It is 0 without pins.
    """
    pinned = system.constraints.nodes
    if not len(pinned):
        return 0.0
    distances, _ = cKDTree(system.cloth.X[pinned]).query(system.cloth.X)
    return float(distances.max())


def weight_over_stiffness(system: System) -> float:
    """Return ρ g L³/B, weight over bending stiffness [-]; 0 without one of them or a pin.

    L is the `unsupported_length`, B the smallest rigidity. At 8 the linear deflection of a
    cantilever is its length.
    """
    known = [min(fabric.bending) for fabric in system.panel.fabrics if fabric.bending]
    if not (known and has_kind(system.terms, "bending")):
        return 0.0
    weight = gravity_magnitude(system) * system.total_mass / system.cloth.area
    return weight * unsupported_length(system) ** 3 / min(known)


def unsupported_length(system: System) -> float:
    """Return the distance of the cloth from its pins [m], doubled if these are all around."""
    return distance_from_pins(system) * (1 + is_surrounded_by_pins(system))


def is_surrounded_by_pins(system: System) -> bool:
    """Return whether the mean of the nodes lies within the convex hull of the pins."""
    X = system.cloth.X
    try:
        hull = ConvexHull(X[system.constraints.nodes])
    except (QhullError, ValueError):  # pins on a line, or too few
        return False
    return bool((hull.equations @ [*X.mean(axis=0), 1.0] <= 1e-12).all())


def wrinkle_length(system: System) -> float:
    """Return the length λ = 2√π (B/T)^¼ √L of wrinkles under T = ρ g L [m].

    It is 0 without bending or weight. Source: Cerda and Mahadevan (2003), Geometry and Physics
    of Wrinkling, Phys. Rev. Lett. 90, 074302.
    """
    length = distance_from_pins(system)
    load = gravity_magnitude(system) * length * system.nodal_mass.sum() / system.cloth.area
    known = [max(fabric.bending) for fabric in system.panel.fabrics if fabric.bending]
    if not (load and known and has_kind(system.terms, "bending")):
        return 0.0
    return 2 * math.sqrt(math.pi) * (max(known) / load) ** 0.25 * math.sqrt(length)


def mean_edge(system: System) -> float:
    """Return the edge length [m] of equilateral triangles of the mean area."""
    return math.sqrt(4 / math.sqrt(3) * system.cloth.area / len(system.cloth.triangles))
