"""The edges at which pins hold the normal of the cloth, and how these pins turn them."""

import numpy as np

from fecloth.errors import InputError, amount
from fecloth.fabric.panel import Clamps
from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints
from fecloth.system.pins import Pin, Slide
from fecloth.system.state import State

# Where the points of held planes are, over the extent of the cloth. A motion of the edge by that
# extent changes their direction by 1e-9 only, so no motion but a turn need move them, and the
# moment of a clamp is a couple.
FAR = 1e9
LEAST_ASIDE = 1e-3  # sine of the angle from a plane of symmetry at which cloth leaves it


def find_clamps(constraints: Constraints, cloth: Cloth, start: State) -> Clamps | None:
    """Return the clamped edges of all pins, with their normals as in the state `start`.

    None without a clamped pin. Raises `InputError` for a clamped pin without a boundary edge, and
    for cloth that lies in the plane of a slide.
    """
    groups = [group for group in constraints.groups.values() if group[0].clamp]
    if not groups:
        return None
    pins, edges, points = [], [np.zeros(0, np.int64)], []
    size = FAR * np.ptp(start.x, axis=0).max()
    for pin, nodes in groups:
        half_edges = np.setdiff1d(_edges_of(pin, nodes, cloth), np.concatenate(edges))
        pins.append(pin)
        edges.append(half_edges)
        points.append(_far_points(pin, half_edges, cloth, start.x, size))
    if all(pin.rotate is None for pin in pins):
        return Clamps(np.concatenate(edges), np.concatenate(points))
    ends = np.cumsum([len(own) for own in points])[:-1]

    def moved(points: np.ndarray, t: float) -> np.ndarray:
        parts = zip(pins, np.split(points, ends), strict=True)
        return np.concatenate([_turned(pin, own, start.t, t) for pin, own in parts])

    return Clamps(np.concatenate(edges), np.concatenate(points), moved)


def _edges_of(pin: Pin, nodes: np.ndarray, cloth: Cloth) -> np.ndarray:
    """Return the half-edges (c,) of the boundary both of whose ends are `nodes` (k,) of a pin.

    Raises `InputError` if there is none.
    """
    edges = cloth.edge_slopes.edges
    triangles = edges.triangles
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    is_boundary = edges.hinge < 0  # no hinge: one triangle alone has the edge
    half_edges = np.flatnonzero(is_boundary & np.isin(ends, nodes).all(axis=1))
    if not len(half_edges):
        what = f"clamp = true on {amount(len(nodes), 'node')}"
        if isinstance(pin.where, str):
            what += f" of {pin.where!r}"
        allowed = "must cover an edge of the boundary: two neighbouring nodes of it"
        remedy = (
            "Pin more of the boundary, or leave the clamp out: inside a cloth pinned "
            "triangles hold the normal without it."
        )
        raise InputError(what, allowed, "Pin", remedy)
    return half_edges


def _far_points(
    pin: Pin, half_edges: np.ndarray, cloth: Cloth, x: np.ndarray, far: float
) -> np.ndarray:
    """Return a point (c, 3) of each held plane, at the distance `far` from its edge [m].

    The plane goes on with the triangle at the positions x (n, 3), away from it. At a slide in a
    plane it is across that one, so that the cloth is beside its mirror image. Raises `InputError`
    where the cloth lies in the plane of a slide.
    """
    triangle, edge = np.divmod(half_edges, 3)
    corner = (edge[:, None] + (0, 1, 2)) % 3
    a, b, apex = np.moveaxis(x[cloth.edge_slopes.edges.triangles[triangle[:, None], corner]], 1, 0)
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    away = a - apex
    away -= np.sum(away * along, axis=1, keepdims=True) * along
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    if isinstance(pin, Slide) and pin.normal is not None:
        aside = away @ pin.axis
        if np.abs(aside).min(initial=1.0) < LEAST_ASIDE:
            what = f"clamp = true on {pin.where!r}, where the cloth lies in the plane"
            remedy = "Leave the clamp out: the slide holds the cloth in its plane."
            raise InputError(what, "holds a right angle to the plane", "Slide", remedy)
        away = np.sign(aside)[:, None] * pin.axis
    return (a + b) / 2 + far * away


def _turned(pin: Pin, points: np.ndarray, start: float, t: float) -> np.ndarray:
    """Return where points (c, 3) of the time `start` are at the time t, if a pin turns them [m]."""
    rotation = pin.rotate
    if rotation is None:
        return points
    turned: np.ndarray = (
        rotation.point + (points - rotation.point) @ rotation.matrix(t, since=start).T
    )
    return turned
