"""Fields that are smoother than those of the elements, for a recovered strain.

Around each corner of a triangle a polynomial is fitted, by least squares. In a triangle the
polynomials of its three corners are blended by the barycentric coordinates.

- On P1 the strain is linear, and is fitted to the strains tᵀE t of the edges, at their middles.
- On P2 the positions are cubic, and are fitted to the nodes; their gradient is what is recovered.

The strain of an edge is the strain of its chord, and the triangles have the strains of their
chords, too. On a curved cloth the strains of chords are near the exact strains; the strains of a
smooth surface through the nodes are not. On a flat cloth the strain of an edge has an error of
order h² at the middle of the edge, also at the border.

Source: Zienkiewicz and Zhu (1992), The superconvergent patch recovery and a posteriori error
estimates, for the fits; Zhang and Naga (2005), A new finite element gradient recovery method:
superconvergence property, SIAM J. Sci. Comput. 26, 1192–1213, for P2. The strains of edges, the
blending and the widening of patches are ours.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.recovery import LEAST_GOOD_PIVOT, solve_normal_equations

EDGES = ((0, 1), (1, 2), (0, 2))  # corners of the midpoints 3, 4 and 5 of a triangle of P2
PORTIONS = 8  # in which patches are fitted: all at once they take as much memory as a step
MOST_RINGS = 4
SPARE_POINTS = 1.3  # points of a patch over the coefficients of its polynomial, at least


class Rows(NamedTuple):
    """Rows of values: of some polynomials, at one place each.

    Attributes
    ----------
    corner, group
        (r,) the corner around which the polynomial is fitted, and the group of the triangles to
        which it is fitted.
    at
        (r, 2) the places [m].
    """

    corner: np.ndarray
    group: np.ndarray
    at: np.ndarray


@dataclass(frozen=True, eq=False)
class Places:
    """Places of the flat cloth. A place has a value for each group of triangles around it.

    Attributes
    ----------
    matrices
        On P1 three matrices (r, k) from the strains of edges to E_XX, E_YY and E_XY; on P2 two
        (r, n) from nodal values to recovered derivatives by X and by Y [1/m].
    triangles
        (r,) a triangle of the group of each row.
    mean
        (places, r) sparse matrix from values of the rows to their mean at each place.
    edges
        (k, 2) the ends of the edges on P1; none on P2.
    """

    matrices: tuple[sparse.csr_matrix, ...]
    triangles: np.ndarray
    mean: sparse.csr_matrix
    edges: np.ndarray


def places_at_nodes(X: np.ndarray, stencil: np.ndarray, group: np.ndarray) -> Places:
    """Return all nodes as places; see `recover` for the arguments.

    The value at the midpoint of an edge is the mean of those of the polynomials of both ends.
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
    mean = mean_of(pair)
    samples = Samples.of(X, stencil)
    matrices = tuple(mean @ matrix for matrix in recover(X, stencil, group, rows, samples))
    return Places(matrices, triangles[first], mean_of(nodes[first]), samples.edges)


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
    shares = sparse.csr_matrix(barycentric)
    samples = Samples.of(X, stencil)
    matrices = tuple(shares @ matrix for matrix in recover(X, stencil, group, rows, samples))
    return Places(matrices, np.array([cell]), sparse.identity(1, format="csr"), samples.edges)


