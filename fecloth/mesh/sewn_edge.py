"""An edge of a cloth as a path of nodes, for a seam."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.errors import InputError, brief
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.selection import Where


@dataclass(frozen=True, eq=False)
class SewnEdge:
    """A part of the border of a cloth, from one end to the other.

    Attributes
    ----------
    where
        What selects it, as of `Seam`.
    nodes
        (k,) its nodes in order; of P2 every second one is the midpoint of an edge. Those of a
        closed border begin and end with the same node.
    half_edges
        (e,) its half-edges in order, see `Cloth.half_edges`.
    places
        (e + 1,) the part of its length at each corner, from 0 to 1.
    length
        Its length on the flat cloth [m]; of P2 by the chords between all nodes.
    """

    where: Where
    nodes: np.ndarray
    half_edges: np.ndarray
    places: np.ndarray
    length: float

    @classmethod
    def find(cls, cloth: Cloth, where: Where) -> Self:
        """Find the edge of a cloth that a set, or its nodes, name.

        It begins at its end of the lower X, or of the lower Y at the same X; a closed border
        begins at its node of the largest X, and goes around counter-clockwise. "front.left" is
        the set "front/left" of a cloth made of pieces. Raises `InputError` for edges that are
        inside the cloth, or no single path.
        """
        name = brief(where)
        known = where
        if isinstance(where, str) and where not in cloth.node_sets:
            slashed = where.replace(".", "/")
            known = slashed if slashed in cloth.node_sets else where
        half_edges, on_border = cloth.half_edges(known)
        if not on_border.all():
            raise InputError(f"edge {name} inside the cloth", "must be on its border", "Seam")
        triangle, corner = np.divmod(half_edges, 3)
        begin = cloth.triangles[triangle, corner].astype(np.int64)
        end = cloth.triangles[triangle, (corner + 1) % 3].astype(np.int64)
        order = _path(begin, end, cloth.X, name)
        half_edges, nodes = half_edges[order], np.append(begin[order], end[order[-1]])
        if cloth.element == "P2":
            middle = cloth.cells[triangle, 3 + corner][order]
            nodes = np.insert(nodes, np.arange(1, len(nodes)), middle)
        first, last = cloth.X[nodes[[0, -1]]]
        if tuple(last) < tuple(first):
            nodes, half_edges = nodes[::-1], half_edges[::-1]
        return cls._measure(where, nodes, half_edges, cloth)

    @classmethod
    def _measure(cls, where: Where, nodes: np.ndarray, half_edges, cloth: Cloth) -> Self:
        """The edge with its lengths."""
        chords = np.linalg.norm(np.diff(cloth.X[nodes], axis=0), axis=1)
        lengths = chords.reshape(len(half_edges), -1).sum(axis=1)
        total = float(lengths.sum())
        return cls(where, nodes, half_edges, np.append(0.0, np.cumsum(lengths) / total), total)

    def node_places(self) -> np.ndarray:
        """(k,) the part of its length at each node, also at midpoints of P2."""
        if len(self.nodes) == len(self.places):
            return self.places
        middle = (self.places[1:] + self.places[:-1]) / 2
        return np.insert(self.places, np.arange(1, len(self.places)), middle)

    def reversed(self) -> "SewnEdge":
        """The same edge from its other end."""
        backward = self.nodes[::-1], self.half_edges[::-1], 1.0 - self.places[::-1]
        return SewnEdge(self.where, *backward, self.length)


def _path(begin: np.ndarray, end: np.ndarray, X: np.ndarray, name: str) -> np.ndarray:
    """The order (e,) in which edges from nodes `begin` to `end` (e,) follow one another.

    Raises `InputError` if they are no single path.
    """
    edge_from = dict(zip(begin.tolist(), range(len(begin)), strict=True))
    starts = np.setdiff1d(begin, end)
    if not len(starts):  # closed
        starts = begin[[np.lexsort((X[begin, 1], -X[begin, 0]))[0]]]
    order = [edge_from[int(starts[0])]]
    while len(order) < len(begin):
        following = edge_from.get(int(end[order[-1]]))
        if following is None or following == order[0]:
            break
        order.append(following)
    if len(order) < len(begin) or len(edge_from) < len(begin):
        what = f"edge {name} in several parts"
        remedy = "Name each part by a set of its own, and sew it by a seam of its own."
        raise InputError(what, "must be one path along the border", "Seam", remedy)
    return np.array(order)
