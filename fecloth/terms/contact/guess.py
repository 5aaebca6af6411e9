"""The first guess of a step: outside of all obstacles, and without crossings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Way:
    """The way of the nodes over a step, as one contact sees it: in the frame of its body.

    Attributes
    ----------
    contact
        The `BoundContact`.
    begin
        Positions (n, 3) at the begin of the step, in the frame [m].
    start
        The same positions in space [m].
    t
        Time at the end of the step [s].
    """

    contact: Any
    begin: np.ndarray
    start: np.ndarray
    t: float

    def to_body(self, x: np.ndarray) -> np.ndarray:
        """Positions at the end of the step in the frame, from positions in space."""
        body = self.contact.body
        if body is None:
            return x
        return body.pose(self.t).to_body(x)

    @property
    def carried(self) -> np.ndarray:
        """Places (n, 3) in space [m] to which the body has carried the nodes over the step."""
        body = self.contact.body
        if body is None:
            return self.begin
        return body.pose(self.t).to_space(self.begin)

    def stop(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the part (n,) of its way to x that each node may go, and its place (n, 3) then.

        x (n, 3) and the places [m] are in space. If all nodes may go all of their way, x itself
        is returned, without round-off by the frame.
        """
        end = self.to_body(x)
        parts = self.contact.parts(self.begin, end, self.t)
        if (parts == 1.0).all():
            return parts, x
        places = self.begin + parts[:, None] * (end - self.begin)
        body = self.contact.body
        if body is None:
            return parts, places
        return parts, body.pose(self.t).to_space(places)

    def free_part(self, x: np.ndarray) -> float:
        """The largest part of the way to x that all nodes may go together."""
        return float(self.contact.free_part(self.begin, self.to_body(x), self.t))

    def allows(self, x: np.ndarray) -> bool:
        return bool(self.contact.allows(x, self.t))


def find_guess(
    ways: Sequence[Way], x: np.ndarray, hold: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray | None:
    """Return positions (n, 3) near x that all contacts allow at the end of the step, or None.

    First, each node goes towards x until the first obstacle stops it (`_stop_nodes`). Then all
    nodes together go the part of this way on which no triangle meets anything. This second way
    begins where a body that moves has carried the cloth, or else at the begin of the step. If the
    contacts allow neither, the body carries the cloth 1, 2 and 4 times as far. `hold` puts
    nodes back where pins hold them.
    """
    places = _stop_nodes(ways, x)
    part = min(way.free_part(places) for way in ways)
    if part == 1.0 and places is x:
        return x
    start = ways[0].start
    carried_places = [way.carried for way in ways if way.contact.supplies]
    tried = [places]
    if part < 1.0:
        tried = [origin + part * (places - origin) for origin in [*carried_places, start]]
    # Beside a held node the others must go farther than the body.
    tried += [start + f * (x - start) for f in (1.0, 2.0, 4.0) for x in carried_places]
    for moved in tried:
        guess = hold(moved)
        # A contact alone has found the first one free, where its body, if it moves, has carried
        # the cloth.
        is_free = len(ways) == 1 and moved is tried[0] and (guess == moved).all()
        if is_free or all(way.allows(guess) for way in ways):
            return guess
    return None


def _stop_nodes(ways: Sequence[Way], x: np.ndarray) -> np.ndarray:
    """Return the places (n, 3) where the first obstacle on its way to x stops each node.

    A node that no obstacle stops is at x. If none is stopped, x itself is returned.
    """
    places = x
    parts = np.ones(len(x))
    for way in ways:
        own_parts, own_places = way.stop(x)
        is_nearer = own_parts < parts
        if is_nearer.any():
            places = np.where(is_nearer[:, None], own_places, places)
        parts = np.minimum(own_parts, parts)
    return places
