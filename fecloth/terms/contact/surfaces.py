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
    points, triangles = _in_its_frame(shape, t, pose.to_body(place[None])[0], reach)
    return Triangles(pose.to_space(points), triangles)


def _in_its_frame(shape: Shape, t: float, place: np.ndarray, reach: float) -> Triangles:
    """The surface of a shape in its own frame, near a `place` (3,) in that frame."""
    if isinstance(shape, shapes.Sphere):
        return _turned(_arc(shape.radius, -1, 1), shape.center, (0.0, 0.0, 1.0))
    if isinstance(shape, shapes.Capsule):
        a = np.array(shape.a, float)
        b = np.array(shape.b, float)
        half = np.linalg.norm(b - a) / 2
        low = _arc(shape.radius, -1, 0) - [0, half]
        high = _arc(shape.radius, 0, 1) + [0, half]
        return _turned(np.vstack([low, high]), (a + b) / 2, b - a)
    if isinstance(shape, shapes.Cylinder):
        axis = np.array(shape.axis, float) / np.linalg.norm(shape.axis)
        middle = shape.point + ((place - shape.point) @ axis) * axis
        ends = [(shape.radius, -reach), (shape.radius, reach)]
        return _turned(np.array(ends), middle, axis)
    if isinstance(shape, shapes.Plane):
        normal = np.array(shape.normal, float) / np.linalg.norm(shape.normal)
        foot = place - ((place - shape.point) @ normal) * normal
        corners = foot + reach * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ _across(normal)
        return Triangles(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    if isinstance(shape, shapes.Box | shapes.Disk):  # triangles that share no point: sharp edges
        body = shape.skeleton(reach)
        corners = body.points[body.triangles].reshape(-1, 3)
        return Triangles(corners, np.arange(len(corners)).reshape(-1, 3))
    return _marched(shape, t, place, reach)


def _arc(radius: float, low: float, high: float) -> np.ndarray:
    """Points (r, z) of a circle around 0 from the angle low π/2 to high π/2."""
    angle = np.linspace(low, high, 1 + int(CORNERS_OF_CIRCLE / 4 * (high - low))) * math.pi / 2
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _across(axis: np.ndarray) -> np.ndarray:
    """(2, 3) unit vectors that make a right-handed frame with a unit vector as the third."""
    first = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


def _turned(profile: np.ndarray, middle, axis) -> Triangles:
    """A profile (k, 2) of (r, z) turned about an axis."""
    axis = np.array(axis, float) / np.linalg.norm(axis)
    corners = CORNERS_OF_CIRCLE
    angle = 2 * math.pi / corners * np.arange(corners)
    circle = np.column_stack([np.cos(angle), np.sin(angle)]) @ _across(axis)
    points = profile[:, 0, None, None] * circle + profile[:, 1, None, None] * axis
    i, j = np.meshgrid(np.arange(len(profile) - 1), np.arange(corners), indexing="ij")
    a = corners * i + j
    b = corners * i + (j + 1) % corners
    c = a + corners
    d = b + corners
    triangles = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    return Triangles(points.reshape(-1, 3) + np.array(middle, float), triangles)


# --- the surface of a formula ----------------------------------------------------------------


def _marched(shape: Shape, t: float, place: np.ndarray, reach: float) -> Triangles:
    """Where the distance is 0 in the cube of half the edge `reach` around a place."""
    n = CELLS_OF_GRID
    grid = np.indices((n + 1, n + 1, n + 1)).reshape(3, -1).T
    nodes = place + reach * (2 / n * grid - 1)
    cubes = _cubes(n)
    d = shape.distance(nodes, t)
    cut = cubes[(d[cubes].min(axis=1) < 0) & (d[cubes].max(axis=1) >= 0)]
    edges = _cut_edges(cut[:, TETRAHEDRA].reshape(-1, 4), d)
    ends, which = np.unique(np.sort(edges.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    part = d[ends[:, 0]] / (d[ends[:, 0]] - d[ends[:, 1]])
    points = nodes[ends[:, 0]] + part[:, None] * (nodes[ends[:, 1]] - nodes[ends[:, 0]])
    for _ in range(3):  # onto the surface, where the distance is not linear in a cube
        gradient = shape.slopes(points, t)[0]
        steep = np.maximum(np.einsum("pi,pi->p", gradient, gradient), 1e-12)
        away = np.clip(shape.distance(points, t) / steep, -reach / n, reach / n)
        points -= away[:, None] * gradient
    return _outwards(shape, t, points, which.reshape(-1, 3))


def _cubes(n: int) -> np.ndarray:
    """(n³, 8) numbers of the corners of each cube of a grid with n cells in each direction."""
    corner = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    corners = [
        corner[i : i + n, j : j + n, k : k + n] for i in (0, 1) for j in (0, 1) for k in (0, 1)
    ]
    return np.stack(corners, axis=-1).reshape(-1, 8)


def _cut_edges(tetrahedra: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(q, 3, 2) the edges on which the corners of each triangle lie."""
    inside = np.sort(np.where(d[tetrahedra] < 0, 0, 4) + np.arange(4), axis=1)
    count = (inside < 4).sum(axis=1)
    node = np.take_along_axis(tetrahedra, inside % 4, axis=1)  # corners inside first
    a, b, c, e = node.T
    pairs = {
        1: [((a, b), (a, c), (a, e))],
        2: [((a, c), (a, e), (b, e)), ((a, c), (b, e), (b, c))],
        3: [((a, e), (b, e), (c, e))],
    }
    edges = [
        np.array(triangle).transpose(2, 0, 1)[count == k]
        for k, triangles in pairs.items()
        for triangle in triangles
    ]
    return np.concatenate(edges)


def _outwards(shape: Shape, t: float, points: np.ndarray, triangles: np.ndarray) -> Triangles:
    """The triangles, each turned so that its normal points out of the shape."""
    if not len(triangles):
        return Triangles(points, triangles)
    a, b, c = points[triangles].transpose(1, 0, 2)
    out = shape.slopes((a + b + c) / 3, t)[0]
    turned = np.einsum("qi,qi->q", np.cross(b - a, c - a), out) < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return Triangles(points, triangles)
