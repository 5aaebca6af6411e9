"""What the benchmarks share: a fabric, the folder of scenes, a square cloth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fecloth as fc

FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
SCENES = Path(__file__).parents[2] / "scenes"


def square(triangles: int, pattern: str = "unstructured") -> fc.Cloth:
    """Return a unit square of about that many triangles."""
    h = (1.52 if pattern == "unstructured" else np.sqrt(2)) / np.sqrt(triangles)
    return fc.Cloth.rectangle(1.0, 1.0, h=h, pattern=pattern)
