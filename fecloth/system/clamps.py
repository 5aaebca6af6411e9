"""The edges at which pins hold the normal of the cloth, and how these pins move them."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fecloth.errors import InputError, amount
from fecloth.fabric.panel import Clamps
from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints, turn
from fecloth.system.pins import Pin, Slide
from fecloth.system.state import State

# Where the points of held planes are, over the extent of the cloth: their direction from an edge
# then changes by 1e-9 where the edge moves by that extent, and a moment on one is a couple.
FAR = 1e9
LEAST_ASIDE = 1e-3  # sine of the angle from a plane of symmetry at which cloth leaves it


def find_clamps(constraints: Constraints, cloth: Cloth, start: State) -> Clamps | None:
    """Return the clamped edges of all pins, with their normals as in the state `start`.

    None without a clamped pin. Raises `InputError` for a clamped pin without a boundary edge.
    """
    groups = [group for group in constraints.groups.values() if group[0].clamp]
    if not groups:
        return None
    clamped: list[_ClampedGroup] = []
    half_edges = np.zeros(0, np.int64)
    size = FAR * np.ptp(start.x, axis=0).max()
    for pin, nodes in groups:
        group = _ClampedGroup.find(pin, nodes, cloth, start.t).leave_out(half_edges)
        clamped.append(group)
        half_edges = np.concatenate([half_edges, group.half_edges])
    points = np.concatenate([group.far_points(cloth, start.x, size) for group in clamped])
    if not any(group.pin.moves for group in clamped):
        return Clamps(half_edges, points)
    ends_of_groups = np.cumsum([len(group.half_edges) for group in clamped])

    def moved(points: np.ndarray, t: float) -> np.ndarray:
        points_of_groups = np.split(points, ends_of_groups[:-1])
        pairs = zip(clamped, points_of_groups, strict=True)
        return np.concatenate([group.move(own_points, t) for group, own_points in pairs])

    return Clamps(half_edges, points, moved)


@dataclass(frozen=True, eq=False)
class _ClampedGroup:
    """A clamped pin and the edges that it holds.

    Attributes
    ----------
    pin
        The pin.
    half_edges
        (c,) its half-edges.
    ends
        (c, 2) their ends, as rows of its nodes.
    start
        The time of the start [s].
    """

    pin: Pin
    half_edges: np.ndarray
    ends: np.ndarray
    start: float

    @classmethod
    def find(cls, pin: Pin, nodes: np.ndarray, cloth: Cloth, start: float) -> Self:
        """Find the boundary edges both of whose ends are among the `nodes` (k,) of a pin.

        `start` is the time of the start [s]. Raises `InputError` if there is no such edge.
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
        order = np.argsort(nodes)  # the pin's motion has a row for each node, in any order
        rows = order[np.searchsorted(nodes[order], ends[half_edges])]
        return cls(pin, half_edges, rows, start)

    def leave_out(self, half_edges: np.ndarray) -> Self:
        """Return the group without the half-edges that another pin holds already."""
        is_new = ~np.isin(self.half_edges, half_edges)
        return replace(self, half_edges=self.half_edges[is_new], ends=self.ends[is_new])

    def far_points(self, cloth: Cloth, x: np.ndarray, far: float) -> np.ndarray:
        """(c, 3) a point of each held plane, at the distance `far` from the edge [m].

        The plane goes on with the triangle at the positions x (n, 3), away from it. At a slide in
        a plane it is across that one, so that the cloth is beside its mirror image. Raises
        `InputError` where the cloth lies in the plane of a slide.
        """
        triangle, edge = np.divmod(self.half_edges, 3)
        corners = cloth.edge_slopes.edges.triangles[
            triangle[:, None], (edge[:, None] + (0, 1, 2)) % 3
        ]
        a, b, apex = np.moveaxis(x[corners], 1, 0)
        along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
        away = a - apex
        away -= np.sum(away * along, axis=1, keepdims=True) * along
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        if isinstance(self.pin, Slide) and self.pin.normal is not None:
            aside = away @ self.pin.axis
            if np.abs(aside).min() < LEAST_ASIDE:
                what = f"clamp = true on {self.pin.where!r}, where the cloth lies in the plane"
                remedy = "Leave the clamp out: the slide holds the cloth in its plane."
                raise InputError(what, "holds a right angle to the plane", "Slide", remedy)
            away = np.sign(aside)[:, None] * self.pin.axis
        return (a + b) / 2 + far * away

    def move(self, points: np.ndarray, t: float) -> np.ndarray:
        """Return where points (c, 3) of the start, one for each edge, are at the time t [m]."""
        before = self._displacement(self.start)
        after = self._displacement(t)
        if self.pin.rotate is None:
            return points + after - before
        turned, _ = turn(self.pin, self.start, t, points, before, after)
        return turned

    def _displacement(self, t: float) -> np.ndarray:
        """(3,) or (c, 3) [m]; of an edge, the mean of its ends."""
        value = self.pin.displacement(t)
        if value.ndim == 2 and len(value) > 1:
            return value[self.ends].mean(axis=1)
        return value
