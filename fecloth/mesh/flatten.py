"""A mesh in space laid flat: coordinates in the plane that it lies in."""

from __future__ import annotations

import numpy as np

from fecloth.errors import MeshError


def flattened(xyz: np.ndarray, where: str) -> np.ndarray:
    """In-plane coordinates (n, 2) of points (n, 3) that lie in a plane."""
    spread = np.ptp(xyz, axis=0)
    allowed = 1e-9 * np.linalg.norm(spread)
    for dropped, kept in ((2, [0, 1]), (1, [0, 2]), (0, [1, 2])):
        if spread[dropped] <= allowed:
            return np.ascontiguousarray(xyz[:, kept])
    centred = xyz - xyz.mean(axis=0)
    normal = np.linalg.svd(np.linalg.qr(centred, mode="r"))[2][2]
    distance = np.abs(centred @ normal).max()
    if distance > allowed:
        what = f"a node lies {distance:.3g} m off the plane of the others"
        remedy = "Give the flat reference shape, not the draped one."
        raise MeshError(what, f"at most {allowed:.3g} m (1e-9 of the extent)", where, remedy)
    return xyz @ _frame(normal).T


def _frame(normal: np.ndarray) -> np.ndarray:
    """Two orthonormal axes (2, 3) in the plane; seen as in xy, xz and yz for nearby planes."""
    towards = normal * (1.0, -1.0, 1.0)
    decisive = next(i for i in (2, 1, 0) if abs(normal[i]) > 1e-6)
    normal = normal * np.sign(towards[decisive])
    across = np.linalg.norm(normal[1:]) < 1e-6
    first = np.eye(3)[1 if across else 0]
    first = first - normal * (first @ normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])
