"""The points of the cloth that an obstacle acts on: nodes, and points inside triangles.

Between nodes a triangle dips into a convex shape: with edges of length l, under a sphere of
radius R, by l²/(6R) at its centre. Where that is more than a quarter of the gap, each triangle
is divided into k² parts, and the corners of the parts are points too.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fecloth.compiled.jit import Array, kernel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.mesh.cloth import Cloth
from fecloth.terms.contact.restitution import Approach
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

    def candidates(self, at_nodes: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
        """The points that may be nearer than `reach` [m]; the nodes have distances `at_nodes`."""
        return np.flatnonzero(at_nodes < reach)

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

    def candidates(self, at_nodes: np.ndarray, reach: np.ndarray | float) -> np.ndarray:
        """The points of triangles with a node nearer than `reach` and twice the longest edge."""
        near = np.empty(len(self.triangles), np.int64)
        count = find_near(
            self.triangles,
            self.stencil,
            size=FARTHEST_OVER_EDGE * self.size,
            at_nodes=at_nodes,
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
        is_held = np.isin(self.stencil, held)[self.triangles]
        return np.flatnonzero((is_held | (self.shape_functions == 0.0)).all(axis=1))

    def nodes(self, point_numbers: np.ndarray) -> np.ndarray:
        return self.stencil[self.triangles[point_numbers]][
            self.shape_functions[point_numbers] != 0.0
        ]

    def add_force(self, point_numbers: np.ndarray, F: np.ndarray, f: np.ndarray) -> None:
        F = np.ascontiguousarray(F)
        add_forces(point_numbers, self.triangles, self.shape_functions, self.stencil, F, f)

    def add_tangent(self, point_numbers: np.ndarray, K: np.ndarray, J: BlockMatrix) -> None:
        K = np.ascontiguousarray(K)
        add_tangents(point_numbers, self.triangles, self.shape_functions, self.slots, K, J.values)


Points = NodePoints | TrianglePoints


class Contacts(NamedTuple):
    """Points of one kind that an obstacle pushes.

    Attributes
    ----------
    points
        All points of the kind.
    point_numbers
        Numbers (p,) of the points nearer than the gap.
    y
        Places (p, 3) of these in the frame of the shape [m].
    s
        Distances (p,) of these over the gap.
    approach
        How these come nearer over the step.
    """

    points: Points
    point_numbers: np.ndarray
    y: np.ndarray
    s: np.ndarray
    approach: Approach

    @property
    def areas(self) -> np.ndarray:
        return self.points.areas[self.point_numbers]


def divisions(shape: Shape, gap: float, cloth: Cloth) -> int:
    """The number k of parts of an edge with which no triangle dips too deep between its points.

    It may be larger than `MOST_PARTS`: then so many parts are not enough. P2 has an even k.
    """
    longest = float(longest_edges(cloth).max())
    radius = shape.radius_of_curvature + gap  # of the surface that the cloth slides on
    step = {"P1": 1, "P2": 2}[cloth.element]
    if math.isinf(radius):
        return step
    most_dip = MOST_DIP_OVER_GAP * gap
    needed = math.ceil(longest / math.sqrt(6 * most_dip * radius))  # dip = part²/(6 R)
    return max(step, step * math.ceil(needed / step))


def longest_edges(cloth: Cloth) -> np.ndarray:
    """(m,) longest edge of each triangle [m]."""
    corners = cloth.X[cloth.triangles]
    edges = corners - np.roll(corners, 1, axis=1)
    return np.linalg.norm(edges, axis=2).max(axis=1)


def points_of(cloth: Cloth, k: int, find_slots: FindSlots) -> tuple[Points, ...]:
    """The points of a cloth with k parts an edge, each with its area.

    The area of each part goes to its three corners in equal shares. The first kind are the
    nodes, the second kind the points inside triangles, if there are any.
    """
    lattice, shares = _lattice(k)
    values = _shape_functions(cloth, lattice)
    stencil = cloth.stencil
    areas = np.outer(cloth.weights.sum(axis=1), shares).ravel()
    triangle, place = np.divmod(np.arange(len(stencil) * len(lattice)), len(lattice))
    N = values[place]
    first, number = _distinct(stencil[triangle], N)
    areas = np.bincount(number, areas)
    triangle = triangle[first]
    N = N[first]
    is_node = N.max(axis=1) > 1 - LEAST_DIFFERENCE
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


def _lattice(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (q, 2) of the k² parts of the reference triangle, and their shares in its area."""
    corners = [(i, j) for j in range(k + 1) for i in range(k + 1 - j)]
    number = {corner: n for n, corner in enumerate(corners)}
    share = np.zeros(len(corners))
    for i, j in corners:
        up = [(i, j), (i + 1, j), (i, j + 1)]
        down = [(i + 1, j), (i + 1, j + 1), (i, j + 1)]
        for part in (up, down):
            if all(corner in number for corner in part):
                share[[number[corner] for corner in part]] += 1 / (3 * k**2)
    return np.array(corners) / k, share


def _shape_functions(cloth: Cloth, places: np.ndarray) -> np.ndarray:
    """(q, k) values of the shape functions at places (q, 2) of the reference triangle.

    Each is 1 at its node and 0 at the others. They are linear within the triangle or, for P2,
    within the four triangles between its nodes: the surface that is drawn, and that touches
    itself.
    """
    corners = np.column_stack([1 - places.sum(axis=1), places])
    if cloth.element == "P1":
        return corners
    after = np.roll(corners, -1, axis=1)  # the midpoints of the edges 01, 12 and 20
    middle = np.minimum(np.minimum(2 * corners, 2 * after), 2 * (corners + after) - 1)
    return np.maximum(np.hstack([2 * corners - 1, middle]), 0.0)


def _distinct(nodes: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first row of each place of the cloth, and the number of the place for each row.

    A row has the nodes (k,) of a place and the values N (k,) of their shape functions. Two rows
    are one place if the same nodes have the same values, as on a common edge.
    """
    value = np.rint(N / LEAST_DIFFERENCE).astype(np.int64)
    acting = np.where(value == 0, -1, nodes)
    order = np.argsort(acting, axis=1)
    rows = np.hstack([np.take_along_axis(acting, order, 1), np.take_along_axis(value, order, 1)])
    _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, number.ravel()


# --- compiled loops: from nodes to points, and back ------------------------------------------


@kernel
def find_near(
    triangles: Array, stencil: Array, size: Array, at_nodes: Array, reach: Array, near: Array
) -> int:
    """Write the numbers of points whose triangle has a node nearer than `reach` plus `size`.

    `triangles` (p,) is sorted, or nearly, so that a triangle is asked once for its points.
    `reach` has one entry, or one a node. Returns the number of points.
    """
    count = 0
    last = -1
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
                if at_nodes[node] - own_reach < size[e]:
                    is_near = True
        if is_near:
            near[count] = p
            count += 1
    return count


@kernel
def gather(
    point_numbers: Array, triangles: Array, N: Array, stencil: Array, of_nodes: Array, values: Array
) -> None:
    """values (p, 3) = Σ_a N_a of_nodes[a] of some of the points."""
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
    """f (n, 3) += N_a F of some of the points."""
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
    """The blocks of the matrix += N_a N_b K of some of the points."""
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
