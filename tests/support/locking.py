"""A thin strip hangs as the heavy elastica, by element, pattern and thinness.

A strip of length L is clamped level at one end and hangs under its weight with Γ = ρ g L³/B = 10
and ν = 0. Its drop over its reach is compared with the drop over reach of the inextensible
elastica. The elements have the same nodes: n spacings along, so P2 has n/2 edges.
"""

from __future__ import annotations

from functools import cache

import numpy as np

import fecloth as fc
from studies.bending.meshes import rectangle
from studies.references.elastica import heavy_elastica

GAMMA = 10.0
PATTERNS = ("right", "cross", "equilateral", "unstructured", "jittered")
MODELS = {"P1": "P1", "P2, pointwise strain": "P2", "P2, interpolated strain": "P2"}
LOCAL = "P2, interpolated strain"  # that does not lock
LIMITS = {16: 3e-3, 32: 8e-4}  # of its |error|, at 1e6 and 1e7

curve = cache(heavy_elastica)


def strip(pattern: str, n: int, element: str, width: float = 0.5) -> fc.Cloth:
    """A strip of length 1 with n nodes along it."""
    return rectangle(1.0, width, 1 / n if element == "P1" else 2 / n, pattern, element)


def hang(model: str, pattern: str, ratio: float, n: int, width: float = 0.5) -> float:
    """Return the relative error of drop over reach of the free end; `ratio` is Y L²/B.

    The iteration starts at the nodes of the exact curve: from flat it does not end at R = 1e7.
    """
    s, reach, drop = curve(GAMMA)
    cloth = strip(pattern, n, MODELS[model], width)
    membrane = fc.StVK(strain="pointwise" if "pointwise" in model else "interpolated")
    terms = [membrane, fc.PlateBending(), fc.Gravity((0, 0, -GAMMA))]
    fabric = fc.Fabric(1.0, ratio, bending_rigidity=1.0)
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    along, z = (np.interp(cloth.X[:, 0], s, of) for of in (reach, -drop))
    start = system.state(np.column_stack([along, cloth.X[:, 1], z]))
    hung = fc.equilibrium(system, start, tolerance=max(1e-8, 2e-15 * ratio))
    tip = hung.x[cloth.nodes("right")].mean(axis=0)
    return -tip[2] / tip[0] / (drop[-1] / reach[-1]) - 1
