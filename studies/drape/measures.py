"""What Cusick's test measures of a draped specimen: its shadow, and the folds along its rim."""

from __future__ import annotations

import math

import numpy as np

from studies.drape.meshes import SPECIMEN, SUPPORT

CELL = 5e-4  # size of the cells in which the area of the shadow is counted [m]


def shadow_area(x: np.ndarray, triangles: np.ndarray, support: float = 0.0) -> float:
    """Return the area that triangles cover, seen from above; overlaps count once [m²].

    What lies over the disk of radius `support` around 0 does not count.
    """
    corners = x[triangles, :2]
    count = math.ceil(2 * np.ptp(corners, axis=1).max() / CELL)
    i, j = np.nonzero(np.tri(count + 1)[::-1])  # points of each triangle, closer than the cells
    weights = np.stack([i, j, count - i - j], axis=1) / count
    cells = np.floor(weights @ corners / CELL).astype(int).reshape(-1, 2)
    cells = cells[np.hypot(*(cells.T + 0.5)) * CELL >= support]
    cells -= cells.min(axis=0)
    covered = np.zeros(cells.max(axis=0) + 1, bool)
    covered[*cells.T] = True
    return np.count_nonzero(covered) * CELL**2


def drape_coefficient(
    X: np.ndarray, x: np.ndarray, triangles: np.ndarray, support: float = SUPPORT
) -> float:
    """Return the shadow beside the support over the shadow of the flat mesh."""
    return shadow_area(x, triangles, support) / shadow_area(X, triangles, support)


def count_folds(X: np.ndarray, x: np.ndarray, rim: np.ndarray | None = None) -> int:
    """Count the crests of the rim, by default of `SPECIMEN`: its arcs above the mean height."""
    if rim is None:
        rim = np.flatnonzero(np.hypot(*X.T) > SPECIMEN - 1e-6)
    z = x[rim[np.argsort(np.arctan2(*X[rim].T))], 2]
    return int(np.sum((z > z.mean()) & (np.roll(z, 1) <= z.mean())))
