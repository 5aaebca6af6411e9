"""How far points may move towards an obstacle: conservative advancement.

The distance that must be left is a fifth of the distance now, or of the gap if that is less.
For a convex shape the distance is a convex function of the way, so that it lies above its
tangent: the way to where the tangent has the least distance is safe (Newton's method from the
safe side, which converges quadratically). For other shapes the way s is safe where the
distance is at least L s. L is the slope of the distance there, times 1.5 as a reserve.
"""

import numpy as np

from fecloth.terms.contact.shape import Shape

# Part of the distance now, or of the gap if that is less, that a point must leave. Chosen: it
# must be > 0, as the barrier is infinite at the surface, and small enough to get on.
LEAST_PART_LEFT = 0.2
# The search for the way ends where the room is at most this part of the distance that must be
# left. Chosen: the way is then exact to a hundredth of the distance or of the gap.
ROOM_OVER_LEAST_DISTANCE = 0.05
MOST_ADVANCES = 40  # iterations of that search; then the way so far is taken, which is safe
# A straight way is looked at in so many parts for whether it is inside of a shape, and the part
# in which it enters is halved so often: the place is known to 1/2048 of the way.
PARTS_OF_WAY = 32
HALVINGS_OF_PART = 6
MOST_MOVES_OUT = 10  # iterations of Newton's method out of the way of a shape that deforms
# Over the slope of a distance that is not convex. Chosen: it may be steeper farther on.
SLOPE_RESERVE = 1.5


def advance(shape: Shape, y: np.ndarray, way: np.ndarray, t: float, gap: float) -> np.ndarray:
    """The part (m,) in [0, 1] of each way that its point may go and stay outside of a shape.

    Parameters
    ----------
    y
        The points (m, 3) [m], in the frame of the shape. A point inside may not move.
    way
        The ways (m, 3) [m], in that frame.
    t
        The time [s] for which the shape is taken.
    gap
        Distance [m] at which the barrier begins.
    """
    parts = np.ones(len(y))
    d = shape.distance(y, t)
    least = LEAST_PART_LEFT * np.minimum(d, gap)
    if shape.convex:
        going = np.flatnonzero(d - least < _lengths(way))
    else:
        going = np.arange(len(y))
    parts[going] = 0.0
    for _ in range(MOST_ADVANCES):
        if not len(going):
            break
        place = y[going] + parts[going, None] * way[going]
        room = shape.distance(place, t) - least[going]
        has_room = room > ROOM_OVER_LEAST_DISTANCE * least[going]
        going = going[has_room]
        approach = _bound_approach(shape, place[has_room], way[going], t)
        with np.errstate(divide="ignore"):
            parts[going] = np.minimum(1.0, parts[going] + room[has_room] / approach)
        going = going[parts[going] < 1.0]
    return parts


def _bound_approach(shape: Shape, place: np.ndarray, way: np.ndarray, t: float) -> np.ndarray:
    """(m,) by how much [m] the whole way brings a point nearer at most, seen from its place."""
    gradient = shape.gradient(place, t)
    if shape.convex:
        return np.maximum(-np.einsum("mi,mi->m", gradient, way), 0.0)
    return SLOPE_RESERVE * _lengths(gradient) * _lengths(way)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """(m,) lengths of vectors (m, 3)."""
    return np.sqrt(np.einsum("mi,mi->m", vectors, vectors))


def move_out(shape: Shape, y: np.ndarray, wanted: np.ndarray, t: float) -> np.ndarray:
    """Move points (n, 3) that are nearer than a distance `wanted` (n,) along its slope to it."""
    y = y.copy()
    for _ in range(MOST_MOVES_OUT):
        d = shape.distance(y, t)
        close = np.flatnonzero(d < wanted)
        if not len(close):
            break
        gradient = shape.gradient(y[close], t)
        part = (wanted - d)[close] / np.einsum("mi,mi->m", gradient, gradient)
        y[close] += part[:, None] * gradient
    return y


def goes_through(shape: Shape, a: np.ndarray, b: np.ndarray, t: float) -> np.ndarray:
    """Whether each straight way (m,) from a to b (m, 3) goes in and comes out behind the shape.

    Behind means that the normals where it enters and where it leaves are more than a right
    angle apart.
    """
    through = np.zeros(len(a), bool)
    way = b - a
    ways = np.arange(len(a))
    if shape.convex:
        ways = np.flatnonzero(shape.distance(a, t) + shape.distance(b, t) < _lengths(way))
    if not len(ways):
        return through
    parts = np.linspace(0.0, 1.0, PARTS_OF_WAY + 1)
    places = a[ways, None] + parts[:, None] * way[ways, None]
    d = shape.distance(places.reshape(-1, 3), t).reshape(len(ways), -1)
    enters = (d[:, :-1] > 0) & (d[:, 1:] <= 0)
    leaves = (d[:, :-1] <= 0) & (d[:, 1:] > 0)
    rows = np.flatnonzero(enters.any(axis=1) & leaves.any(axis=1))
    ways = ways[rows]
    entry = enters[rows].argmax(axis=1)
    exit_ = PARTS_OF_WAY - 1 - leaves[rows, ::-1].argmax(axis=1)
    begin = a[ways]
    there = way[ways]
    n_entry = _normals_at_surface(shape, begin, there, t, outside=entry, inside=entry + 1)
    n_exit = _normals_at_surface(shape, begin, there, t, outside=exit_ + 1, inside=exit_)
    through[ways] = np.einsum("mi,mi->m", n_entry, n_exit) < 0.0
    return through


def _normals_at_surface(
    shape: Shape,
    a: np.ndarray,
    way: np.ndarray,
    t: float,
    outside: np.ndarray,
    inside: np.ndarray,
) -> np.ndarray:
    """(m, 3) gradients of the distance where ways (m, 3) from a (m, 3) cross the surface.

    `outside` and `inside` (m,) are the ends of the part in which each does so, in numbers of
    the parts of a way. That part is halved again and again.
    """
    for _ in range(HALVINGS_OF_PART):
        middle = 0.5 * (inside + outside)
        is_outside = shape.distance(a + (middle / PARTS_OF_WAY)[:, None] * way, t) > 0
        inside = np.where(is_outside, inside, middle)
        outside = np.where(is_outside, middle, outside)
    return shape.gradient(a + (outside / PARTS_OF_WAY)[:, None] * way, t)
