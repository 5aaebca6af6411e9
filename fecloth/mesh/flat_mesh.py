"""A flat triangle mesh with named sets, and the validation of plain arrays."""

import re
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fecloth.errors import MeshError, amount
from fecloth.mesh.indices import MAX_LISTED, validated_indices
from fecloth.mesh.planes import flatten, rounding
from fecloth.validation import FARTHEST


@dataclass(frozen=True, eq=False)
class FlatMesh:
    """A flat triangle mesh with named sets.

    Attributes
    ----------
    X
        (n, 2) node coordinates [m].
    triangles
        (m, 3) node indices of each triangle, all counter-clockwise.
    node_sets
        Name of each set to its sorted unique node indices.
    edge_sets
        Name of each curve to the (k, 2) node pairs of its edges, lower index first.
    triangle_sets
        Name of each region to its sorted unique triangle indices.
    start
        (n, 3) positions in space [m] that a file has beside the flat coordinates, or None.
    element
        The element that a file is written in, "P1" or "P2".
    notes
        What was changed or chosen, a sentence each.
    """

    X: np.ndarray
    triangles: np.ndarray
    node_sets: dict[str, np.ndarray]
    edge_sets: dict[str, np.ndarray]
    triangle_sets: dict[str, np.ndarray] = field(default_factory=dict)
    start: np.ndarray | None = None
    element: str = "P1"
    notes: tuple[str, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        X,
        triangles,
        node_sets=None,
        edge_sets=None,
        where="",
        node_ids=None,
        triangle_ids=None,
        triangle_sets=None,
    ) -> Self:
        """Validate plain arrays and return a mesh whose triangles are all counter-clockwise.

        Clockwise triangles are turned; other errors in the arrays are reported and not
        repaired. The node and edge sets ``boundary`` (the edges of only one
        triangle) are added unless sets of this name exist. An edge set without a node set of the
        same name gets one.

        Raises `MeshError` for coordinates that are not finite or not in a plane, indices out
        of range, repeated vertices, zero-area, duplicate, overlapping or unconnected triangles,
        an edge of more than two triangles, unused or coincident nodes, a node in the middle of
        an edge, empty sets, and sets with pairs that are no edge.

        Parameters
        ----------
        X : (n, 2) or (n, 3) array
            Coordinates [m]. Points with three coordinates must lie in a plane, to the rounding
            of their numbers (`fecloth.mesh.planes.rounding`). In the planes xy, xz and yz those
            two coordinates are used. Any other plane gets an orthonormal frame, whose first axis
            is the projection of the global x axis, or of the y axis if the plane is normal to x.
        triangles : (m, 3) integer array
            Node indices.
        node_sets, triangle_sets : dict of str to (k,) integer arrays, optional
            Named nodes and triangles.
        edge_sets : dict of str to (k, 2) integer arrays, optional
            Named curves, by the nodes at the ends of their edges.
        where : str
            The file or function, for messages.
        node_ids, triangle_ids : (n,) and (m,) integer arrays, optional
            Numbers that messages name in place of the indices.
        """
        X, triangles = _arrays(X, triangles, where)
        n = len(X)
        m = len(triangles)
        if node_ids is None:
            node_ids = np.arange(n)
        if triangle_ids is None:
            triangle_ids = np.arange(m)
        source = _Source(where, np.asarray(node_ids), np.asarray(triangle_ids))
        infinite = np.flatnonzero(~np.isfinite(X).all(axis=1))
        source.check_no_nodes(infinite, "nodes with non-finite coordinates", remedy="Correct them.")
        far_away = np.flatnonzero((np.abs(X) > FARTHEST).any(axis=1))
        limit = f"coordinates must be at most {FARTHEST:g} m"
        remedy = "Is the file in another unit?"
        source.check_no_nodes(far_away, "nodes too far away", limit, remedy)
        _check_vertices(triangles, n, source)
        notes = []
        if X.shape[1] == 3:
            extent = np.linalg.norm(np.ptp(X, axis=0))
            X, distance = flatten(X, where)
            if distance > 1e-9 * extent:  # more than the round-off of a rotation
                notes.append(f"nodes up to {distance:.2g} m away from their plane moved into it")
        _check_nodes(X, triangles, source)
        triangles, turned = _orient(X, triangles.astype(np.int32), source)
        if turned:
            notes.append(f"{turned} of {amount(m, 'triangle')} turned, to be counter-clockwise")
        _check_duplicates(triangles, source)
        keys, boundary, opposite, pieces = _check_edges(triangles, n, source)
        _check_hanging(X, boundary, opposite, source)
        _check_connected(pieces, triangles, source)
        _check_fans(X, triangles, source)
        nodes = {k: _index_set(k, v, n, where) for k, v in (node_sets or {}).items()}
        edges = {k: _edge_set(k, v, n, keys, source) for k, v in (edge_sets or {}).items()}
        if "boundary" not in nodes:  # else the two sets of this name could differ
            edges.setdefault("boundary", boundary)
        # The right operand wins: an edge set gets a node set only if there is none of its name.
        nodes = {name: np.unique(pairs) for name, pairs in edges.items()} | nodes
        regions = {k: _index_set(k, v, m, where) for k, v in (triangle_sets or {}).items()}
        return cls(X, triangles, nodes, edges, regions, notes=tuple(notes))


