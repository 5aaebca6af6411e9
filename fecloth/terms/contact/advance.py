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
    """Return the part (m,) in [0, 1] of each way that its point may go outside of a shape.

    Each iteration takes a point on by a part of its way that is safe. It ends where the point
    can go all of its way, or where nearly no room is left before the least distance. After
    `MOST_ADVANCES` iterations the part so far is returned, which is safe, too.

    Parameters
    ----------
    y
        The points (m, 3) [m], in the frame of the shape. A point inside may not move: part 0.
    way
        The straight ways (m, 3) of the points [m], as displacements in that frame.
    t
        The time [s] for which the shape is taken.
    gap
        Distance [m] at which the barrier begins.
    """
    parts = np.ones(len(y))
    d = shape.distance(y, t)
    least_distance = LEAST_PART_LEFT * np.minimum(d, gap)
    if shape.convex:
        # The distance of a convex shape changes by no more than a point moves: where the way
        # is shorter than the room, all of it is free.
        moving_points = np.flatnonzero(d - least_distance < _lengths(way))
    else:
        moving_points = np.arange(len(y))
    parts[moving_points] = 0.0
    for _ in range(MOST_ADVANCES):
        if not len(moving_points):
            break
        places = y[moving_points] + parts[moving_points, None] * way[moving_points]
        room = shape.distance(places, t) - least_distance[moving_points]
        has_room = room > ROOM_OVER_LEAST_DISTANCE * least_distance[moving_points]
        moving_points = moving_points[has_room]
        approach = _bound_approach(shape, places[has_room], way[moving_points], t)
        # An approach of 0 means that all the rest of the way is free: room/0 = infinity.
        with np.errstate(divide="ignore"):
            added_parts = room[has_room] / approach
        parts[moving_points] = np.minimum(1.0, parts[moving_points] + added_parts)
        moving_points = moving_points[parts[moving_points] < 1.0]
    return parts


def _bound_approach(shape: Shape, places: np.ndarray, way: np.ndarray, t: float) -> np.ndarray:
    """Return a bound (m,) [m] on how much nearer to the shape the whole way brings each point.

    The points are now at `places` (m, 3), and the bound follows from the slope of the distance
    there.
    """
    gradient = shape.gradient(places, t)
    if shape.convex:  # the distance lies above its tangent
        return np.maximum(-np.einsum("mi,mi->m", gradient, way), 0.0)
    return SLOPE_RESERVE * _lengths(gradient) * _lengths(way)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """(m,) lengths of vectors (m, 3)."""
    return np.sqrt(np.einsum("mi,mi->m", vectors, vectors))


def move_out(shape: Shape, y: np.ndarray, wanted: np.ndarray, t: float) -> np.ndarray:
    """Return the points y (n, 3), moved to where their distance is at least `wanted` (n,) [m].

    Each point that is nearer is moved along the gradient of the distance, by steps of Newton's
    method. After `MOST_MOVES_OUT` steps a point may still be a little too near.
    """
    y = y.copy()
    for _ in range(MOST_MOVES_OUT):
        d = shape.distance(y, t)
        near_points = np.flatnonzero(d < wanted)
        if not len(near_points):
            break
        gradient = shape.gradient(y[near_points], t)
        # Newton's step along g = ∇d, from d + s |g|² = wanted.
        s = (wanted - d)[near_points] / np.einsum("mi,mi->m", gradient, gradient)
        y[near_points] += s[:, None] * gradient
    return y


def slope_at_surface(shape: Shape, y: np.ndarray, t: float) -> float:
    """Return |∇d| on the surface of a shape, where it is nearest to the points y (n, 3).

    It is 1 where d is a distance. The way to the surface is that of `move_out`, from the point
    with the least |d|/|∇d|. NaN where the gradient is zero.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        way = abs(shape.distance(y, t)) / _lengths(shape.gradient(y, t))
        place = y[np.argmin(way), None]
        for _ in range(MOST_MOVES_OUT):
            gradient = shape.gradient(place, t)
            place = place - shape.distance(place, t) / (gradient @ gradient.T) * gradient
        return float(_lengths(shape.gradient(place, t))[0])


def goes_through(shape: Shape, a: np.ndarray, b: np.ndarray, t: float) -> np.ndarray:
    """Return whether each straight way (m,) from a to b (m, 3) passes through the shape.

    Such a way enters the shape and leaves it behind: the normals at its first entry and at its
    last exit are more than a right angle apart. A way that ends inside does not pass through.
    The way is looked at in `PARTS_OF_WAY` parts: a shape between two of these places is missed.
    """
    is_through = np.zeros(len(a), bool)
    displacements = b - a
    ways = np.arange(len(a))
    if shape.convex:
        # The distance of a convex shape changes by no more than a point moves. So a way that is
        # not longer than the two distances together does not get inside.
        distances = shape.distance(a, t) + shape.distance(b, t)
        ways = np.flatnonzero(distances < _lengths(displacements))
    if not len(ways):
        return is_through
    parts = np.linspace(0.0, 1.0, PARTS_OF_WAY + 1)
    places = a[ways, None] + parts[:, None] * displacements[ways, None]
    d = shape.distance(places.reshape(-1, 3), t).reshape(len(ways), -1)
    enters = (d[:, :-1] > 0) & (d[:, 1:] <= 0)  # (ways, PARTS_OF_WAY): in which parts
    leaves = (d[:, :-1] <= 0) & (d[:, 1:] > 0)
    crossing_rows = np.flatnonzero(enters.any(axis=1) & leaves.any(axis=1))
    ways = ways[crossing_rows]
    first_entry = enters[crossing_rows].argmax(axis=1)
    # argmax finds the first True, so the parts are reversed to find the last exit.
    last_exit = PARTS_OF_WAY - 1 - leaves[crossing_rows, ::-1].argmax(axis=1)
    n_entry = _normals_at_surface(
        shape, a[ways], displacements[ways], t, outside=first_entry, inside=first_entry + 1
    )
    n_exit = _normals_at_surface(
        shape, a[ways], displacements[ways], t, outside=last_exit + 1, inside=last_exit
    )
    is_through[ways] = np.einsum("mi,mi->m", n_entry, n_exit) < 0.0
    return is_through


def _normals_at_surface(
    shape: Shape,
    a: np.ndarray,
    way: np.ndarray,
    t: float,
    outside: np.ndarray,
    inside: np.ndarray,
) -> np.ndarray:
    """Return the gradients (m, 3) of the distance where ways (m, 3) from a cross the surface.

    `outside` and `inside` (m,) are the two ends of the part of each way that crosses the
    surface, counted in parts of the way (0 … `PARTS_OF_WAY`). This part is halved again and
    again.
    """
    for _ in range(HALVINGS_OF_PART):
        middle = 0.5 * (inside + outside)
        is_outside = shape.distance(a + (middle / PARTS_OF_WAY)[:, None] * way, t) > 0
        inside = np.where(is_outside, inside, middle)
        outside = np.where(is_outside, middle, outside)
    return shape.gradient(a + (outside / PARTS_OF_WAY)[:, None] * way, t)
