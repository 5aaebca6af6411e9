"""Triangles of a shape's surface, for pictures and ParaView.

Round shapes are profiles turned about an axis. A plane and a cylinder have no end: as much is
drawn as lies within `reach` of a place. The surface of a formula is found by marching
tetrahedra: each cube of a grid has six tetrahedra, and each of these is cut in a triangle or
in two (Doi and Koide 1991, IEICE Trans. E74(1)).
"""

import math
from typing import NamedTuple

import numpy as np

from fecloth.terms.contact import shapes
from fecloth.terms.contact.shape import Shape

# Both are chosen, for pictures: nothing is computed with these triangles.
CORNERS_OF_CIRCLE = 48
CELLS_OF_GRID = 40  # in each direction, for a formula
# Tetrahedra of a cube, whose corner (i, j, k) has the number 4 i + 2 j + k.
# All have the edge from corner 0 to corner 7.
TETRAHEDRA = np.array(
    [
        [0, 7, 1, 3],
        [0, 7, 3, 2],
        [0, 7, 2, 6],
        [0, 7, 6, 4],
        [0, 7, 4, 5],
        [0, 7, 5, 1],
    ]
)


class Triangles(NamedTuple):
    """Points (p, 3) [m] and triangles (q, 3) of a surface."""

    points: np.ndarray
    triangles: np.ndarray


def surface_of(shape: Shape, t: float, place: np.ndarray, reach: float) -> Triangles:
    """The surface of a shape at the time t.

    Of an endless shape it is the part within `reach` [m] of `place` (3,) [m].
    """
    pose = shape.pose(t)
    place_in_frame = pose.to_body(place[None])[0]
    points, triangles = _surface_in_frame(shape, t, place_in_frame, reach)
    return Triangles(pose.to_space(points), triangles)


