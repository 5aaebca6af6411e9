"""Gradients of a nodal field that are smoother than those of the elements.

Around each corner of a triangle a polynomial of one degree more than the element is fitted to
the nodal values, by least squares. Its gradient is the recovered gradient at the corner. In a
triangle the polynomials of its three corners are blended by the barycentric coordinates. A
polynomial of that degree has its exact gradient on every mesh.

Source: Zhang and Naga (2005), A new finite element gradient recovery method: superconvergence
property, SIAM J. Sci. Comput. 26, 1192–1213. The blending and the widening of patches are ours.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.recovery import LEAST_GOOD_PIVOT, solve_normal_equations

EDGES = ((0, 1), (1, 2), (0, 2))  # corners of the midpoints 3, 4 and 5 of a triangle of P2
# Rings of triangles in a patch. With one ring the stress of P2 on the pattern "cross" has order
# 2.1 inside the cloth, with two it has order 3.
LEAST_RINGS = 2
MOST_RINGS = 4
SPARE_NODES = 1.3  # nodes of a patch over the coefficients of its polynomial, at least


class Rows(NamedTuple):
    """Rows of gradients: of some polynomials, at one node each.

    Attributes
    ----------
    corner, group
        (r,) corner of which the polynomial is, and group of the triangles of its patch.
    at
        (r, 2) the places of the gradients [m].
    """

    corner: np.ndarray
    group: np.ndarray
    at: np.ndarray


@dataclass(frozen=True, eq=False)
class RecoveredGradient:
    """Matrices that give the recovered gradient of a nodal field.

    Attributes
    ----------
    X, Y
        (r, n) sparse matrices from a nodal field to its derivatives by X and by Y [1/m].
    """

    X: sparse.csr_matrix
    Y: sparse.csr_matrix

    def __call__(self, field: np.ndarray) -> np.ndarray:
        """Return the gradients (r, d, 2) of a nodal field (n, d)."""
        return np.stack([self.X @ field, self.Y @ field], axis=-1)

    def blended(self, shares: sparse.csr_matrix) -> Self:
        """Return gradients that are sums of these by the shares (s, r)."""
        return type(self)(shares @ self.X, shares @ self.Y)


@dataclass(frozen=True, eq=False)
class Places:
    """Places of the flat cloth. A place has a gradient for each group of triangles around it.

    Attributes
    ----------
    gradient
        The recovered gradients, one in each row.
    triangles
        (r,) a triangle of the group of each row.
    mean
        (places, r) sparse matrix from values of the rows to their mean at each place.
    """

    gradient: RecoveredGradient
    triangles: np.ndarray
    mean: sparse.csr_matrix


def places_at_nodes(X: np.ndarray, stencil: np.ndarray, group: np.ndarray) -> Places:
    """Return all nodes as places; see `recover_gradient` for the arguments.

    The gradient at the midpoint of an edge is the mean of those of the polynomials of both ends.
    """
    triangle, corner, node = [], [], []
    for a in range(stencil.shape[1]):
        for end in (a,) if a < 3 else EDGES[a - 3]:
            triangle.append(np.arange(len(group)))
            corner.append(stencil[:, end])
            node.append(stencil[:, a])
    triangles, corners, nodes = map(np.concatenate, (triangle, corner, node))
    _, first = np.unique([nodes, corners, group[triangles]], axis=1, return_index=True)
    triangles, corners, nodes = triangles[first], corners[first], nodes[first]
    rows = Rows(corners, group[triangles], X[nodes])
    _, first, pair = np.unique(
        [nodes, group[triangles]], axis=1, return_index=True, return_inverse=True
    )
    gradient = recover_gradient(X, stencil, group, rows).blended(mean_of(pair))
    return Places(gradient, triangles[first], mean_of(nodes[first]))


def mean_of(number: np.ndarray) -> sparse.csr_matrix:
    """Return the matrix (max + 1, r) to the means of the rows that have the same number."""
    share = 1.0 / np.bincount(number)[number]
    return sparse.csr_matrix((share, (number, np.arange(len(number)))))


def place_in_triangle(
    X: np.ndarray, stencil: np.ndarray, group: np.ndarray, cell: int, point: np.ndarray
) -> Places:
    """Return a point (2,) [m] of the triangle `cell` as the only place."""
    corners = stencil[cell, :3]
    rows = Rows(corners, np.full(3, group[cell]), np.tile(point, (3, 1)))
    barycentric = np.linalg.solve(np.vstack([X[corners].T, np.ones(3)]), [*point, 1.0])
    gradient = recover_gradient(X, stencil, group, rows).blended(sparse.csr_matrix(barycentric))
    return Places(gradient, np.array([cell]), sparse.identity(1, format="csr"))


def recover_gradient(
    X: np.ndarray, stencil: np.ndarray, group: np.ndarray, rows: Rows
) -> RecoveredGradient:
    """Return the gradients of the polynomials of corners, each at a place.

    Parameters
    ----------
    X
        (n, 2) coordinates of the nodes [m].
    stencil
        (m, k) nodes of the triangles, the corners first.
    group
        (m,) equal where the field is smooth across edges; a fit takes triangles of one group.
    rows
        The polynomials and the places.
    """
    degree = 2 if stencil.shape[1] == 3 else 3
    groups = int(group.max()) + 1
    polynomials, polynomial = np.unique(rows.corner * groups + rows.group, return_inverse=True)
    corner, own_group = polynomials // groups, polynomials % groups
    index, column, along_x, along_y = [], [], [], []
    for chosen, taken, fit in _fits(X, stencil, group, (corner, own_group), degree):
        place = np.full(len(corner), -1)
        place[chosen] = taken
        row = np.flatnonzero(place[polynomial] >= 0)
        own = place[polynomial[row]]
        weights = fit.slopes(own, rows.at[row])
        index.append(np.repeat(row, fit.nodes.shape[1]))
        column.append(fit.nodes[own].ravel())
        along_x.append(weights[:, 0].ravel())
        along_y.append(weights[:, 1].ravel())
    entries = np.concatenate(index), np.concatenate(column)
    shape = len(rows.corner), len(X)
    return RecoveredGradient(
        sparse.csr_matrix((np.concatenate(along_x), entries), shape=shape),
        sparse.csr_matrix((np.concatenate(along_y), entries), shape=shape),
    )


@dataclass(frozen=True, eq=False)
class Fit:
    """Fits of polynomials whose patches have equally many nodes.

    Attributes
    ----------
    nodes
        (s, c) nodes of each patch.
    centre, size
        (s, 2) corner and (s,) size of each patch [m]; the polynomials are in coordinates from
        the corner, over the size.
    powers
        (d, 2) powers of both coordinates in each term.
    weights
        (s, d, c) from the values at the nodes of the patch to the coefficients.
    is_good
        (s,) whether the nodes determine the polynomial well.
    """

    nodes: np.ndarray
    centre: np.ndarray
    size: np.ndarray
    powers: np.ndarray
    weights: np.ndarray
    is_good: np.ndarray

    @classmethod
    def of(cls, X: np.ndarray, nodes: np.ndarray, centre: np.ndarray, degree: int) -> Self:
        """Return the fits to the values at the nodes (s, c) of the patches."""
        arms = X[nodes] - centre[:, None]
        size = np.sqrt((arms**2).sum(axis=2).max(axis=1))
        x, y = np.moveaxis(arms / size[:, None, None], -1, 0)
        powers = np.array([(i, k - i) for k in range(degree + 1) for i in range(k + 1)])
        A = np.stack([x**i * y**j for i, j in powers], axis=-1)
        transposed = A.swapaxes(1, 2)
        normal = transposed @ A / nodes.shape[1]
        identity = np.broadcast_to(np.eye(len(powers)), normal.shape)
        pivot, inverse = solve_normal_equations(np.concatenate([normal, identity], axis=2))
        weights = inverse @ transposed / nodes.shape[1]
        is_good = pivot > LEAST_GOOD_PIVOT**degree
        is_good &= nodes.shape[1] >= SPARE_NODES * len(powers)
        return cls(nodes, centre, size, powers, weights, is_good)

    def slopes(self, chosen: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return (r, 2, c) from nodal values to gradients of chosen polynomials at (r, 2) [1/m]."""
        size = self.size[chosen, None]
        x, y = ((at - self.centre[chosen]) / size).T
        along_x = [i * x ** max(i - 1, 0) * y**j for i, j in self.powers]
        along_y = [j * x**i * y ** max(j - 1, 0) for i, j in self.powers]
        terms = np.stack([np.stack(along_x, -1), np.stack(along_y, -1)], axis=1)
        slopes: np.ndarray = terms @ self.weights[chosen] / size[:, None]
        return slopes


