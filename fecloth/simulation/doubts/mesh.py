"""Wrinkles of a cloth under its own weight, and whether the mesh is fine enough for them."""

from __future__ import annotations

import math

from fecloth.scene.dimensionless import distance_from_pins, gravity_magnitude
from fecloth.system.system import System
from fecloth.terms import TensionField
from fecloth.terms.traits import has_kind

RESOLVED = 4.0  # fewest edges per wrinkle
COMPRESSED = 0.1  # part of the area; where less is compressed, wrinkles do not matter


def wrinkle_length(system: System) -> float:
    """Length λ = 2√π (B/T)^¼ √L of wrinkles under T = ρ g L [m]; 0 without bending or weight.

    Cerda and Mahadevan (2003), Geometry and Physics of Wrinkling, Phys. Rev. Lett. 90, 074302.
    """
    length = distance_from_pins(system)
    load = gravity_magnitude(system) * length * system.nodal_mass.sum() / system.cloth.area
    known = [max(fabric.bending) for fabric in system.panel.fabrics if fabric.bending]
    if not (load and known and has_kind(system.terms, "bending")):
        return 0.0
    return 2 * math.sqrt(math.pi) * (max(known) / load) ** 0.25 * math.sqrt(length)


def mean_edge(system: System) -> float:
    """Edge length [m] of equilateral triangles of the mean area."""
    return math.sqrt(4 / math.sqrt(3) * system.cloth.area / len(system.cloth.triangles))


def wrinkle_warning(system: System, t: float, compressed: float) -> str:
    """Return a sentence if the mesh is too coarse for the wrinkles of a compressed cloth, or "".

    Parameters
    ----------
    compressed
        Part of the area that is compressed at t [s]; see `compressed_share`.
    """
    taut_only = any(isinstance(term, TensionField) for term in system.terms)
    if not compressed > COMPRESSED or taut_only:
        return ""
    where = (
        f"wrinkles finer than the mesh: {100 * compressed:.0f} % of the cloth is compressed at "
        f"t = {t:g} s"
    )
    if not has_kind(system.terms, "bending"):
        return (
            f"{where}, and without bending stiffness it folds at the size of the triangles; only "
            "taut regions converge. Add PlateBending, or use TensionField"
        )
    wave, edge = wrinkle_length(system), mean_edge(system)
    if not 0 < wave < RESOLVED * edge:
        return ""
    return (
        f"{where}, its wrinkles are about {wave:.2g} m long, and the edges {edge:.2g} m: the mesh "
        f"decides their shape; use h <= {wave / RESOLVED:.2g} m to resolve them"
    )