def _surface_in_frame(shape: Shape, t: float, place: np.ndarray, reach: float) -> Triangles:
    """Return the surface of a shape at the time t, with points in the frame of the shape.

    Of an endless shape, and of a formula, it is the part within `reach` [m] of `place` (3,),
    which is in that frame, too.
    """
    if isinstance(shape, shapes.Sphere):
        half_circle = _arc(shape.radius, from_quarter=-1, to_quarter=1)
        return _turn_profile(half_circle, middle=shape.center, axis=(0.0, 0.0, 1.0))
    if isinstance(shape, shapes.Capsule):
        a = np.array(shape.a, float)
        b = np.array(shape.b, float)
        half_length = np.linalg.norm(b - a) / 2
        lower_arc = _arc(shape.radius, from_quarter=-1, to_quarter=0) - [0, half_length]
        upper_arc = _arc(shape.radius, from_quarter=0, to_quarter=1) + [0, half_length]
        profile = np.vstack([lower_arc, upper_arc])
        return _turn_profile(profile, middle=(a + b) / 2, axis=b - a)
    if isinstance(shape, shapes.Cylinder):
        axis = np.array(shape.axis, float) / np.linalg.norm(shape.axis)
        nearest_on_axis = shape.point + ((place - shape.point) @ axis) * axis
        profile = np.array([(shape.radius, -reach), (shape.radius, reach)])
        return _turn_profile(profile, middle=nearest_on_axis, axis=axis)
    if isinstance(shape, shapes.Plane):
        normal = np.array(shape.normal, float) / np.linalg.norm(shape.normal)
        foot = place - ((place - shape.point) @ normal) * normal
        corners = foot + reach * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ _across(normal)
        return Triangles(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    if isinstance(shape, shapes.Box | shapes.Disk):
        body = shape.skeleton(reach)
        # Each triangle has points of its own: where they share points, pictures round the edges.
        corners = body.points[body.triangles].reshape(-1, 3)
        return Triangles(corners, np.arange(len(corners)).reshape(-1, 3))
    return _march_tetrahedra(shape, t, place, reach)


def _arc(radius: float, from_quarter: float, to_quarter: float) -> np.ndarray:
    """Return points (k, 2), as (r, z), of an arc around 0.

    It goes from the angle `from_quarter` π/2 to the angle `to_quarter` π/2.
    """
    sides = int(CORNERS_OF_CIRCLE / 4 * (to_quarter - from_quarter))
    angle = np.linspace(from_quarter, to_quarter, 1 + sides) * math.pi / 2
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _across(axis: np.ndarray) -> np.ndarray:
    """(2, 3) unit vectors that make a right-handed frame with a unit vector as the third."""
    first = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


def _turn_profile(profile: np.ndarray, middle, axis) -> Triangles:
    """Return the surface of revolution of a profile.

    The profile (k, 2) has the radius r and the height z of its points. The axis (3,) may have
    any length; it passes through the point `middle` (3,) with the height 0.
    """
    axis = np.array(axis, float) / np.linalg.norm(axis)
    corners = CORNERS_OF_CIRCLE
    angle = 2 * math.pi / corners * np.arange(corners)
    unit_circle = np.column_stack([np.cos(angle), np.sin(angle)]) @ _across(axis)
    points = profile[:, 0, None, None] * unit_circle + profile[:, 1, None, None] * axis
    # Point j of the circle i has the number corners × i + j. Each cell between two circles has
    # the points a and b on the lower circle, and c and d on the upper one.
    i, j = np.meshgrid(np.arange(len(profile) - 1), np.arange(corners), indexing="ij")
    a = corners * i + j
    b = corners * i + (j + 1) % corners
    c = a + corners
    d = b + corners
    triangles = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    return Triangles(points.reshape(-1, 3) + np.array(middle, float), triangles)


# --- the surface of a formula ----------------------------------------------------------------


def _march_tetrahedra(shape: Shape, t: float, place: np.ndarray, reach: float) -> Triangles:
    """Return the surface on which the distance from a shape is 0, by marching tetrahedra.

    It is the part in a cube around `place` (3,) with half the edge `reach` [m].
    """
    n = CELLS_OF_GRID
    grid = np.indices((n + 1, n + 1, n + 1)).reshape(3, -1).T
    nodes = place + reach * (2 / n * grid - 1)
    cubes = _cubes(n)
    d = shape.distance(nodes, t)
    is_cut = (d[cubes].min(axis=1) < 0) & (d[cubes].max(axis=1) >= 0)
    tetrahedra = cubes[is_cut][:, TETRAHEDRA].reshape(-1, 4)
    edges = np.sort(_cut_edges(tetrahedra, d).reshape(-1, 2), axis=1)
    # Triangles share a point where they lie on the same edge.
    ends, point_of_corner = np.unique(edges, axis=0, return_inverse=True)
    part = d[ends[:, 0]] / (d[ends[:, 0]] - d[ends[:, 1]])  # where d is 0, if it is linear
    points = nodes[ends[:, 0]] + part[:, None] * (nodes[ends[:, 1]] - nodes[ends[:, 0]])
    # Three steps of Newton's method along the gradient, each limited to half of a cell's edge,
    # take the points onto the surface where d is not linear. 1e-12 avoids a division by 0.
    for _ in range(3):
        gradient, _ = shape.slopes(points, t)
        squared_slope = np.maximum(np.einsum("pi,pi->p", gradient, gradient), 1e-12)
        step = np.clip(shape.distance(points, t) / squared_slope, -reach / n, reach / n)
        points -= step[:, None] * gradient
    return _outwards(shape, t, points, point_of_corner.reshape(-1, 3))


def _cubes(n: int) -> np.ndarray:
    """(n³, 8) numbers of the corners of each cube of a grid with n cells in each direction."""
    corner = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    corners = [
        corner[i : i + n, j : j + n, k : k + n] for i in (0, 1) for j in (0, 1) for k in (0, 1)
    ]
    return np.stack(corners, axis=-1).reshape(-1, 8)


def _cut_edges(tetrahedra: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return the edges (q, 3, 2) on which the three corners of each triangle of the surface lie.

    The surface cuts each of the `tetrahedra` (p, 4) in a triangle if 1 or 3 of its corners are
    inside (d < 0), and in two triangles if 2 are. `d` has the distances of all nodes.
    """
    # Corners have the numbers 0 … 3, and 4 more if they lie outside: sorted, the inner come first.
    sorted_corners = np.sort(np.where(d[tetrahedra] < 0, 0, 4) + np.arange(4), axis=1)
    inside_count = (sorted_corners < 4).sum(axis=1)
    nodes = np.take_along_axis(tetrahedra, sorted_corners % 4, axis=1)
    a, b, c, e = nodes.T
    triangles_by_count = {
        1: [((a, b), (a, c), (a, e))],
        2: [((a, c), (a, e), (b, e)), ((a, c), (b, e), (b, c))],
        3: [((a, e), (b, e), (c, e))],
    }
    edges = [
        np.array(triangle).transpose(2, 0, 1)[inside_count == count]
        for count, triangles in triangles_by_count.items()
        for triangle in triangles
    ]
    return np.concatenate(edges)


def _outwards(shape: Shape, t: float, points: np.ndarray, triangles: np.ndarray) -> Triangles:
    """Return the surface, with each triangle (q, 3) turned so that its normal points outwards.

    It changes the array `triangles`.
    """
    if not len(triangles):
        return Triangles(points, triangles)
    a, b, c = points[triangles].transpose(1, 0, 2)
    outward, _ = shape.slopes((a + b + c) / 3, t)
    is_inward = np.einsum("qi,qi->q", np.cross(b - a, c - a), outward) < 0
    triangles[is_inward] = triangles[is_inward][:, ::-1]
    return Triangles(points, triangles)
