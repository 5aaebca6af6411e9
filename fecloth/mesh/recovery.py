"""A smooth field from one that jumps between triangles, by polynomials fitted around each node.

Around each corner a polynomial is fitted, by least squares, to the values at points of the
triangles there. In a triangle the polynomials of its three corners are blended by the
barycentric coordinates. A finite element solution has its best derivatives at such points. So
the difference between the smooth field and the given field estimates the error of the given
field.

Source: Zienkiewicz and Zhu (1987), A simple error estimator and adaptive procedure for practical
engineering analysis, for the estimate, and (1992), The superconvergent patch recovery and a
posteriori error estimates, for the fits. The blending and the widening of patches are our own.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.elements import ELEMENTS, blocks

EDGES = ((0, 1), (1, 2), (0, 2))  # the corners beside the nodes 3, 4 and 5 of a triangle
TERMS = {1: 3, 2: 6}  # number of coefficients of a polynomial by its degree
# A patch whose least pivot is smaller is widened; the pivot is in patch sizes, and for degree 2
# its limit is the square of this.
LEAST_GOOD_PIVOT = 0.02
# A pivot below this is round-off: the points do not determine its coefficient, which is zero.
LEAST_PIVOT = 1e-9
WIDENED = 2  # how often a patch is widened, at most
BLOCK_SIZE = 1 << 14  # triangles or patches at once: their arrays take up to 50 MB


@dataclass(frozen=True, eq=False)
class Samples:
    """Where a field is given in each triangle, and where the smooth field is compared with it.

    Attributes
    ----------
    degree
        Degree of the polynomials.
    points
        (q, 3) barycentric coordinates of the points where the field is given.
    rule
        (r, 3) barycentric coordinates of the points of comparison.
    weights
        (r,) shares of the area for the points of comparison.
    extend
        (r, q) matrix from the values at `points` to the given field at the points of `rule`.
    """

    degree: int
    points: np.ndarray
    rule: np.ndarray
    weights: np.ndarray
    extend: np.ndarray


THREE = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]]) / 6
_SIX = ELEMENTS["P2"].rule
SIX = np.column_stack([1 - _SIX[0].sum(axis=0), *_SIX[0]])
MIDDLES = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]]) / 2
CONSTANT = Samples(1, np.full((1, 3), 1 / 3), THREE, np.full(3, 1 / 3), np.ones((3, 1)))
LINEAR = Samples(2, THREE, SIX, 2 * _SIX[1], SIX @ np.linalg.inv(THREE))
QUADRATIC = Samples(2, SIX, SIX, 2 * _SIX[1], np.eye(6))
# A stress of P2 is most accurate at the midpoints of edges (Zienkiewicz and Zhu 1992, Int. J.
# Numer. Meth. Engng 33, 1331–1364).
AT_MIDDLES = Samples(2, MIDDLES, SIX, 2 * _SIX[1], SIX @ np.linalg.inv(MIDDLES))


def to_middles(samples: Samples) -> np.ndarray:
    """Return the matrix (3, q) from values at the points of samples to the midpoints of edges.

    It is exact for the polynomial in a triangle that the values determine.
    """

    def terms(points):
        a, b, _ = points.T
        linear = [np.ones_like(a), a, b]
        return np.stack([*linear, a * a, a * b, b * b][: len(samples.points)], axis=1)

    return terms(MIDDLES) @ np.linalg.inv(terms(samples.points))


def recovery_gap(
    X: np.ndarray, triangles: np.ndarray, group: np.ndarray, values: np.ndarray, samples: Samples
) -> np.ndarray:
    """Return the smooth field minus the given field, (m, r, c), at the points of `samples.rule`.

    A node has one polynomial for each group of triangles around it. In the code a pair is a
    node and a group.

    Parameters
    ----------
    X
        (n, 2) coordinates of the nodes [m].
    triangles
        (m, 3) corners.
    group
        (m,) equal where the field is smooth across edges; a fit takes triangles of one group.
    values
        (m, q, c) the given field at the points of `samples`.
    samples
        Where the field is given and compared.
    """
    node, pair_of_corner = _pairs(triangles, group)
    size, coefficients = _fit_all(X, triangles, node, pair_of_corner, values, samples)
    # The given field with a minus; the smooth field is added in blocks.
    gap = -np.einsum("rq,tqc->trc", samples.extend, values)
    for part in blocks(len(triangles), BLOCK_SIZE):
        at = samples.rule @ X[triangles[part]]
        for i in range(3):  # the polynomials of the corners, weighted by barycentric coordinates
            pair = pair_of_corner[part, i]
            local = (at - X[node[pair], None]) / size[pair, None, None]
            terms = _monomials(local, samples.degree)
            polynomial = np.einsum("tri,tic->trc", terms, coefficients[pair])
            gap[part] += samples.rule[:, i, None] * polynomial
    return gap


def recover_at_nodes(
    X: np.ndarray,
    triangles: np.ndarray,
    group: np.ndarray,
    values: np.ndarray,
    samples: Samples,
    cells: np.ndarray,
) -> np.ndarray:
    """Return the smooth field (n, c) at the nodes.

    `cells` (m, k) are the nodes of the triangles, the corners first. At a corner it is the
    polynomial there, and at the midpoint of an edge the mean of the polynomials of both ends.
    Where groups meet it is the mean of their fields. Other arguments are as for `recovery_gap`.
    """
    node, of_corner = _pairs(triangles, group)
    size, coefficients = _fit_all(X, triangles, node, of_corner, values, samples)
    sums = np.zeros((len(X), values.shape[2]))
    count = np.zeros((len(X), 1))
    for a in range(cells.shape[1]):
        at = cells[:, a]
        ends = (a,) if a < 3 else EDGES[a - 3]
        for end in ends:
            pair = of_corner[:, end]
            local = (X[at] - X[node[pair]]) / size[pair, None]
            np.add.at(
                sums,
                at,
                np.einsum("tj,tjc->tc", _monomials(local, samples.degree), coefficients[pair]),
            )
            np.add.at(count, at, 1.0)
    return sums / count


@dataclass(frozen=True, eq=False)
class RecoveryAtPoint:
    """The smooth field at a point, as a weighted sum of values of the given field near it.

    Attributes
    ----------
    triangles
        (k,) numbers of the triangles that count.
    weights
        (k, q) weights of the values at the points of the samples of these triangles.
    """

    triangles: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(
        cls,
        X: np.ndarray,
        triangles: np.ndarray,
        group: np.ndarray,
        samples: Samples,
        point: np.ndarray,
        cell: int,
    ) -> "RecoveryAtPoint":
        """Return the weights for a `point` (2,) in the triangle number `cell`.

        The smooth field is linear in the given values: its weights are the smooth fields of
        values that are 1 at one point of one triangle, and 0 elsewhere. Other arguments are as
        for `recovery_gap`.
        """
        near = _triangles_around(triangles, group, cell)
        q = len(samples.points)
        units = np.eye(len(near) * q).reshape(len(near), q, -1)
        pairs = _pairs(triangles[near], group[near])
        size, coefficients = _fit_all(
            X, triangles[near], pairs.node, pairs.of_corner, units, samples
        )
        own = pairs.of_corner[np.flatnonzero(near == cell)[0]]  # pairs of the three corners
        terms = _monomials((point - X[pairs.node[own]]) / size[own, None], samples.degree)
        share = _barycentric(X[triangles[cell]], point)
        weights = np.einsum("i,ij,ijc->c", share, terms, coefficients[own])
        return cls(near, weights.reshape(len(near), q))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return the smooth field (c,) from the given field (k, q, c) in `triangles`."""
        smooth: np.ndarray = np.einsum("kq,kqc->c", self.weights, values)
        return smooth


