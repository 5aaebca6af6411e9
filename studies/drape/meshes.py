"""Four meshes of the round specimen: two by Gmsh, and two patterns of a square made round.

`PlateBending` takes the hanging ring alone, clamped at its inner edge. `HingeBending`, which has no
clamp, takes the whole disk with the nodes over the support pinned. (The plate on the disk would put
a part of the bend over the support into the first triangles inside.)
"""

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
"""At h = 6 mm the disks have 4,852, 2,742, 5,000 and 6,400 triangles."""


def mesh_specimen(pattern: str, h: float) -> fc.Cloth:
    """Mesh the specimen with edge length h [m]; its node set "support" lies on the disk."""
    if pattern == "Gmsh":
        return fc.Cloth.read(GEOMETRY, h=h)
    count = 10 * max(1, round(2 * SPECIMEN / h / 10))  # so that a ring of edges lies on the support
    square = fc.Cloth.rectangle(2.0, 2.0, h=2 / count, pattern=pattern)
    X = SPECIMEN * make_round(square.X - 1)
    support = np.flatnonzero(np.hypot(*X.T) < SUPPORT + 1e-9)
    return fc.Cloth.from_arrays(X, square.triangles, sets={"support": support})


def cut_ring(disk: fc.Cloth) -> fc.Cloth:
    """Return the hanging ring of a P1 mesh of the specimen; "support" is its inner edge."""
    hangs = np.hypot(*disk.X.T) > SUPPORT + 1e-9
    triangles = disk.triangles[hangs[disk.triangles].any(axis=1)]
    used, triangles = np.unique(triangles, return_inverse=True)
    support = np.flatnonzero(~hangs[used])
    return fc.Cloth.from_arrays(disk.X[used], triangles.reshape(-1, 3), {"support": support})


def make_quadratic(cloth: fc.Cloth) -> fc.Cloth:
    """Return the P2 cloth on the triangles of a P1 cloth with the node set "support"."""
    sets = {"support": cloth.nodes("support")}
    return fc.Cloth.from_arrays(cloth.X, cloth.triangles, sets, element="P2")


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
