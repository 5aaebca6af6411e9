"""The points of the cloth that an obstacle acts on: nodes, and points inside triangles.

Between nodes a triangle dips into a convex shape: with edges of length l, under a sphere of
radius R, by l²/(6R) at its centre. Where that is more than a quarter of the gap, each triangle
is divided into k² parts, and the corners of the parts are points too.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.compiled.jit import Array, kernel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.mesh.cloth import Cloth
from fecloth.terms.contact.shape import Shape

# A triangle may dip into a shape by this part of the gap between its points. Chosen: the cloth
# rests near the gap, so that the dip is an error of the same kind, and smaller.
MOST_DIP_OVER_GAP = 0.25
# Parts of an edge. Chosen: 36 inner points and more on each triangle cost much. What dips
# deeper is told before a run (`inside.cutting_depth`).
MOST_PARTS = 8
# Distance of a point of a triangle from the nearest of its nodes, over the longest edge at rest:
# no point of a cloth that is stretched threefold is farther.
FARTHEST_OVER_EDGE = 2.0
# Values of shape functions, multiples of 1/8 but for round-off, are equal below this difference.
LEAST_DIFFERENCE = 1e-9


@dataclass(frozen=True, eq=False)
class NodePoints:
    """Nodes with their areas (n,) [m²]."""

    areas: np.ndarray

    def candidates(self, node_distances: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
        """The numbers of the points that may be nearer than `reach` [m], or (n,) [m].

        `node_distances` (n,) [m] are the distances of the nodes.
        """
        return np.flatnonzero(node_distances < reach)

    def values(self, of_nodes: np.ndarray, point_numbers: np.ndarray) -> np.ndarray:
        """(p, 3) values at the points `point_numbers`, from values at the nodes (n, 3)."""
        return of_nodes[point_numbers]

    def between(self, held: np.ndarray) -> np.ndarray:
        """The points that only the nodes `held` move."""
        return held

    def nodes(self, point_numbers: np.ndarray) -> np.ndarray:
        """The nodes that move the points `point_numbers`."""
        return point_numbers

    def add_force(self, point_numbers: np.ndarray, F: np.ndarray, f: np.ndarray) -> None:
        f[point_numbers] += F

    def weights(self, point_numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nodes (p, k) of the points `point_numbers` (p,), and their shape functions there."""
        return point_numbers[:, None], np.ones((len(point_numbers), 1))

    def add_tangent(self, point_numbers: np.ndarray, K: np.ndarray, J: BlockMatrix) -> None:
        J.values[J.pattern.diagonal[point_numbers]] += K


