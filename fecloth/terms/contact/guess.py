"""The first guess of a step: outside of all obstacles and free of crossings, for all contacts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Way:
    """The way of the nodes over a step, as one contact sees it: in the frame of its body."""

    contact: Any  # a `BoundContact`
    begin: np.ndarray  # (n, 3) positions at the begin of the step, in the frame [m]
    start: np.ndarray  # (n, 3) the same in space [m]
    t: float  # end of the step [s]

    def to_body(self, x: np.ndarray) -> np.ndarray:
        """Positions at the end of the step in the frame, from positions in space."""
        body = self.contact.body
        if body is None:
            return x
        return body.pose(self.t).to_body(x)

    @property
    def carried(self) -> np.ndarray:
        """(n, 3) Where the body has taken the nodes at the end of the step, in space [m]."""
        body = self.contact.body
        if body is None:
            return self.begin
        return body.pose(self.t).to_space(self.begin)

    def stop(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The part (n,) of its way to x that each node may go, and where (n, 3) it is then."""
        end = self.to_body(x)
        parts = self.contact.parts(self.begin, end, self.t)
        if (parts == 1.0).all():
            return parts, x
        at = self.begin + parts[:, None] * (end - self.begin)
        body = self.contact.body
        return parts, at if body is None else body.pose(self.t).to_space(at)

    def free_part(self, x: np.ndarray) -> float:
        """The largest part of the way to x that all nodes may go together."""
        return float(self.contact.free_part(self.begin, self.to_body(x), self.t))

    def allows(self, x: np.ndarray) -> bool:
        return bool(self.contact.allows(x, self.t))


def find_guess(
    ways: Sequence[Way], x: np.ndarray, hold: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray | None:
    """Positions (n, 3) near x that all contacts allow at the end of the step, or None.

    Each node goes towards x until the first obstacle stops it. Then all nodes together go the
    part of this way on which no triangle meets anything, from the place at the begin of the
    step, or from where a body that moves has taken the cloth. `hold` puts nodes back where
    pins hold them. The result does not depend on the order of the contacts.
    """
    places = x
    parts = np.ones(len(x))
    for way in ways:
        own, there = way.stop(x)
        if (own < parts).any():
            places = np.where((own < parts)[:, None], there, places)
        else:
            places = places
        parts = np.minimum(own, parts)
    part = min(way.free_part(places) for way in ways)
    moving = [way.carried for way in ways if way.contact.supplies]
    for base in [*moving, ways[0].start] if part < 1.0 or places is not x else ():
        moved = places if part == 1.0 else base + part * (places - base)
        guess = hold(moved)
        starts = base is ways[0].start
        # `part` is the free part of the way from where a body that moves has taken the cloth.
        is_free = len(ways) == 1 and not (moving and starts) and bool((guess == moved).all())
        if is_free or all(way.allows(guess) for way in ways):
            return guess
    return x if part == 1.0 and places is x else None