def edges_of(stencil: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends (k, 2) of the edges of triangles, and the edges (m, 3) of each of these."""
    n = int(stencil.max()) + 1
    ends = np.sort(stencil[:, EDGES].astype(np.int64), axis=2)
    keys, number = np.unique(ends[..., 0] * n + ends[..., 1], return_inverse=True)
    return np.column_stack(np.divmod(keys, n)), number.reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Samples:
    """What is known of a field, and what is recovered of it.

    Attributes
    ----------
    at
        (p, 2) the points where a value is known [m].
    of_triangle
        (m, s) the points in each triangle.
    forms
        (p, f) the value at a point is the sum of these times the f fields.
    degree
        The degree of the polynomials of the fields.
    rings
        Rings of triangles in a patch, at least. With one ring the stress of P2 on the pattern
        "cross" has order 2.1 inside the cloth, with two it has order 3.
    edges
        (k, 2) the ends of the edges on P1; none on P2.
    wanted
        The number of a field, and how often it is derived by X and by Y, for each result.
    """

    at: np.ndarray
    of_triangle: np.ndarray
    forms: np.ndarray
    degree: int
    rings: int
    edges: np.ndarray
    wanted: tuple[tuple[int, int, int], ...]

    @classmethod
    def of(cls, X: np.ndarray, stencil: np.ndarray) -> Self:
        """The edges and their strains of P1; the nodes and their positions of P2."""
        if stencil.shape[1] > 3:
            none = np.zeros((0, 2), np.int64)
            return cls(X, stencil, np.ones((len(X), 1)), 3, 2, none, ((0, 1, 0), (0, 0, 1)))
        edges, of_triangle = edges_of(stencil)
        along = X[edges[:, 1]] - X[edges[:, 0]]
        c, s = (along / np.linalg.norm(along, axis=1, keepdims=True)).T
        forms = np.column_stack([c * c, s * s, 2 * c * s])
        wanted = (0, 0, 0), (1, 0, 0), (2, 0, 0)
        return cls(X[edges].mean(axis=1), of_triangle, forms, 1, 1, edges, wanted)


def recover(
    X: np.ndarray, stencil: np.ndarray, group: np.ndarray, rows: Rows, samples: "Samples"
) -> list[sparse.csr_matrix]:
    """Return the matrices of `Places` for polynomials of corners, each at a place.

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
    samples
        What is known.
    """
    groups = int(group.max()) + 1
    polynomials, polynomial = np.unique(rows.corner * groups + rows.group, return_inverse=True)
    corner, own_group = polynomials // groups, polynomials % groups
    index, column, weights = [], [], []
    for chosen, taken, fit in _fits(X, samples, stencil, group, (corner, own_group)):
        place = np.full(len(corner), -1)
        place[chosen] = taken
        row = np.flatnonzero(place[polynomial] >= 0)
        own = place[polynomial[row]]
        index.append(np.repeat(row, fit.points.shape[1]))
        column.append(fit.points[own].ravel())
        weights.append([fit.weights_of(own, rows.at[row], *w).ravel() for w in samples.wanted])
    entries = np.concatenate(index), np.concatenate(column)
    shape = len(rows.corner), len(samples.at)
    return [
        sparse.csr_matrix((np.concatenate(parts), entries), shape=shape)
        for parts in zip(*weights, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Fit:
    """Fits of polynomials whose patches have equally many points.

    Attributes
    ----------
    points
        (s, c) numbers of the points of each patch.
    centre, size
        (s, 2) corner and (s,) size of each patch [m]; the polynomials are in coordinates from
        the corner, over the size.
    powers
        (d, 2) powers of both coordinates in each term.
    weights
        (s, f, d, c) from the values at the points of the patch to the coefficients of each field.
    is_good
        (s,) whether the points determine the polynomial well.
    """

    points: np.ndarray
    centre: np.ndarray
    size: np.ndarray
    powers: np.ndarray
    weights: np.ndarray
    is_good: np.ndarray

    @classmethod
    def of(cls, samples: Samples, points: np.ndarray, centre: np.ndarray) -> Self:
        """Return the fits to the values at the points (s, c) of the patches."""
        arms = samples.at[points] - centre[:, None]
        size = np.sqrt((arms**2).sum(axis=2).max(axis=1))
        x, y = np.moveaxis(arms / size[:, None, None], -1, 0)
        degree = samples.degree
        powers = np.array([(i, k - i) for k in range(degree + 1) for i in range(k + 1)])
        terms = np.stack([x**i * y**j for i, j in powers], axis=-1)
        forms = samples.forms[points]
        s, c, f = forms.shape
        A = (forms[..., None] * terms[:, :, None]).reshape(s, c, -1)
        transposed = A.swapaxes(1, 2)
        normal = transposed @ A / c
        identity = np.broadcast_to(np.eye(A.shape[2]), normal.shape)
        pivot, inverse = solve_normal_equations(np.concatenate([normal, identity], axis=2))
        weights = (inverse @ transposed / c).reshape(s, f, len(powers), c)
        is_good = pivot > LEAST_GOOD_PIVOT**degree
        is_good &= c >= SPARE_POINTS * A.shape[2]
        return cls(points, centre, size, powers, weights, is_good)

    def weights_of(
        self, chosen: np.ndarray, at: np.ndarray, field: int, k: int, m: int
    ) -> np.ndarray:
        """Return (r, c) from values at the points to a field of chosen polynomials at (r, 2).

        The field is derived k times by X and m times by Y, at most once in all.
        """
        size = self.size[chosen]
        x, y = (at - self.centre[chosen]).T / size
        terms = np.array(
            [i**k * x ** max(i - k, 0) * j**m * y ** max(j - m, 0) for i, j in self.powers]
        )
        weights: np.ndarray = np.einsum("dr,rdc->rc", terms, self.weights[chosen, field])
        return weights / size[:, None] ** (k + m)


def _fits(X, samples: Samples, stencil, group, polynomials) -> Iterator[tuple]:
    """Yield numbers (t,) of polynomials, their numbers (t,) in a `Fit`, and the `Fit`.

    `polynomials` are the corner and the group of each. Where the patch does not
    determine the polynomial well, it has a ring or two more.
    """
    corner, own_group = polynomials
    remaining = np.arange(len(corner))
    for ring in range(samples.rings, MOST_RINGS + 1):
        own = corner[remaining], own_group[remaining]
        patches = _patches(samples, stencil, group, *own, ring)
        count = np.diff(patches.indptr)
        is_poor = np.zeros(len(remaining), bool)
        for size in np.unique(count):
            equal = np.flatnonzero(count == size)
            for chosen in np.array_split(equal, min(PORTIONS, len(equal))):
                numbers = patches.indices[patches.indptr[chosen, None] + np.arange(size)]
                fit = Fit.of(samples, numbers, X[corner[remaining[chosen]]])
                is_taken = fit.is_good | (ring == MOST_RINGS)
                is_poor[chosen[~is_taken]] = True
                yield remaining[chosen[is_taken]], np.flatnonzero(is_taken), fit
        remaining = remaining[is_poor]
        if not len(remaining):
            return


def _patches(samples: Samples, stencil, group, corner, own_group, rings: int) -> sparse.csr_matrix:
    """Return the points of the patches of corners: a sparse matrix (s, p) of numbers > 0.

    A patch of `rings` rings has only triangles of the group `own_group` (s,) of its polynomial.
    """
    m = len(stencil)
    s = len(corner)
    n = int(stencil.max()) + 1
    touches = _incidence(stencil[:, :3], m, n)  # triangle × corner
    nodes = sparse.csr_matrix((np.ones(s), (np.arange(s), corner)), shape=(s, n))
    for _ in range(rings):
        patch = (nodes @ touches.T).tocoo()
        is_own = group[patch.col] == own_group[patch.row]
        place = patch.row[is_own], patch.col[is_own]
        triangles = sparse.csr_matrix((np.ones(is_own.sum()), place), shape=(s, m))
        nodes = triangles @ touches
    patches = (triangles @ _incidence(samples.of_triangle, m, len(samples.at))).tocsr()
    patches.sort_indices()
    return patches


def _incidence(nodes: np.ndarray, m: int, n: int) -> sparse.csr_matrix:
    """Return a matrix (m, n) with a one where a triangle has a node of `nodes` (m, k)."""
    place = np.repeat(np.arange(m), nodes.shape[1]), nodes.ravel()
    return sparse.csr_matrix((np.ones(nodes.size), place), shape=(m, n))
