"""The largest value of a nodal field on a cloth, also where it lies inside a triangle."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sparse

from fecloth.mesh.cloth import Cloth

COEFFICIENTS = 6  # of a quadratic polynomial in the plane
EDGES = ((0, 1, 3), (1, 2, 4), (2, 0, 5))  # ends and midpoint in `Cloth.cells` of P2


@dataclass(frozen=True, eq=False)
class Peak:
    """Finds the largest value of a field on a cloth.

    A field of P2 is quadratic in each triangle. To a field of P1 a quadratic polynomial is
    fitted around its highest node; with the curvature of the polynomial the field is quadratic
    in the triangles there. The largest value at a node would be too small by up to
    h² |curvature| / 8, an error that jumps from mesh to mesh.

    Attributes
    ----------
    X
        (n, 2) reference coordinates of the nodes [m].
    cells
        (m, 3) or (m, 6) nodes of the triangles, see `Cloth.cells`.
    around
        (n, m) matrix with the triangles of each node in its row.
    """

    X: np.ndarray
    cells: np.ndarray
    around: sparse.csr_matrix

    @classmethod
    def on(cls, cloth: Cloth) -> Self:
        """Return what finds the largest value on a cloth."""
        m, k = cloth.cells.shape
        entries = np.ones(k * m), (cloth.cells.ravel(), np.repeat(np.arange(m), k))
        around = sparse.csr_matrix(entries, shape=(len(cloth.X), m))
        return cls(cloth.X, cloth.cells, around)

    def largest(self, values: np.ndarray) -> float:
        """Return the largest value of a nodal field (n,), NaN if a value is NaN."""
        node = int(np.argmax(values))
        if self.cells.shape[1] == COEFFICIENTS:
            in_triangles = _that_may_exceed(values[node], values[self.cells])
        else:
            in_triangles = self._recovered(node, values)
        return max([float(values[node]), *_stationary_values(in_triangles)])

    def _triangles_of(self, nodes: np.ndarray) -> np.ndarray:
        """Return the triangles of some nodes."""
        rows = self.around.indptr
        triangles = [self.around.indices[rows[node] : rows[node + 1]] for node in nodes]
        return np.unique(np.concatenate(triangles))

    def _recovered(self, node: int, values: np.ndarray) -> np.ndarray:
        """Return (k, 6) values at the corners and midpoints of the triangles of a node.

        A midpoint of the edge e has the mean of its ends − ⅛ e · H e, with the second derivatives
        H of the polynomial that fits the nodes of these triangles and of their neighbours. If the
        nodes do not determine it, k is 0.
        """
        nearest = self.cells[self._triangles_of(np.array([node]))]
        fitted = np.unique(self.cells[self._triangles_of(np.unique(nearest))])
        arms = self.X[fitted] - self.X[node]
        size = np.abs(arms).max()
        x, y = (arms / size).T
        monomials = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
        heights = values[fitted] - values[node]  # small, so that little is lost by round-off
        coefficients, _, rank, _ = np.linalg.lstsq(monomials, heights, rcond=1e-9)
        if rank < COEFFICIENTS or not np.isfinite(coefficients).all():
            return np.zeros((0, COEFFICIENTS))
        _, _, _, xx, xy, yy = coefficients / size**2
        H = np.array([[2 * xx, xy], [xy, 2 * yy]])
        edges = np.roll(self.X[nearest], -1, axis=1) - self.X[nearest]
        corners = values[nearest]
        means = (corners + np.roll(corners, -1, axis=1)) / 2
        midpoints = means - np.einsum("kei,ij,kej->ke", edges, H, edges) / 8
        return np.hstack([corners, midpoints])


def _that_may_exceed(level: float, u: np.ndarray) -> np.ndarray:
    """Return those rows of u (m, 6) whose quadratic polynomial may exceed a level.

    It is at most as large as the largest of its Bernstein coefficients.
    """
    ends = (u[:, :3] + np.roll(u[:, :3], -1, axis=1)) / 2
    return u[(2 * u[:, 3:] - ends > level).any(axis=1)]


def _stationary_values(u: np.ndarray) -> np.ndarray:
    """Return the maxima on edges and inside of triangles, of quadratic fields u (m, 6).

    There are none where a field has its maximum at a corner, or no maximum.
    """
    maxima = []
    for start, end, middle in EDGES:
        a, b, c = u[:, start], u[:, end], u[:, middle]
        slope = 4 * c - 3 * a - b  # of a + slope s + half_bend s², 0 ≤ s ≤ 1
        half_bend = 2 * (a + b - 2 * c)
        is_inside = (half_bend < 0) & (slope > 0) & (slope < -2 * half_bend)
        maxima.append((a - slope**2 / (4 * half_bend + ~is_inside))[is_inside])
    # u0 + g · s + ½ s · H s on the unit triangle s₁, s₂ ≥ 0, s₁ + s₂ ≤ 1
    u0, u1, u2, u01, u12, u20 = u.T
    g1 = 4 * u01 - 3 * u0 - u1
    g2 = 4 * u20 - 3 * u0 - u2
    H11 = 4 * (u0 + u1 - 2 * u01)
    H22 = 4 * (u0 + u2 - 2 * u20)
    H12 = 4 * (u0 + u12 - u01 - u20)
    det = H11 * H22 - H12**2
    is_peak = (H11 < 0) & (det > 0)
    det = np.where(is_peak, det, 1.0)
    s1 = (H12 * g2 - H22 * g1) / det
    s2 = (H12 * g1 - H11 * g2) / det
    is_inside = is_peak & (s1 > 0) & (s2 > 0) & (s1 + s2 < 1)
    maxima.append((u0 + (g1 * s1 + g2 * s2) / 2)[is_inside])
    return np.concatenate(maxima)
