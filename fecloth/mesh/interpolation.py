"""Nodal fields at material points: location of a point in the mesh, and interpolation there."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from fecloth.errors import InputError, MeshError


def nodal_values(cloth, values) -> np.ndarray:
    """Return a nodal field (n,) or (n, d) as an array; raise `InputError` for other shapes."""
    values = np.asarray(values, dtype=float)
    if values.ndim not in (1, 2) or len(values) != len(cloth.X):
        allowed = f"must be ({len(cloth.X)},) or ({len(cloth.X)}, d)"
        raise InputError(f"a nodal field of shape {values.shape}", allowed, "Cloth")
    return values


def interpolator(cloth, points: np.ndarray) -> sparse.csr_matrix:
    """(p, n) matrix that evaluates a nodal field at material points (p, 2) [m]."""
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    cells = locate(cloth.X, cloth.triangles, points)
    basis = cloth.basis(1)
    local = basis.mapping.invF(points.T[:, :, None], tind=cells)
    values = [
        basis.elem.gbasis(basis.mapping, local, a, tind=cells)[0].ravel()
        for a in range(basis.Nbfun)
    ]
    columns = basis.element_dofs[:, cells]
    rows = np.broadcast_to(np.arange(len(points)), columns.shape)
    shape = (len(points), basis.N)
    return sparse.csr_matrix((np.ravel(values), (rows.ravel(), columns.ravel())), shape=shape)


def locate(X: np.ndarray, triangles: np.ndarray, points: np.ndarray, nearest: int = 12):
    """Find the triangle (p,) that contains each point (p, 2), or else the nearest triangle.

    scikit-fem's finder is not used because it rejects points outside a polygonal border.

    Parameters
    ----------
    nearest : int
        Number of triangles, by the distance of their centroids, that are searched first.
    """
    if not np.isfinite(points).all():
        bad = int(np.argmin(np.isfinite(points).all(axis=1)))
        what = f"material points[{bad}] = {points[bad].tolist()}"
        raise MeshError(what, "must be finite", "Cloth.interpolate")
    corners = X[triangles]
    nearest = min(nearest, len(triangles))
    _, candidates = cKDTree(corners.mean(axis=1)).query(points, nearest)
    candidates = candidates.reshape(len(points), nearest)
    depth = _depth(corners[candidates], points[:, None])
    best = np.argmax(depth, axis=1)
    cells, depth = candidates[np.arange(len(points)), best], depth.max(axis=1)
    # Search all triangles for points outside the mesh, and on graded meshes.
    for p in np.flatnonzero(depth < -1e-12):
        all_depths = _depth(corners, points[p])
        if all_depths.max() < 0:
            all_depths = -_distance(corners, points[p])
        cells[p], depth[p] = np.argmax(all_depths), all_depths.max()
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
    """Smallest signed distance [m] of points from the three edge lines, positive inside.

    `corners` (..., 3, 2) are counter-clockwise.
    """
    tail, head = corners, np.roll(corners, -1, axis=-2)
    edge = head - tail
    offset = points[..., None, :] - tail
    cross = edge[..., 0] * offset[..., 1] - edge[..., 1] * offset[..., 0]
    return (cross / np.linalg.norm(edge, axis=-1)).min(axis=-1)


def _distance(corners, point):
    """(m,) distance [m] of a point to the nearest edge of each triangle (m, 3, 2)."""
    edge = np.roll(corners, -1, axis=1) - corners
    offset = point - corners
    ratio = np.einsum("eai,eai->ea", offset, edge) / np.einsum("eai,eai->ea", edge, edge)
    foot = np.clip(ratio, 0.0, 1.0)[..., None] * edge
    return np.linalg.norm(offset - foot, axis=2).min(axis=1)
