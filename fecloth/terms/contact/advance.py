"""How far points may move towards an obstacle: conservative advancement.

The distance that must be left is a fifth of the distance now, or of the gap if that is less.
For a convex shape the distance is a convex function of the way, so that it lies above its
tangent: the way to where the tangent has the least distance is safe (Newton's method from the
safe side, which converges quadratically). For other shapes the way s is safe where the
distance is at least L s, with the slope L of the distance there, and half of it in reserve.
"""

import numpy as np

from fecloth.terms.contact.shape import Shape

LEFT = 0.2  # of the distance, or of the gap
CLOSE = 0.05  # of what must be left: the search for the way ends here
MOST = 40  # iterations; then the way so far is taken
PARTS = 32  # of a way, at which it is looked whether it is inside of a shape
HALVINGS = 6  # of these parts, to find the place where it enters
ITERATIONS = 10  # out of the way of a shape that deforms
RESERVE = 1.5  # on the slope of a distance that is not convex


def advance(shape: Shape, y: np.ndarray, way: np.ndarray, t: float, gap: float) -> np.ndarray:
    """The largest part (m,) in [0, 1] of each way (m, 3) that leaves its point y (m, 3) outside."""
    # Both are in the frame of the shape. A point inside may not move.
    parts = np.ones(len(y))
    d = shape.distance(y, t)
    least = LEFT * np.minimum(d, gap)
    length = np.sqrt(np.einsum("mi,mi->m", way, way))
    if shape.convex:
        some = np.flatnonzero(d - least < length)
    else:
        some = np.arange(len(y))
    parts[some] = 0.0
    for _ in range(MOST):
        if not len(some):
            break
        at = y[some] + parts[some, None] * way[some]
        room = shape.distance(at, t) - least[some]
        moves = room > CLOSE * least[some]
        some = some[moves]
        at = at[moves]
        room = room[moves]
        speed = _approach(shape, at, way[some], t)
        with np.errstate(divide="ignore"):
            parts[some] = np.minimum(1.0, parts[some] + room / speed)
        some = some[parts[some] < 1.0]
    return parts


def _approach(shape: Shape, at: np.ndarray, way: np.ndarray, t: float) -> np.ndarray:
    """(m,) how much of the distance the whole way takes at most, seen from these places."""
    gradient = shape.gradient(at, t)
    if shape.convex:
        return np.maximum(-np.einsum("mi,mi->m", gradient, way), 0.0)
    slope = RESERVE * np.sqrt(np.einsum("mi,mi->m", gradient, gradient))
    return slope * np.sqrt(np.einsum("mi,mi->m", way, way))


def move_out(shape: Shape, y: np.ndarray, wanted: np.ndarray, t: float) -> np.ndarray:
    """Points (n, 3) moved along the slope of the distance to the `wanted` one (n,), if nearer."""
    y = y.copy()
    for _ in range(ITERATIONS):
        d = shape.distance(y, t)
        close = np.flatnonzero(d < wanted)
        if not len(close):
            break
        gradient = shape.gradient(y[close], t)
        part = (wanted - d)[close] / np.einsum("mi,mi->m", gradient, gradient)
        y[close] += part[:, None] * gradient
    return y


def goes_through(shape: Shape, a: np.ndarray, b: np.ndarray, t: float) -> np.ndarray:
    """Whether each straight way (m,) from a to b (m, 3) enters the shape and leaves it behind."""
    # Behind means that the normals where it enters and leaves are more than a right angle apart.
    through = np.zeros(len(a), bool)
    way = b - a
    length = np.sqrt(np.einsum("mi,mi->m", way, way))
    some = np.arange(len(a))
    if shape.convex:
        some = np.flatnonzero(shape.distance(a, t) + shape.distance(b, t) < length)
    if not len(some):
        return through
    parts = np.linspace(0.0, 1.0, PARTS + 1)
    spots = a[some, None] + parts[:, None] * way[some, None]
    d = shape.distance(spots.reshape(-1, 3), t).reshape(len(some), -1)
    enters = (d[:, :-1] > 0) & (d[:, 1:] <= 0)
    leaves = (d[:, :-1] <= 0) & (d[:, 1:] > 0)
    rows = np.flatnonzero(enters.any(axis=1) & leaves.any(axis=1))
    some = some[rows]
    d = d[rows]
    first = enters[rows].argmax(axis=1)
    last = PARTS - 1 - leaves[rows, ::-1].argmax(axis=1)
    normals = []
    for part, outside in ((first, first), (last, last + 1)):
        inside = part + part + 1 - outside
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + outside)
            at = a[some] + (middle / PARTS)[:, None] * way[some]
            is_outside = shape.distance(at, t) > 0
            inside = np.where(is_outside, inside, middle)
            outside = np.where(is_outside, middle, outside)
        normals.append(shape.gradient(a[some] + (outside / PARTS)[:, None] * way[some], t))
    through[some] = np.einsum("mi,mi->m", *normals) < 0.0
    return through
