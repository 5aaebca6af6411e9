"""A smooth field from one that jumps between triangles, by polynomials fitted around each node.

Around each corner a polynomial is fitted, by least squares, to the values at points of the
triangles there. In a triangle the polynomials of its three corners are blended by the barycentric
coordinates. A finite element solution has its best derivatives at such points; so the difference
between the smooth field and the given one estimates the error of the given one.

Source: Zienkiewicz and Zhu (1987), A simple error estimator and adaptive procedure for practical
engineering analysis, for the estimate, and (1992), The superconvergent patch recovery and a
posteriori error estimates, for the fits. The blending and the widening of patches are our own.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import inner, kernel
from fecloth.mesh.elements import ELEMENTS

TERMS = {1: 3, 2: 6}  # coefficients of a polynomial by its degree
LEAST = 0.02  # pivot, in patch sizes; below it (its square for degree 2) the patch is widened
SINGULAR = 1e-9  # pivot below which the points do not tell a coefficient


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
    """(m, r, c) the smooth field minus the given one, at the rule's points of each triangle."""
    # X (n, 2) [m] are coordinates, `triangles` (m, 3) corners, and `values` (m, q, c) the given
    # field at the points of `samples`. The `group` (m,) is equal where the field is smooth across
    # edges; a fit takes triangles of one group.
    # the node of each pair of a node and a group (s,), and the pair of each corner (m, 3)
    groups = int(group.max()) + 1
    pairs, corner = np.unique(triangles * np.int64(groups) + group[:, None], return_inverse=True)
    node, corner = pairs // groups, corner.reshape(-1, 3)
    size, fit = _fit_all(X, triangles, node, corner, values, samples)
    gap = -np.einsum("rq,tqc->trc", samples.extend, values)
    terms = np.empty(TERMS[samples.degree])
    _add_blend(X, triangles, node, size, corner, samples.rule, fit, terms, gap)
    return gap


def _fit_all(X, triangles, node, corner, values, samples) -> tuple[np.ndarray, np.ndarray]:
    """Length (s,) [m] and coefficients (s, d, c) around pairs; patches too small are widened."""
    m, s = len(triangles), len(node)
    rows = corner.ravel(), np.repeat(np.arange(m), 3)
    around = sparse.csr_matrix((np.ones(3 * m), rows), shape=(s, m))
    size, fit = np.zeros(s), np.zeros((s, TERMS[samples.degree], values.shape[2]))
    left, patch, d = np.arange(s), around, fit.shape[1]
    gram, terms = np.empty((d, d)), np.empty(d)
    for ring in range(3):
        data = X, triangles, node, samples.points, values, patch.indptr, patch.indices
        poor = np.zeros(len(left), bool)
        fit[left] = 0.0
        _fit(*data, left, LEAST if ring < 2 else 0.0, gram, terms, size, fit, poor)
        left = left[poor]
        if not len(left):
            break
        patch = patch[poor] @ around.T @ around
    return size, fit


@inner
def _fill_monomials(x, y, terms):
    """terms = 1, x, y, and of degree 2 also x², xy, y²."""
    terms[0], terms[1], terms[2] = 1.0, x, y
    if len(terms) == 6:
        terms[3], terms[4], terms[5] = x * x, x * y, y * y


@inner
def _solve(gram, right, least):
    """right = gram⁻¹ right by Cholesky's factor; return whether a pivot lies below `least`."""
    # The coefficient of a pivot below `SINGULAR` is zero.
    d, columns, poor = len(gram), right.shape[1], False
    for i in range(d):
        for j in range(i + 1):
            total = gram[i, j]
            for k in range(j):
                total -= gram[i, k] * gram[j, k]
            if i > j:
                gram[i, j] = total / gram[j, j]
            else:
                poor = poor or total < least
                gram[i, i] = np.sqrt(total) if total > SINGULAR else np.inf
    for c in range(columns):
        for i in range(d):
            for k in range(i):
                right[i, c] -= gram[i, k] * right[k, c]
            right[i, c] /= gram[i, i]
        for i in range(d - 1, -1, -1):
            for k in range(i + 1, d):
                right[i, c] -= gram[k, i] * right[k, c]
            right[i, c] /= gram[i, i]
    return poor


@kernel
def _fit(
    X, triangles, node, points, values, start, entries, pairs, least, gram, terms, size, fit, poor
):
    """Fit the polynomials of `pairs`, zero so far, to the triangles `entries` of their patches."""
    d, columns = fit.shape[1], fit.shape[2]
    for p in range(len(pairs)):
        s = pairs[p]
        right = fit[s]
        x0, y0 = X[node[s], 0], X[node[s], 1]
        far, first, last = 0.0, start[p], start[p + 1]
        for e in range(first, last):
            for i in range(3):
                a = triangles[entries[e], i]
                far += (X[a, 0] - x0) ** 2 + (X[a, 1] - y0) ** 2
        length = np.sqrt(far / (3 * (last - first)))
        for i in range(d):  # one by one: a slice would take longer to compile than all the rest
            for j in range(d):
                gram[i, j] = 0.0
        count = (last - first) * len(points)
        for e in range(first, last):
            t = entries[e]
            for q in range(len(points)):
                x = y = 0.0
                for i in range(3):
                    x += points[q, i] * (X[triangles[t, i], 0] - x0) / length
                    y += points[q, i] * (X[triangles[t, i], 1] - y0) / length
                _fill_monomials(x, y, terms)
                for i in range(d):
                    for j in range(i + 1):
                        gram[i, j] += terms[i] * terms[j] / count
                    for c in range(columns):
                        right[i, c] += terms[i] * values[t, q, c] / count
        poor[p] = _solve(gram, right, least ** (1 if d == 3 else 2)) or (count <= d and least > 0.0)
        size[s] = length


@kernel
def _add_blend(X, triangles, node, size, corner, rule, fit, terms, out):
    """out (m, r, c) += the three polynomials of each triangle, by the barycentric coordinates."""
    d, columns = fit.shape[1], fit.shape[2]
    for t in range(len(triangles)):
        for r in range(len(rule)):
            x = y = 0.0
            for i in range(3):
                x += rule[r, i] * X[triangles[t, i], 0]
                y += rule[r, i] * X[triangles[t, i], 1]
            for i in range(3):
                s = corner[t, i]
                dx, dy = x - X[node[s], 0], y - X[node[s], 1]
                _fill_monomials(dx / size[s], dy / size[s], terms)
                for k in range(d):
                    for c in range(columns):
                        out[t, r, c] += rule[r, i] * terms[k] * fit[s, k, c]
