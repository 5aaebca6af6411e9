"""A smooth field from one that jumps between triangles, by polynomials fitted around each node.

Around each corner a polynomial is fitted, by least squares, to the values at points of the
triangles there. In a triangle the polynomials of its three corners are blended by the
barycentric coordinates. A finite element solution has its best derivatives at such points; so
the difference between the smooth field and the given one estimates the error of the given one.

Source: Zienkiewicz and Zhu (1987), A simple error estimator and adaptive procedure for practical
engineering analysis, for the estimate, and (1992), The superconvergent patch recovery and a
posteriori error estimates, for the fits. The blending and the widening of patches are our own.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.elements import ELEMENTS, blocks

TERMS = {1: 3, 2: 6}  # coefficients of a polynomial by its degree
LEAST = 0.02  # pivot, in patch sizes; below it (its square for degree 2) the patch is widened
SINGULAR = 1e-9  # pivot below which the points do not tell a coefficient
AT_ONCE = 1 << 14  # triangles or patches: their arrays take up to 50 MB


@dataclass(frozen=True, eq=False)
class Samples:
    """Where a field is given in each triangle, and where the smooth one is compared with it."""

    degree: int  # of the polynomials
    points: np.ndarray  # (q, 3) barycentric coordinates of the given values
    # (r, 3) points of comparison, and their shares (r,) of the area.
    rule: np.ndarray
    weights: np.ndarray
    extend: np.ndarray  # (r, q) the given field at them from its values at the `points`


THREE = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]]) / 6
_SIX = ELEMENTS["P2"].rule
SIX = np.column_stack([1 - _SIX[0].sum(axis=0), *_SIX[0]])
CONSTANT = Samples(1, np.full((1, 3), 1 / 3), THREE, np.full(3, 1 / 3), np.ones((3, 1)))
LINEAR = Samples(2, THREE, SIX, 2 * _SIX[1], SIX @ np.linalg.inv(THREE))
QUADRATIC = Samples(2, SIX, SIX, 2 * _SIX[1], np.eye(6))


def recovery_gap(
    X: np.ndarray, triangles: np.ndarray, group: np.ndarray, values: np.ndarray, samples: Samples
) -> np.ndarray:
    """(m, r, c) the smooth field minus the given one, at the rule's points of each triangle.

    X (n, 2) [m] are coordinates, `triangles` (m, 3) corners, and `values` (m, q, c) the given
    field at the points of `samples`. The `group` (m,) is equal where the field is smooth across
    edges; a fit takes triangles of one group.
    the node of each pair of a node and a group (s,), and the pair of each corner (m, 3)
    """
    groups = int(group.max()) + 1
    pairs, corner = np.unique(triangles * np.int64(groups) + group[:, None], return_inverse=True)
    node = pairs // groups
    corner = corner.reshape(-1, 3)
    size, fit = _fit_all(X, triangles, node, corner, values, samples)
    gap = -np.einsum("rq,tqc->trc", samples.extend, values)
    for part in blocks(len(triangles), AT_ONCE):
        at = samples.rule @ X[triangles[part]]
        around = corner[part]
        for i in range(3):  # the three polynomials, by the barycentric coordinates
            s = around[:, i]
            terms = _monomials((at - X[node[s], None]) / size[s, None, None], samples.degree)
            gap[part] += samples.rule[:, i, None] * np.einsum("tri,tic->trc", terms, fit[s])
    return gap


def _fit_all(X, triangles, node, corner, values, samples) -> tuple[np.ndarray, np.ndarray]:
    """Length (s,) [m] and coefficients (s, d, c) around pairs; patches too small are widened."""
    m = len(triangles)
    s = len(node)
    rows = corner.ravel(), np.repeat(np.arange(m), 3)
    around = sparse.csr_matrix((np.ones(3 * m), rows), shape=(s, m))
    size = np.zeros(s)
    fit = np.zeros((s, TERMS[samples.degree], values.shape[2]))
    left = np.arange(s)
    patch = around
    for ring in range(3):
        poor = np.zeros(len(left), bool)
        for part in blocks(len(left), AT_ONCE):
            fitted = _fit(X[node[left[part]]], X[triangles], values, samples, patch[part])
            size[left[part]], fit[left[part]], pivot, few = fitted
            poor[part] = few | (pivot < LEAST**samples.degree)
        left = left[poor]
        if ring == 2 or not len(left):
            break
        patch = patch[poor] @ around.T @ around
    return size, fit


def _monomials(at: np.ndarray, degree: int) -> np.ndarray:
    """(…, d) 1, x, y at points (…, 2), and of degree 2 also x², xy, y²."""
    x, y = at[..., 0], at[..., 1]
    terms = [np.ones_like(x), x, y]
    return np.stack(terms if degree == 1 else [*terms, x * x, x * y, y * y], axis=-1)


def _fit(centre, corners, values, samples, patch):
    """Fit a polynomial to the triangles in each row of `patch`, around its centre (k, 2).

    Returns the lengths (k,), the coefficients (k, d, c), the least pivots (k,), and whether
    there are too few points (k,).
    """
    starts = patch.indptr[:-1]
    entries = patch.indices
    count = np.diff(patch.indptr)
    row = np.repeat(np.arange(len(centre)), count)
    arms = corners[entries] - centre[row, None]
    length = np.sqrt(np.add.reduceat((arms**2).sum(axis=(1, 2)), starts) / (3 * count))
    terms = _monomials(samples.points @ arms / length[row, None, None], samples.degree)
    known = np.concatenate([terms, values[entries]], axis=2)
    sums = np.add.reduceat(np.einsum("eqi,eqj->eij", terms, known), starts)
    points = count * len(samples.points)
    pivot, solution = _solve(sums / points[:, None, None])
    return length, solution, pivot, points <= terms.shape[2]


def _solve(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least pivots (k,) of A (k, d, d + c), and A₁⁻¹ A₂ (k, d, c) of its two parts."""
    # By Gauss and Jordan. The coefficient of a pivot below `SINGULAR` is zero.
    least = np.full(len(A), np.inf)
    d = A.shape[1]
    for i in range(d):
        pivot = A[:, i, i].copy()
        least = np.minimum(least, pivot)
        row = A[:, i] / np.where(pivot > SINGULAR, pivot, np.inf)[:, None]
        A -= A[:, :, i, None] * row[:, None]
        A[:, i] = row
    return least, A[:, :, d:]
