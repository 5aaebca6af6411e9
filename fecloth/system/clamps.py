"""The edges at which pins hold the normal of the cloth, and how these pins move them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.errors import InputError, amount
from fecloth.fabric.panel import Clamps
from fecloth.mesh.cloth import Cloth
from fecloth.system.constraints import Constraints, turn
from fecloth.system.pins import Pin
from fecloth.system.state import State


def find_clamps(constraints: Constraints, cloth: Cloth, start: State) -> Clamps | None:
    """The clamped edges of the pins, held as at the start; None without a clamped pin."""
    groups = [group for group in constraints.groups.values() if group[0].clamp]
    if not groups:
        return None
    clamped = [_ClampedGroup.find(pin, nodes, cloth, start.t) for pin, nodes in groups]
    half_edges = np.concatenate([group.half_edges for group in clamped])
    if not any(group.pin.moves for group in clamped):
        return Clamps(half_edges, start.x)
    ends = np.cumsum([len(group.half_edges) for group in clamped])

    def moved(points: np.ndarray, t: float) -> np.ndarray:
        parts = zip(clamped, np.split(points, ends[:-1]), strict=True)
        return np.concatenate([group.move(own_points, t) for group, own_points in parts])

    return Clamps(half_edges, start.x, moved)


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
        """Find the boundary edges whose nodes a pin holds; raise `InputError` without any."""
        edges = cloth.edge_slopes.edges
        triangles = edges.triangles
        ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        half_edges = np.flatnonzero((edges.hinge < 0) & np.isin(ends, nodes).all(axis=1))
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
        order = np.argsort(nodes)
        rows = order[np.searchsorted(nodes[order], ends[half_edges])]
        return cls(pin, half_edges, rows, start)

    def move(self, points: np.ndarray, t: float) -> np.ndarray:
        """Points (c, 3) of the start, one for each edge, at the time t."""
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