@dataclass(frozen=True)
class _Source:
    """Origin of the arrays, and the numbers of nodes and triangles there, for error messages."""

    where: str
    nodes: np.ndarray
    triangles: np.ndarray

    def _raise(self, bad: np.ndarray, listed: list[str], kind: str, allowed="", remedy=""):
        if len(bad) > MAX_LISTED:
            listed = [*listed, "..."]
        if len(bad) == 1:
            kind = re.sub(r"\b(node|triangle|edge|pair)s\b", r"\1", kind, count=1)
        what = f"{len(bad)} {kind}: {', '.join(listed)}"
        raise MeshError(what, allowed, self.where, remedy)

    def check_no_nodes(self, bad: np.ndarray, kind: str, allowed="", remedy=""):
        if len(bad):
            listed = [f"node {i}" for i in self.nodes[bad[:MAX_LISTED]]]
            self._raise(bad, listed, kind, allowed, remedy)

    def check_no_triangles(self, bad, triangles, kind: str, allowed="", remedy="", raw=False):
        """Raise `MeshError` if there are bad triangles; `raw` vertices may be out of range."""
        if len(bad):
            vertices = triangles[bad[:MAX_LISTED]]
            if not raw:
                vertices = self.nodes[vertices]
            pairs = zip(self.triangles[bad[:MAX_LISTED]], vertices.tolist(), strict=True)
            listed = [f"triangle {i} (nodes {', '.join(map(str, v))})" for i, v in pairs]
            self._raise(bad, listed, kind, allowed, remedy)

    def check_no_edges(self, bad: np.ndarray, kind: str, allowed="", remedy=""):
        if len(bad):
            listed = [f"edge {a}-{b}" for a, b in self.nodes[bad[:MAX_LISTED]]]
            self._raise(bad, listed, kind, allowed, remedy)


