"""Meshes with three coordinates that lie in one plane: how exactly they do, and their axes there.

It needs NumPy only, for a quick start of the process that reads files.
"""

import numpy as np

from fecloth.errors import MeshError

RELATIVE_ROUNDING = 1e-6  # of the extent: numbers with six digits, or of 32 bits
LARGEST_ROUNDING = 1e-4  # of the extent: a length along the plane is then wrong by 1e-8 of it


def rounding(points: np.ndarray) -> float:
    """Return the length [m] below which points (n, 2 or 3) of a file are at the same place.

    It is 1e-6 of the extent, or more where the numbers themselves are coarser: in a text of six
    decimals 1e-6, in 32 bits the distance of two numbers at the largest coordinate. It is at
    most 1e-4 of the extent.
    """
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    lengths = [RELATIVE_ROUNDING * extent]
    if np.array_equal(np.round(points, 6), points):
        lengths.append(1e-6)
    single = points.astype(np.float32)
    if np.array_equal(single, points):
        lengths.append(float(np.spacing(np.abs(single).max())))
    return min(max(lengths), LARGEST_ROUNDING * extent)


def flatten(xyz: np.ndarray, where: str) -> tuple[np.ndarray, float]:
    """Return in-plane coordinates (n, 2) of points (n, 3) [m] that lie in one plane.

    In the planes xy, xz and yz these are the two coordinates in that order; in another plane
    they are along the axes of `_frame`. The second value is the largest distance from the plane
    [m]. Raises `MeshError` if it is more than `rounding`.
    """
    extent = np.ptp(xyz, axis=0)
    allowed = rounding(xyz)
    for normal_axis, plane_axes in ((2, [0, 1]), (1, [0, 2]), (0, [1, 2])):
        if extent[normal_axis] <= allowed:
            return np.ascontiguousarray(xyz[:, plane_axes]), float(extent[normal_axis])
    centred = xyz - xyz.mean(axis=0)
    # The normal is the direction of least extent, the last right singular vector. R of the QR
    # decomposition has the same right singular vectors, but only three rows.
    normal = np.linalg.svd(np.linalg.qr(centred, mode="r"))[2][2]
    distance = float(np.abs(centred @ normal).max())
    if distance > allowed:
        what = f"a node is {distance:.3g} m away from the plane of the other nodes"
        limit = f"at most {allowed:.3g} m (1e-6 of the extent, or the rounding of the file)"
        remedy = "Use the flat reference shape, not the draped shape."
        raise MeshError(what, limit, where, remedy)
    return xyz @ _frame(normal).T, distance


def _frame(normal: np.ndarray) -> np.ndarray:
    """Return two orthonormal axes (2, 3) in the plane with this unit normal (3,).

    The first axis is the projection of the x axis, or of the y axis if the plane is normal to
    x. The sign of the normal is chosen so that the axes vary continuously from the axes of the
    coordinate planes xy, xz and yz.
    """
    last_axis = max(i for i in range(3) if abs(normal[i]) > 1e-6)
    sign = (1.0, -1.0, 1.0)[last_axis]  # the planes yz, xz, xy have the normals x, −y, z
    normal = normal * np.sign(sign * normal[last_axis])
    is_along_x = np.linalg.norm(normal[1:]) < 1e-6
    first = np.eye(3)[1 if is_along_x else 0]
    first = first - normal * (first @ normal)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])