def _triangles_around(triangles: np.ndarray, group: np.ndarray, cell: int) -> np.ndarray:
    """Return the triangles of the group of `cell` from which its corners take their fits.

    These are three rings of triangles around the cell: a patch is widened two times at most.
    """
    is_near = np.arange(len(triangles)) == cell
    for _ in range(WIDENED + 1):
        corners = np.unique(triangles[is_near])
        is_near = np.isin(triangles, corners).any(axis=1) & (group == group[cell])
    return np.flatnonzero(is_near)


def _barycentric(corners: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the barycentric coordinates (3,) of a point (2,) in the triangle `corners` (3, 2)."""
    return np.linalg.solve(np.vstack([corners.T, np.ones(3)]), [*point, 1.0])


class Pairs(NamedTuple):
    """Pairs of a node and a group of triangles around it.

    Attributes
    ----------
    node
        (s,) node of each pair.
    of_corner
        (m, 3) pair of each corner.
    """

    node: np.ndarray
    of_corner: np.ndarray


def _pairs(triangles: np.ndarray, group: np.ndarray) -> Pairs:
    """Return the pairs of the corners (m, 3) of triangles, whose groups are `group` (m,)."""
    groups = int(group.max()) + 1
    keys = triangles * np.int64(groups) + group[:, None]
    pairs, pair_of_corner = np.unique(keys, return_inverse=True)
    return Pairs(pairs // groups, pair_of_corner.reshape(-1, 3))


def _fit_all(X, triangles, node, pair_of_corner, values, samples) -> tuple[np.ndarray, np.ndarray]:
    """Return the lengths (s,) [m] and coefficients (s, d, c) of the polynomials of all pairs.

    A polynomial is in coordinates from its node, divided by its length. `node` (s,) is the node
    of each pair, and `pair_of_corner` (m, 3) the pair of each corner; see `recovery_gap` for the
    other arguments.

    The first patch of a pair has the triangles around its node that are of its group. Where they
    do not determine the polynomial well, the patch gets the triangles around these, up to two
    times.
    """
    m = len(triangles)
    s = len(node)
    place = pair_of_corner.ravel(), np.repeat(np.arange(m), 3)
    around = sparse.csr_matrix((np.ones(3 * m), place), shape=(s, m))  # triangles of each pair
    size = np.zeros(s)
    coefficients = np.zeros((s, TERMS[samples.degree], values.shape[2]))
    remaining = np.arange(s)  # pairs whose patch is not good enough yet
    patch = around
    for ring in range(WIDENED + 1):
        is_poor = np.zeros(len(remaining), bool)
        for part in blocks(len(remaining), BLOCK_SIZE):
            pairs = remaining[part]
            fitted = _fit(X[node[pairs]], X[triangles], values, samples, patch[part])
            size[pairs], coefficients[pairs], pivot, has_too_few = fitted
            is_poor[part] = has_too_few | (pivot < LEAST_GOOD_PIVOT**samples.degree)
        remaining = remaining[is_poor]
        if ring == WIDENED or not len(remaining):
            break
        patch = patch[is_poor] @ around.T @ around
    return size, coefficients


def _monomials(at: np.ndarray, degree: int) -> np.ndarray:
    """(…, d) 1, x, y at points (…, 2), and of degree 2 also x², xy, y²."""
    x, y = np.moveaxis(at, -1, 0)
    terms = [np.ones_like(x), x, y]
    if degree == 2:
        terms += [x * x, x * y, y * y]
    return np.stack(terms, axis=-1)


def _fit(centre, corners, values, samples, patch):
    """Fit a polynomial to the values in the triangles of each patch, by least squares.

    Row i of the sparse matrix `patch` (k, m) has the triangles of patch i, and `centre` (k, 2)
    is its node [m]. `corners` (m, 3, 2) and `values` (m, q, c) are of all triangles.

    Returns for each patch its length (k,) [m], the coefficients (k, d, c) in coordinates from
    the centre divided by this length, the least pivot (k,), and whether there are too few points
    to determine the coefficients (k,).
    """
    starts = patch.indptr[:-1]
    entries = patch.indices
    count = np.diff(patch.indptr)
    row = np.repeat(np.arange(len(centre)), count)
    arms = corners[entries] - centre[row, None]
    length = np.sqrt(np.add.reduceat((arms**2).sum(axis=(1, 2)), starts) / (3 * count))
    terms = _monomials(samples.points @ arms / length[row, None, None], samples.degree)
    # The normal equations of least squares: products of the terms with the terms and the values.
    terms_and_values = np.concatenate([terms, values[entries]], axis=2)
    sums = np.add.reduceat(np.einsum("eqi,eqj->eij", terms, terms_and_values), starts)
    points = count * len(samples.points)
    pivot, solution = _solve(sums / points[:, None, None])
    return length, solution, pivot, points <= terms.shape[2]


def _solve(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least pivots (k,) and A₁⁻¹ A₂ (k, d, c) for A = (A₁, A₂) (k, d, d + c).

    By the elimination of Gauss and Jordan, without a search for pivots: A₁ is symmetric and has
    no negative eigenvalue. The coefficient of a pivot below `LEAST_PIVOT` is zero. A is
    overwritten.
    """
    least = np.full(len(A), np.inf)
    d = A.shape[1]
    for i in range(d):
        pivot = A[:, i, i].copy()
        least = np.minimum(least, pivot)
        row = A[:, i] / np.where(pivot > LEAST_PIVOT, pivot, np.inf)[:, None]
        A -= A[:, :, i, None] * row[:, None]
        A[:, i] = row
    return least, A[:, :, d:]