def quality(X: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(m,) shape of triangles (m, 3) between nodes X (n, 2): 4 √3 A / (l₁² + l₂² + l₃²).

    It is 1 for an equilateral triangle, 0 for a degenerate triangle, and negative for a
    clockwise triangle.
    """
    area, lengths2 = _areas_and_lengths(X, triangles)
    return 4 * np.sqrt(3.0) * area / lengths2.sum(axis=0)


def sorted_pairs(pairs: np.ndarray) -> np.ndarray:
    """Unique node pairs, lower index first, in ascending order."""
    return np.unique(np.sort(pairs, axis=1).astype(np.intp), axis=0)


def _arrays(X, triangles, where):
    """Return X (n, 2 or 3) as a new array of floats, and the triangles (m, 3) as an array.

    Raises `MeshError` for other shapes, for other types than numbers and integers, and if there
    are no triangles.
    """
    try:
        X = np.array(X, dtype=np.float64)
        triangles = np.asarray(triangles)
    except (TypeError, ValueError) as error:
        what = "coordinates or triangles are not arrays of numbers"
        raise MeshError(what, f"must be numbers: {error}", where) from error
    if X.ndim != 2 or X.shape[1] not in (2, 3):
        raise MeshError(f"coordinates have shape {X.shape}", "must be (n, 2) or (n, 3)", where)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        what = f"triangles have shape {triangles.shape} and type {triangles.dtype}"
        raise MeshError(what, "must be integers of shape (m, 3)", where)
    if len(triangles) == 0:
        raise MeshError("no triangles", "at least one is needed", where)
    return X, triangles


def _check_vertices(triangles, n, source):
    """Raise `MeshError` for vertices that are no nodes, and triangles with one node twice."""
    out_of_range = np.flatnonzero(((triangles < 0) | (triangles >= n)).any(axis=1))
    kind = "triangles with a vertex out of range"
    limit = f"vertices must be 0 to {n - 1}"
    # raw: a vertex out of range has no number in the file, and is shown as it is
    source.check_no_triangles(out_of_range, triangles, kind, limit, raw=True)
    repeated = (
        (triangles[:, 0] == triangles[:, 1])
        | (triangles[:, 1] == triangles[:, 2])
        | (triangles[:, 2] == triangles[:, 0])
    )
    kind = "triangles with a repeated vertex"
    source.check_no_triangles(np.flatnonzero(repeated), triangles, kind, remedy="Remove them.")


def _check_nodes(X, triangles, source):
    """Raise `MeshError` for nodes of no triangle, and for nodes at exactly the same place."""
    unused = np.ones(len(X), dtype=bool)
    unused[triangles.ravel()] = False
    kind = "nodes used by no triangle"
    source.check_no_nodes(np.flatnonzero(unused), kind, remedy="Remove them and renumber.")
    # Complex numbers are sorted by their real part x, then by their imaginary part y.
    points = np.ascontiguousarray(X).view(np.complex128).ravel()
    order = np.argsort(points, kind="stable")
    coincident = np.sort(order[1:][points[order][1:] == points[order][:-1]])
    kind = "nodes coincident with another node"
    source.check_no_nodes(coincident, kind, remedy="Merge them: merge = true.")


def _areas_and_lengths(X, triangles):
    """Signed areas (m,) and squared edge lengths (3, m)."""
    a, b, c = (X[triangles[:, i]] for i in range(3))
    e = b - a
    f = c - a
    area = 0.5 * (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])
    return area, np.array([(v * v).sum(axis=1) for v in (e, f, f - e)])


def _orient(X, triangles, source):
    """Return the triangles counter-clockwise, and how many of them were turned for that.

    Raises `MeshError` for triangles of zero area. Triangles of a tangled mesh overlap after
    they are turned, which `_check_edges` and `_check_fans` refuse.
    """
    area, lengths2 = _areas_and_lengths(X, triangles)
    flat = np.flatnonzero(np.abs(area) < 1e-12 * lengths2.max(axis=0))
    limit = "the area must be at least 1e-12 of the longest edge squared"
    remedy = "Remove or reshape them."
    source.check_no_triangles(flat, triangles, "zero-area triangles", limit, remedy)
    is_clockwise = area < 0
    oriented = np.where(is_clockwise[:, None], triangles[:, [0, 2, 1]], triangles)
    return oriented, int(np.count_nonzero(is_clockwise))


def _check_duplicates(triangles, source):
    """Raise `MeshError` for triangles with the same three nodes, in any order."""
    low = np.sort(triangles, axis=1)
    order = np.lexsort((low[:, 2], low[:, 1], low[:, 0]))
    copies = np.sort(order[1:][(low[order[1:]] == low[order[:-1]]).all(axis=1)])
    source.check_no_triangles(copies, triangles, "duplicate triangles", remedy="Remove the copies.")


def _check_edges(triangles, n, source):
    """Raise `MeshError` for an edge of more than two triangles, or of two that overlap there.

    `triangles` (m, 3) are counter-clockwise, and n is the number of nodes.

    Return the keys low * n + high of all edges, each once and ascending, where low and high are
    the nodes of the edge; the node pairs (b, 2) of the boundary edges; the third node (b,) of
    their triangles; and for each triangle (m,) the number of the piece to which edges connect
    it.
    """
    start = triangles.ravel().astype(np.int64)
    end = np.roll(triangles, -1, axis=1).ravel()
    sorted_keys = np.minimum(start, end) * n + np.maximum(start, end)
    order = np.argsort(sorted_keys, kind="stable")  # half-edge h belongs to triangle h // 3
    sorted_keys = sorted_keys[order]
    is_ascending = (start < end)[order]
    # Half-edges of the same edge now follow each other.
    first = np.flatnonzero(np.append(True, sorted_keys[1:] != sorted_keys[:-1]))
    count = np.diff(np.append(first, len(sorted_keys)))
    unique_keys = sorted_keys[first]
    crowded = _node_pairs(unique_keys[count > 2], n)
    kind = "edges shared by more than two triangles"
    source.check_no_edges(crowded, kind, remedy="A cloth is one sheet.")
    # All triangles are counter-clockwise, so two neighbours run along their edge in opposite
    # directions. If both run in the same direction, they lie on the same side of it.
    pair = first[count == 2]  # the place of the first of two half-edges; the second follows it
    folded = sorted_keys[pair[is_ascending[pair] == is_ascending[pair + 1]]]
    kind = "edges whose two triangles lie on the same side (they overlap)"
    source.check_no_edges(_node_pairs(folded, n), kind, remedy="Untangle the mesh.")
    m = len(triangles)
    neighbours = order[pair] // 3, order[pair + 1] // 3
    graph = coo_array((np.ones(len(pair), dtype=np.int8), neighbours), shape=(m, m))
    pieces = connected_components(graph, directed=False)[1]
    half_edges = order[first[count == 1]]
    opposite = triangles[half_edges // 3, (half_edges % 3 + 2) % 3]
    return unique_keys, _node_pairs(unique_keys[count == 1], n), opposite, pieces


def _check_hanging(X, boundary, opposite, source):
    """Raise `MeshError` for nodes in the middle of an edge of a triangle that does not have them.

    Such an edge is a boundary edge, and the cloth would be open there. `boundary` (b, 2) are
    the node pairs of the boundary edges, and `opposite` (b,) the third nodes of their triangles.
    """
    nodes = np.unique(boundary)
    start, end = X[boundary[:, 0]], X[boundary[:, 1]]
    length = np.linalg.norm(end - start, axis=1)
    # All nodes in the circle around an edge: the ends, and those between them.
    near = cKDTree(X[nodes]).query_ball_point((start + end) / 2, length / 2)
    edge = np.repeat(np.arange(len(boundary)), [len(inside) for inside in near])
    node = nodes[np.concatenate([*near, np.empty(0, int)]).astype(int)]
    is_other = (node[:, None] != boundary[edge]).all(axis=1) & (node != opposite[edge])
    edge, node = edge[is_other], node[is_other]
    along = (end - start)[edge] / length[edge, None]
    offset = X[node] - start[edge]
    distance = np.abs(offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0])
    allowed = np.minimum(rounding(X), 1e-3 * length[edge])
    hanging = np.unique(node[distance <= allowed])
    kind = "nodes in the middle of an edge of another triangle"
    remedy = "Split that triangle there."
    source.check_no_nodes(hanging, kind, "must be at the ends of edges", remedy)


def _check_fans(X, triangles, source):
    """Raise `MeshError` for nodes whose triangles have angles of more than 360° in sum.

    Such triangles overlap, although no two of them lie on the same side of an edge.
    """
    turn = np.zeros(len(X))  # the sum of the angles at each node
    for i in range(3):
        e, f = (X[triangles[:, (i + k) % 3]] - X[triangles[:, i]] for k in (1, 2))
        angle = np.arctan2(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0], (e * f).sum(axis=1))
        turn += np.bincount(triangles[:, i], weights=angle, minlength=len(X))
    overlapped = np.flatnonzero(turn > 2 * np.pi + 1e-6)  # 2π around an inner node
    kind = "nodes around which triangles overlap: their angles add up to more than 360°"
    source.check_no_nodes(overlapped, kind, remedy="Untangle the mesh.")


def _node_pairs(keys, n):
    """Node pairs (k, 2) of edge keys low * n + high."""
    return np.column_stack((keys // n, keys % n)).astype(np.intp)


def _check_connected(pieces, triangles, source):
    """Raise `MeshError` if the triangles are in several pieces; name those outside the largest.

    `pieces` (m,) is the number of the piece of each triangle.
    """
    outside_largest = np.flatnonzero(pieces != np.bincount(pieces).argmax())
    kind = "triangles not connected through edges to the rest"
    limit = f"the mesh has {pieces.max() + 1} separate pieces"
    remedy = (
        "Merge nodes at the same position (merge = true), join the pieces, or use one cloth per "
        "piece."
    )
    source.check_no_triangles(outside_largest, triangles, kind, limit, remedy)


def _index_set(name, values, n, where):
    """Sorted unique indices of a set of nodes or triangles; n is the number of all."""
    return np.unique(validated_indices(name, values, n, (), where))


def _edge_set(name, values, n, keys, source):
    """Return the node pairs of an edge set, sorted; raise `MeshError` for pairs that are no edge.

    `keys` are the keys of all edges of the mesh with n nodes, see `_check_edges`.
    """
    pairs = sorted_pairs(validated_indices(name, values, n, (2,), source.where))
    no_edges = pairs[~np.isin(pairs[:, 0] * n + pairs[:, 1], keys)]
    kind = f"pairs of set {name!r} that are not edges of a triangle"
    source.check_no_edges(no_edges, kind, "must be two nodes of one triangle")
    return pairs
