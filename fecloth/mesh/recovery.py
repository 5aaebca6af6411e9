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

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.elements import ELEMENTS, blocks

TERMS = {1: 3, 2: 6}  # number of coefficients of a polynomial by its degree
# A patch whose least pivot is smaller is widened; the pivot is in patch sizes, and for degree 2
# its limit is the square of this.
LEAST_GOOD_PIVOT = 0.02
# A pivot below this is round-off: the points do not determine its coefficient, which is zero.
LEAST_PIVOT = 1e-9
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
CONSTANT = Samples(1, np.full((1, 3), 1 / 3), THREE, np.full(3, 1 / 3), np.ones((3, 1)))
LINEAR = Samples(2, THREE, SIX, 2 * _SIX[1], SIX @ np.linalg.inv(THREE))
QUADRATIC = Samples(2, SIX, SIX, 2 * _SIX[1], np.eye(6))


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
    groups = int(group.max()) + 1
    keys = triangles * np.int64(groups) + group[:, None]
    pairs, pair_of_corner = np.unique(keys, return_inverse=True)
    node = pairs // groups
    pair_of_corner = pair_of_corner.reshape(-1, 3)
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
    for ring in range(3):
        is_poor = np.zeros(len(remaining), bool)
        for part in blocks(len(remaining), BLOCK_SIZE):
            pairs = remaining[part]
            fitted = _fit(X[node[pairs]], X[triangles], values, samples, patch[part])
            size[pairs], coefficients[pairs], pivot, has_too_few = fitted
            is_poor[part] = has_too_few | (pivot < LEAST_GOOD_PIVOT**samples.degree)
        remaining = remaining[is_poor]
        if ring == 2 or not len(remaining):
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
    pivot, solution = solve_normal_equations(sums / points[:, None, None])
    return length, solution, pivot, points <= terms.shape[2]


def solve_normal_equations(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
