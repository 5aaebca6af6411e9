"""Nodes that start inside a shape, and how deep triangles may dip into it between its points."""

from collections.abc import Sequence

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.terms.contact.points import (
    MOST_DIP_OVER_GAP,
    MOST_PARTS,
    Points,
    divisions,
    longest_edges,
)
from fecloth.terms.contact.shape import Shape

ROUND_OFF = 1e-9  # of a dip over the dip that `divisions` allows
MOST_NAMED = 5  # nodes, or pairs of triangles, that an error names: more make no line


def refuse_inside(
    shape: Shape, kinds: Sequence[Points], gap: float, x: np.ndarray, t: float, where: str
) -> None:
    """Raise `InputError` if a point of a cloth at x (n, 3) is in the shape at the time t.

    The error names the deepest nodes inside, or says how many points inside triangles there
    are. `kinds` are the kinds of points, the nodes first; `where` names the term.
    """
    y = shape.pose(t).to_body(x)
    for points in kinds:
        point_numbers = points.candidates(shape.distance(y, t), gap)
        depth = -shape.distance(points.values(y, point_numbers), t)
        is_inside = depth >= 0.0
        if is_inside.any():
            deepest = f"{1e3 * depth.max():.3g} mm"
            what = f"{is_inside.sum()} points inside triangles, by up to {deepest},"
            nodes = None
            if points is kinds[0]:  # the error names nodes only, not points inside triangles
                nodes = point_numbers[is_inside]
            depth = depth[is_inside]
            raise starts_inside(shape, gap, where, nodes=nodes, depth=depth, what=what)


def starts_inside(
    shape: Shape,
    gap: float,
    where: str,
    nodes: np.ndarray | None = None,
    depth: np.ndarray | None = None,
    what: str = "the insides of some triangles",
) -> InputError:
    """Return the error for a cloth that starts inside a shape, for the caller to raise.

    It names the deepest of the `nodes` (k,), at most `MOST_NAMED`, with their `depth` (k,) [m].
    Without nodes, `what` says what starts inside. The remedy names the gap [m]; `where` is the
    name of the term.
    """
    if nodes is not None and depth is not None and len(nodes):
        deepest = np.argsort(-depth, kind="stable")[:MOST_NAMED]
        named = [f"{nodes[i]} ({1e3 * depth[i]:.3g} mm)" for i in deepest]
        if len(nodes) > MOST_NAMED:
            named.append("…")
        what = f"{len(nodes)} of the nodes, the deepest {', '.join(named)},"
    remedy = f"Start at least {1e3 * gap:g} mm, the gap, away from it, or move the obstacle."
    begin = f"{what} start inside the {type(shape).__name__}"
    return InputError(begin, "must start outside", where, remedy)


def cutting_depth(shape: Shape, gap: float, cloth: Cloth, stretch: float = 1.0) -> float:
    """Return how deep [m] a triangle may dip into the shape between its points.

    It is 0 where triangles dip in by no more than is allowed, `MOST_DIP_OVER_GAP`. `stretch` is
    that of the longest edges, as of a cloth that a fast ball hits: 1 at rest.
    """
    parts = min(divisions(shape, gap, cloth), MOST_PARTS)
    part = stretch * float(longest_edges(cloth).max()) / parts
    radius = shape.radius_of_curvature + gap
    depth = min(part**2 / (6 * radius), 0.5 * part)  # half of a part: at an edge of 90 degrees
    allowed = MOST_DIP_OVER_GAP * gap * (1 + ROUND_OFF)
    return depth if depth > allowed else 0.0
