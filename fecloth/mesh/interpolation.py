"""Where a material point lies in a mesh, also just outside it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from fecloth.errors import MeshError


def locate(X: np.ndarray, triangles: np.ndarray, points: np.ndarray, nearest: int = 12):
    """(p,) the triangle in which each point (p, 2) lies, or the nearest one.

    scikit-fem's finder refuses points outside a polygonal border.

    Raises
    ------
    MeshError
        For a point farther from its triangle than that one's longest edge.
    """
    if not np.isfinite(points).all():
        raise MeshError("material points must be finite", where="Cloth.interpolate")
    corners = X[triangles]
    nearest = min(nearest, len(triangles))
    _, candidates = cKDTree(corners.mean(axis=1)).query(points, nearest)
    candidates = candidates.reshape(len(points), nearest)
    depth = _depth(corners[candidates], points[:, None])
    best = np.argmax(depth, axis=1)
    cells, depth = candidates[np.arange(len(points)), best], depth.max(axis=1)
    for p in np.flatnonzero(depth < -1e-12):  # graded meshes, and points that lie outside
        everywhere = _depth(corners, points[p])
        if everywhere.max() < 0:
            everywhere = -_distance(corners, points[p])
        cells[p], depth[p] = np.argmax(everywhere), everywhere.max()
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    outside = np.flatnonzero(depth < -edges[cells])
    if outside.size:
        raise MeshError(
            f"{outside.size} of {len(points)} material points, first {points[outside[0]]} m",
            "must lie on the cloth",
            "Cloth.interpolate",
            f"The cloth spans {X.min(axis=0)} to {X.max(axis=0)} m.",
        )
    return cells


def _depth(corners, points):
    """Signed distance [m] of points inside the nearest edge line; corners (..., 3, 2)."""
    tail, head = corners, np.roll(corners, -1, axis=-2)
    along = head - tail
    to = points[..., None, :] - tail
    cross = along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]
    return (cross / np.linalg.norm(along, axis=-1)).min(axis=-1)


def _distance(corners, point):
    """(m,) distance [m] of a point to the nearest edge of each triangle (m, 3, 2)."""
    along = np.roll(corners, -1, axis=1) - corners
    to = point - corners
    share = np.einsum("eai,eai->ea", to, along) / np.einsum("eai,eai->ea", along, along)
    foot = np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(to - foot, axis=2).min(axis=1)
