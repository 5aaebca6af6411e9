"""Four meshes of the round specimen: two by Gmsh, and two patterns of a square made round."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fecloth as fc

SPECIMEN, SUPPORT = 0.15, 0.09  # radii of the specimen and of its support [m]
GEOMETRY = Path(__file__).parents[2] / "meshes" / "drape.geo"
MESHES = {  # pattern, and edge length relative to h
    "Gmsh": ("Gmsh", 1.0),
    "Gmsh, coarser": ("Gmsh", 4 / 3),
    "right": ("right", 1.0),
    "cross": ("cross", 4 / 3),
}
"""Their triangles are 4,852, 2,726, 5,000 and 6,400 at h = 6 mm."""


def mesh_specimen(pattern: str, h: float, element: str = "P1") -> fc.Cloth:
    """Mesh the specimen with edge length h [m]; its node set "support" lies on the disk."""
    if pattern == "Gmsh":
        return fc.Cloth.read(GEOMETRY, h=h, element=element)
    count = 10 * max(1, round(2 * SPECIMEN / h / 10))  # so that a ring of edges lies on the support
    square = fc.Cloth.rectangle(2.0, 2.0, h=2 / count, pattern=pattern)
    X = SPECIMEN * make_round(square.X - 1)
    support = np.flatnonzero(np.hypot(*X.T) < SUPPORT + 1e-9)
    return fc.Cloth.from_arrays(X, square.triangles, sets={"support": support}, element=element)


def make_round(points: np.ndarray) -> np.ndarray:
    """Map the square [−1, 1]² to the unit disk: squares around 0 become circles.

    The arc between two corners keeps the proportions of the side (P. Shirley and K. Chiu 1997, A
    low distortion map between disk and square, Journal of Graphics Tools 2).
    """
    x, y = points.T
    radius = np.maximum(abs(x), abs(y))
    long = np.where(radius > 0, radius, 1.0)
    near_x = np.pi / 4 * y / long + np.where(x < 0, np.pi - np.pi / 2 * y / long, 0)
    near_y = np.pi / 2 - np.pi / 4 * x / long
    near_y = np.where(y < 0, -near_y, near_y)
    angle = np.where(abs(x) >= abs(y), near_x, near_y)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
