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
    """The clamped edges of the pins, held as they are at the start; None without a clamped pin."""
    groups = [group for group in constraints.groups.values() if group[0].clamp]
    if not groups:
        return None
    held = [_ClampedGroup.find(pin, nodes, cloth, start.t) for pin, nodes in groups]
    half_edges = np.concatenate([group.half_edges for group in held])
    if not any(group.pin.moves for group in held):
        return Clamps(half_edges, start.x)
    ends = np.cumsum([0] + [len(group.half_edges) for group in held])

    def moved(points: np.ndarray, t: float) -> np.ndarray:
        parts = zip(held, ends[:-1], ends[1:], strict=True)
        return np.concatenate([group.move(points[a:b], t) for group, a, b in parts])

    return Clamps(half_edges, start.x, moved)


@dataclass(frozen=True, eq=False)
class _ClampedGroup:
    """A clamped pin: its half-edges, their ends as rows of its nodes (c, 2), and the start time."""

    pin: Pin
    half_edges: np.ndarray
    ends: np.ndarray
    start: float

    @classmethod
    def find(cls, pin: Pin, nodes: np.ndarray, cloth: Cloth, start: float) -> Self:
        edges = cloth.edge_slopes.edges
        triangles = edges.triangles
        ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        half_edges = np.flatnonzero((edges.hinge < 0) & np.isin(ends, nodes).all(axis=1))
        if not len(half_edges):
            count = amount(len(nodes), "node")
            what = f"clamp = true on {count}{f' of {pin.where!r}' * isinstance(pin.where, str)}"
            allowed = "must cover an edge of the boundary: two neighbouring nodes of it"
            remedy = (
                "Pin more of the boundary, or leave the clamp out: inside a cloth pinned triangles "
                "hold the normal without it."
            )
            raise InputError(what, allowed, "Pin", remedy)
        order = np.argsort(nodes)
        return cls(pin, half_edges, order[np.searchsorted(nodes[order], ends[half_edges])], start)

    def move(self, points: np.ndarray, t: float) -> np.ndarray:
        """Points (c, 3) of the start, one for each edge, at the time t."""
        before, after = (self._displacement(time) for time in (self.start, t))
        if self.pin.rotate is None:
            return points + after - before
        return turn(self.pin, self.start, t, points, before, after)[0]

    def _displacement(self, t: float) -> np.ndarray:
        """(3,) or (c, 3) [m]; of an edge, the mean of its ends."""
        value = self.pin.displacement(t)
        if value.ndim == 2 and len(value) > 1:
            return value[self.ends].mean(axis=1)
        return value
