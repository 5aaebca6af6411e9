"""In-plane coordinates of a mesh whose nodes have three coordinates."""

import numpy as np

from fecloth.errors import MeshError


def flatten(xyz: np.ndarray, where: str) -> np.ndarray:
    """In-plane coordinates (n, 2) of points (n, 3) that lie in one plane."""
    extent = np.ptp(xyz, axis=0)
    allowed = 1e-9 * np.linalg.norm(extent)
    for normal_axis, plane_axes in ((2, [0, 1]), (1, [0, 2]), (0, [1, 2])):
        if extent[normal_axis] <= allowed:
            return np.ascontiguousarray(xyz[:, plane_axes])
    centred = xyz - xyz.mean(axis=0)
    normal = np.linalg.svd(np.linalg.qr(centred, mode="r"))[2][2]
    distance = np.abs(centred @ normal).max()
    if distance > allowed:
        what = f"a node is {distance:.3g} m away from the plane of the other nodes"
        remedy = "Use the flat reference shape, not the draped shape."
        raise MeshError(what, f"at most {allowed:.3g} m (1e-9 of the extent)", where, remedy)
    return xyz @ _frame(normal).T


def _frame(normal: np.ndarray) -> np.ndarray:
    """Two orthonormal axes (2, 3) in the plane."""
    # The sign of the normal is chosen so that the axes vary continuously from the axes of the
    # coordinate planes xy, xz and yz.
    signed = normal * (1.0, -1.0, 1.0)
    axis = next(i for i in (2, 1, 0) if abs(normal[i]) > 1e-6)
    normal = normal * np.sign(signed[axis])
    normal_is_x = np.linalg.norm(normal[1:]) < 1e-6
    first = np.eye(3)[1 if normal_is_x else 0]
    first = first - normal * (first @ normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])
