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
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

MOST_RINGS = 4  # of triangles in a patch
SPARE_NODES = 1.3  # nodes of a patch over the coefficients of its polynomial, at least
# The least singular value of a good fit over the largest one, in lengths of the patch.
LEAST_SINGULAR = 1e-3


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
    parts = list(_fits(X, stencil, group, rows, degree))
    index = np.concatenate([np.broadcast_to(row, nodes.shape).ravel() for row, nodes, _ in parts])
    column = np.concatenate([nodes.ravel() for _, nodes, _ in parts])
    shape = len(rows.corner), len(X)

    def matrix(axis: int) -> sparse.csr_matrix:
        values = np.concatenate([weights[:, axis].ravel() for _, _, weights in parts])
        return sparse.csr_matrix((values, (index, column)), shape=shape)

    return RecoveredGradient(matrix(0), matrix(1))


def _fits(X, stencil, group, rows: Rows, degree: int) -> Iterator[tuple]:
    """Yield, for rows whose patches have equally many nodes, what their gradients are made of.

    These are the numbers of the rows (s, 1), the nodes of their patches (s, c), and the weights
    (s, 2, c) of the values at these nodes [1/m].
    """
    remaining = np.arange(len(rows.corner))
    for ring in range(1, MOST_RINGS + 1):
        patches = _patches(len(X), stencil, group, rows, remaining, ring)
        count = np.diff(patches.indptr)
        is_poor = np.zeros(len(remaining), bool)
        for size in np.unique(count):
            chosen = np.flatnonzero(count == size)
            nodes = np.stack([patches.indices[patches.indptr[i] :][:size] for i in chosen])
            row = remaining[chosen]
            weights, is_good = _weights(X, nodes, X[rows.corner[row]], rows.at[row], degree)
            is_good |= ring == MOST_RINGS
            is_poor[chosen[~is_good]] = True
            if is_good.any():
                yield row[is_good, None], nodes[is_good], weights[is_good]
        remaining = remaining[is_poor]
        if not len(remaining):
            return


def _patches(
    n: int, stencil, group, rows: Rows, chosen: np.ndarray, rings: int
) -> sparse.csr_matrix:
    """Return the nodes of the patches of chosen rows: a sparse matrix (s, n)."""
    m = len(stencil)
    corners = stencil[:, :3]
    touches = _incidence(corners, m, n)  # triangle × corner
    is_start = sparse.csr_matrix(
        (np.ones(len(chosen)), (np.arange(len(chosen)), rows.corner[chosen])),
        shape=(len(chosen), n),
    )
    nodes = is_start
    for _ in range(rings):
        patch = (nodes @ touches.T).tocoo()
        is_own = group[patch.col] == rows.group[chosen][patch.row]
        triangles = sparse.csr_matrix(
            (np.ones(is_own.sum()), (patch.row[is_own], patch.col[is_own])), shape=patch.shape
        )
        nodes = triangles @ touches
    patches = (triangles @ _incidence(stencil, m, n)).tocsr()
    patches.sort_indices()
    return patches


def _incidence(nodes: np.ndarray, m: int, n: int) -> sparse.csr_matrix:
    """Return a matrix (m, n) with a one where a triangle has a node of `nodes` (m, k)."""
    place = np.repeat(np.arange(m), nodes.shape[1]), nodes.ravel()
    return sparse.csr_matrix((np.ones(nodes.size), place), shape=(m, n))


def _weights(X, nodes, centre, at, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (s, 2, c) of gradients at places `at` (s, 2), and which fits are good.

    The polynomials have coordinates from their `centre` (s, 2), over the size of the patch.
    """
    arms = X[nodes] - centre[:, None]
    size = np.sqrt((arms**2).sum(axis=2).max(axis=1))
    powers = [(i, total - i) for total in range(degree + 1) for i in range(total + 1)]
    local = arms / size[:, None, None]
    A = np.stack([local[..., 0] ** i * local[..., 1] ** j for i, j in powers], axis=-1)
    singular = np.linalg.svd(A, compute_uv=False)
    is_good = nodes.shape[1] >= SPARE_NODES * len(powers)
    is_good = is_good & (singular[:, -1] > LEAST_SINGULAR * singular[:, 0])
    x, y = ((at - centre) / size[:, None]).T
    along_x = [i * x ** max(i - 1, 0) * y**j for i, j in powers]
    along_y = [j * x**i * y ** max(j - 1, 0) for i, j in powers]
    slopes = np.stack([np.stack(along_x, -1), np.stack(along_y, -1)], axis=1)
    weights = slopes @ np.linalg.pinv(A, rcond=1e-9) / size[:, None, None]
    return weights, is_good