def _fits(X, stencil, group, polynomials, degree: int) -> Iterator[tuple]:
    """Yield numbers (t,) of polynomials, their numbers (t,) in a `Fit`, and the `Fit`.

    `polynomials` are the corner and the group of each. A patch has the triangles around the
    corner, and the triangles around these; where they do not determine the polynomial well, it
    has a ring or two more.
    """
    corner, own_group = polynomials
    remaining = np.arange(len(corner))
    for ring in range(LEAST_RINGS, MOST_RINGS + 1):
        patches = _patches(len(X), stencil, group, corner[remaining], own_group[remaining], ring)
        count = np.diff(patches.indptr)
        is_poor = np.zeros(len(remaining), bool)
        for size in np.unique(count):
            chosen = np.flatnonzero(count == size)
            nodes = patches.indices[patches.indptr[chosen, None] + np.arange(size)]
            fit = Fit.of(X, nodes, X[corner[remaining[chosen]]], degree)
            is_taken = fit.is_good | (ring == MOST_RINGS)
            is_poor[chosen[~is_taken]] = True
            yield remaining[chosen[is_taken]], np.flatnonzero(is_taken), fit
        remaining = remaining[is_poor]
        if not len(remaining):
            return


def _patches(n: int, stencil, group, corner, own_group, rings: int) -> sparse.csr_matrix:
    """Return the nodes of the patches of corners: a sparse matrix (s, n) of numbers > 0.

    A patch of `rings` rings has only triangles of the group `own_group` (s,) of its polynomial.
    """
    m = len(stencil)
    s = len(corner)
    touches = _incidence(stencil[:, :3], m, n)  # triangle × corner
    nodes = sparse.csr_matrix((np.ones(s), (np.arange(s), corner)), shape=(s, n))
    for _ in range(rings):
        patch = (nodes @ touches.T).tocoo()
        is_own = group[patch.col] == own_group[patch.row]
        place = patch.row[is_own], patch.col[is_own]
        triangles = sparse.csr_matrix((np.ones(is_own.sum()), place), shape=(s, m))
        nodes = triangles @ touches
    patches = (triangles @ _incidence(stencil, m, n)).tocsr()
    patches.sort_indices()
    return patches


def _incidence(nodes: np.ndarray, m: int, n: int) -> sparse.csr_matrix:
    """Return a matrix (m, n) with a one where a triangle has a node of `nodes` (m, k)."""
    place = np.repeat(np.arange(m), nodes.shape[1]), nodes.ravel()
    return sparse.csr_matrix((np.ones(nodes.size), place), shape=(m, n))