@dataclass(frozen=True, eq=False)
class TrianglePoints:
    """Points inside triangles and their edges.

    Attributes
    ----------
    triangles
        The triangle (p,) of each point.
    shape_functions
        Values (p, k) of the shape functions of its nodes at the point.
    areas
        Areas (p,) [m²].
    stencil
        Nodes (m, k) of each triangle of the cloth.
    size
        Longest edge (m,) of each triangle [m].
    find_slots
        The `slots` of `Term.bind`.
    """

    triangles: np.ndarray
    shape_functions: np.ndarray
    areas: np.ndarray
    stencil: np.ndarray
    size: np.ndarray
    find_slots: FindSlots

    @cached_property
    def slots(self) -> np.ndarray:
        return self.find_slots(self.stencil)

    def candidates(self, node_distances: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
        """Return the numbers of the points whose triangle has a node near the obstacle.

        Near is a distance below `reach` + 2 × the longest edge of the triangle.

        So no point nearer than `reach` is missed (see `FARTHEST_OVER_EDGE`). `reach` [m] is one
        number, or (n,); `node_distances` (n,) are the distances of the nodes.
        """
        near = np.empty(len(self.triangles), np.int64)
        count = find_near(
            self.triangles,
            self.stencil,
            size=FARTHEST_OVER_EDGE * self.size,
            node_distances=node_distances,
            reach=np.array(reach, float, ndmin=1),
            near=near,
        )
        return near[:count].copy()

    def values(self, of_nodes: np.ndarray, point_numbers: np.ndarray) -> np.ndarray:
        values = np.empty((len(point_numbers), 3))
        gather(
            point_numbers,
            self.triangles,
            self.shape_functions,
            self.stencil,
            of_nodes=np.ascontiguousarray(of_nodes),
            values=values,
        )
        return values

    def between(self, held: np.ndarray) -> np.ndarray:
        # A node with the shape function 0 does not move the point.
        is_held = np.isin(self.stencil, held)[self.triangles]
        return np.flatnonzero((is_held | (self.shape_functions == 0.0)).all(axis=1))

    def nodes(self, point_numbers: np.ndarray) -> np.ndarray:
        return self.stencil[self.triangles[point_numbers]][
            self.shape_functions[point_numbers] != 0.0
        ]

    def add_force(self, point_numbers: np.ndarray, F: np.ndarray, f: np.ndarray) -> None:
        F = np.ascontiguousarray(F)
        N = self.shape_functions
        add_forces(point_numbers, self.triangles, N, self.stencil, F, f)

    def weights(self, point_numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.stencil[self.triangles[point_numbers]], self.shape_functions[point_numbers]

    def add_tangent(self, point_numbers: np.ndarray, K: np.ndarray, J: BlockMatrix) -> None:
        K = np.ascontiguousarray(K)
        N = self.shape_functions
        add_tangents(point_numbers, self.triangles, N, self.slots, K, J.values)


Points = NodePoints | TrianglePoints


def divisions(shape: Shape, gap: float, cloth: Cloth) -> int:
    """Return the number k of parts of an edge that the points of an obstacle need.

    It is so large that no triangle dips into the shape by more than `MOST_DIP_OVER_GAP` of the
    gap between its points. It may be larger than `MOST_PARTS`, to which the caller limits it.
    """
    longest = float(longest_edges(cloth).max())
    radius = shape.radius_of_curvature + gap  # of the surface that the cloth slides on
    # P2 has nodes at the middles of its edges, which must be points: k is a multiple of 2.
    least_parts = {"P1": 1, "P2": 2}[cloth.element]
    if math.isinf(radius):
        return least_parts
    most_dip = MOST_DIP_OVER_GAP * gap
    needed_parts = math.ceil(longest / math.sqrt(6 * most_dip * radius))  # dip = part²/(6 R)
    return max(least_parts, least_parts * math.ceil(needed_parts / least_parts))


def longest_edges(cloth: Cloth) -> np.ndarray:
    """(m,) longest edge of each triangle [m]."""
    corners = cloth.X[cloth.triangles]
    edges = corners - np.roll(corners, 1, axis=1)
    return np.linalg.norm(edges, axis=2).max(axis=1)


def points_of(cloth: Cloth, k: int, find_slots: FindSlots) -> tuple[Points, ...]:
    """Return the points of a cloth whose edges are divided into k parts, each with its area.

    Each triangle has k² parts, and the corners of the parts are the points. The area of each
    part goes to its three corners in equal shares. The first kind are the nodes, the second
    kind the points inside triangles; it is left out if there are none. `find_slots` is the
    `slots` of `Term.bind`.
    """
    corners, shares = _divide_triangle(k)
    stencil = cloth.stencil
    areas = np.outer(cloth.weights.sum(axis=1), shares).ravel()
    # One row for each corner in each triangle, so that a point on a common edge has two rows.
    triangle, corner = np.divmod(np.arange(len(stencil) * len(corners)), len(corners))
    N = _shape_functions(cloth, corners)[corner]
    first_row, point_of_row = _find_distinct(stencil[triangle], N)
    areas = np.bincount(point_of_row, areas)
    triangle = triangle[first_row]
    N = N[first_row]
    is_node = N.max(axis=1) > 1 - LEAST_DIFFERENCE  # 1 at its own node only
    node = stencil[triangle[is_node], N[is_node].argmax(axis=1)]
    nodes = NodePoints(np.bincount(node, areas[is_node], len(cloth.X)))
    if is_node.all():
        return (nodes,)
    inner = TrianglePoints(
        triangles=triangle[~is_node],
        shape_functions=N[~is_node],
        areas=areas[~is_node],
        stencil=stencil,
        size=longest_edges(cloth),
        find_slots=find_slots,
    )
    return nodes, inner


def _divide_triangle(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Divide the reference triangle into k² equal parts.

    Returns the corners (q, 2) of the parts, in its coordinates from 0 to 1, and the share (q,)
    of each corner in its area: a third of each part at the corner.
    """
    corners = [(i, j) for j in range(k + 1) for i in range(k + 1 - j)]
    index_of_corner = {corner: n for n, corner in enumerate(corners)}
    shares = np.zeros(len(corners))
    for i, j in corners:
        upright_part = [(i, j), (i + 1, j), (i, j + 1)]
        inverted_part = [(i + 1, j), (i + 1, j + 1), (i, j + 1)]
        for part in (upright_part, inverted_part):
            is_in_triangle = all(corner in index_of_corner for corner in part)
            if is_in_triangle:
                shares[[index_of_corner[corner] for corner in part]] += 1 / (3 * k**2)
    return np.array(corners) / k, shares


def _shape_functions(cloth: Cloth, places: np.ndarray) -> np.ndarray:
    """(q, k) values of the shape functions at places (q, 2) of the reference triangle.

    Each is 1 at its node and 0 at the others. They are linear within the triangle or, for P2,
    within the four triangles between its nodes. This is the surface that is drawn, and the
    surface for which the cloth touches itself.
    """
    corners = np.column_stack([1 - places.sum(axis=1), places])
    if cloth.element == "P1":
        return corners
    # Column a of `corners` belongs to the corner a, column a of `next_corners` to the next one:
    # the midpoint between both is the node of the edges 01, 12 and 20.
    next_corners = np.roll(corners, -1, axis=1)
    of_both = 2 * (corners + next_corners) - 1
    midpoints = np.minimum(np.minimum(2 * corners, 2 * next_corners), of_both)
    return np.maximum(np.hstack([2 * corners - 1, midpoints]), 0.0)


def _find_distinct(nodes: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the rows that are the same point of the cloth.

    A row has the nodes (k,) of a point and the values N (k,) of their shape functions. Two rows
    are one point if the same nodes have the same values, as on a common edge. Returns the first
    row of each distinct point, and for each row the number of its distinct point.
    """
    rounded_N = np.rint(N / LEAST_DIFFERENCE).astype(np.int64)
    acting_nodes = np.where(rounded_N == 0, -1, nodes)
    order = np.argsort(acting_nodes, axis=1)  # triangles have their nodes in different orders
    sorted_nodes = np.take_along_axis(acting_nodes, order, 1)
    sorted_N = np.take_along_axis(rounded_N, order, 1)
    keys = np.hstack([sorted_nodes, sorted_N])
    _, first_row, point_of_row = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return first_row, point_of_row.ravel()


# --- compiled loops: from nodes to points, and back ------------------------------------------


@kernel
def find_near(
    triangles: Array,
    stencil: Array,
    size: Array,
    node_distances: Array,
    reach: Array,
    near: Array,
) -> int:
    """Write into `near` the numbers of the points that may be near an obstacle; return how many.

    A point may be near if its triangle has a node whose distance (`node_distances`) is less
    than `reach` plus the `size` of the triangle. `reach` has one entry for all nodes, or one
    for each. `triangles` (p,) are the triangles of the points. Points of one triangle mostly
    follow each other: then the nodes of this triangle are looked at only once.
    """
    count = 0
    last = -1  # the triangle of the point before
    is_near = False
    has_reach_of_node = len(reach) > 1
    for p in range(len(triangles)):
        e = triangles[p]
        if e != last:
            last = e
            is_near = False
            for a in range(stencil.shape[1]):
                node = stencil[e, a]
                own_reach = reach[0]
                if has_reach_of_node:
                    own_reach = reach[node]
                if node_distances[node] - own_reach < size[e]:
                    is_near = True
        if is_near:
            near[count] = p
            count += 1
    return count


@kernel
def gather(
    point_numbers: Array,
    triangles: Array,
    N: Array,
    stencil: Array,
    of_nodes: Array,
    values: Array,
) -> None:
    """values (p, 3) = Σ_a N_a of_nodes[a], at the points `point_numbers` (p,)."""
    for i in range(len(point_numbers)):
        p = point_numbers[i]
        e = triangles[p]
        v0 = v1 = v2 = 0.0
        for a in range(stencil.shape[1]):
            node = stencil[e, a]
            share = N[p, a]
            v0 += share * of_nodes[node, 0]
            v1 += share * of_nodes[node, 1]
            v2 += share * of_nodes[node, 2]
        values[i, 0] = v0
        values[i, 1] = v1
        values[i, 2] = v2


@kernel
def add_forces(
    point_numbers: Array, triangles: Array, N: Array, stencil: Array, F: Array, f: Array
) -> None:
    """f (n, 3) += N_a F, for forces F (p, 3) at the points `point_numbers` (p,)."""
    for i in range(len(point_numbers)):
        p = point_numbers[i]
        e = triangles[p]
        for a in range(stencil.shape[1]):
            node = stencil[e, a]
            share = N[p, a]
            for c in range(3):
                f[node, c] += share * F[i, c]


@kernel
def add_tangents(
    point_numbers: Array, triangles: Array, N: Array, slots: Array, K: Array, values: Array
) -> None:
    """Blocks (…, 3, 3) of the matrix, `values`, += N_a N_b K of the points `point_numbers` (p,).

    `slots` (m, k, k) are the places of the blocks in `values`, for all triangles.
    """
    for i in range(len(point_numbers)):
        p = point_numbers[i]
        e = triangles[p]
        for a in range(slots.shape[1]):
            for b in range(slots.shape[2]):
                share = N[p, a] * N[p, b]
                slot = slots[e, a, b]
                if share != 0.0:
                    for c in range(3):
                        for d in range(3):
                            values[slot, c, d] += share * K[i, c, d]
