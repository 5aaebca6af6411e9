"""Mortar weights: one sewn edge follows another one, whose nodes may lie elsewhere.

With u on the edge that follows, U on the edge that leads and multipliers ψ_i,

    ∫ ψ_i (u − U) ds = 0    for each node i between the ends,    u = U at both ends.

Source: Bernardi, Maday and Patera (1994), A new nonconforming approach to domain decomposition:
the mortar element method. The multipliers are dual to the shape functions of the edge that
follows, ∫ ψ_i φ_j ds = 0 for i ≠ j, so that u_i depends on the nodes near it only: Wohlmuth
(2000), A mortar finite element method using dual spaces for the Lagrange multiplier, SIAM J.
Numer. Anal. 38. Integrals are over the common pieces of both edges, and exact.
"""

import numpy as np
import scipy.sparse as sparse
from numpy.polynomial.legendre import leggauss

SAME_PLACE = 1e-9  # of the length of an edge: nodes that are as near match
NEGLIGIBLE_WEIGHT = 1e-14


def mortar_weights(places: np.ndarray, leading: np.ndarray, degree: int) -> sparse.csr_matrix:
    """Return the weights W of u = W U, where u and U are the values at the nodes of two edges.

    Parameters
    ----------
    places, leading
        (k + 1,) and (l + 1,) where the corners of the edge that follows, and of the one that
        leads, lie along it: from 0 to 1, ascending.
    degree
        1, or 2 with a node in the middle between two corners.

    Returns
    -------
    scipy.sparse.csr_matrix
        (degree k + 1, degree l + 1), with sums of rows of 1.

    Examples
    --------
    >>> half, third = np.linspace(0, 1, 3), np.linspace(0, 1, 4)
    >>> mortar_weights(third, half, 1).toarray().round(3).tolist()
    [[1.0, 0.0, 0.0], [0.292, 0.75, -0.042], [-0.042, 0.75, 0.292], [0.0, 0.0, 1.0]]
    """
    if len(places) == len(leading) and np.abs(places - leading).max() <= SAME_PLACE:
        return sparse.identity(degree * (len(places) - 1) + 1, format="csr")
    D, B = _integrals(places, leading, degree)
    last = D.shape[0] - 1
    inside = np.arange(1, last)
    W = sparse.lil_matrix(B.shape)
    W[0, 0] = W[last, -1] = 1.0
    if len(inside):
        # D_ii u_i = Σ B_ij U_j − D_i0 U_0 − D_iN U_N, as u = U at the ends
        known = B.copy()
        known[:, [0]] -= D[:, [0]]
        known[:, [-1]] -= D[:, [last]]
        rows = known[inside].toarray() / D.diagonal()[inside, None]
        rows[abs(rows) < NEGLIGIBLE_WEIGHT] = 0.0
        W[inside] = rows
    return W.tocsr()


def common_pieces(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The ends, ascending, of the pieces between the places on one edge and on another one."""
    cuts = np.unique(np.concatenate([places, others]))
    return cuts[np.append(True, np.diff(cuts) > SAME_PLACE)]


def _integrals(
    places: np.ndarray, leading: np.ndarray, degree: int
) -> tuple[sparse.csr_matrix, sparse.lil_matrix]:
    """Return D_ij = ∫ ψ_i φ_j ds and B_ij = ∫ ψ_i Φ_j ds, with the Φ of the leading edge."""
    cuts = common_pieces(places, leading)
    points, weights = leggauss(degree + 1)
    size = np.diff(cuts)[:, None]
    s = (cuts[:-1, None] + size * (points + 1) / 2).ravel()
    ds = sparse.diags((size * weights / 2).ravel())
    phi, phi_of_leader = (_shapes(edge, s, degree) for edge in (places, leading))
    psi = _multipliers(places, s, degree)
    return (psi.T @ ds @ phi).tocsr(), (psi.T @ ds @ phi_of_leader).tolil()


def _local_shapes(xi: np.ndarray, degree: int) -> np.ndarray:
    """(p, degree + 1) Lagrange's shape functions at points ξ (p,) of an interval from 0 to 1."""
    if degree == 1:
        return np.column_stack([1 - xi, xi])
    return np.column_stack([(1 - xi) * (1 - 2 * xi), 4 * xi * (1 - xi), xi * (2 * xi - 1)])


def _scatter(values: np.ndarray, interval: np.ndarray, corners: int) -> sparse.csr_matrix:
    """(p, nodes) the values (p, degree + 1) at p points, in the columns of their nodes."""
    degree = values.shape[1] - 1
    columns = degree * interval[:, None] + np.arange(degree + 1)
    rows = np.repeat(np.arange(len(values)), degree + 1)
    shape = len(values), degree * (corners - 1) + 1
    return sparse.csr_matrix((values.ravel(), (rows, columns.ravel())), shape=shape)


def _locate(corners: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The interval between two corners in which each place s (p,) lies, and ξ in it."""
    interval = np.clip(np.searchsorted(corners, s) - 1, 0, len(corners) - 2)
    return interval, (s - corners[interval]) / np.diff(corners)[interval]


def _shapes(corners: np.ndarray, s: np.ndarray, degree: int) -> sparse.csr_matrix:
    """(p, nodes) shape functions of an edge at the places s (p,)."""
    interval, xi = _locate(corners, s)
    return _scatter(_local_shapes(xi, degree), interval, len(corners))


def _multipliers(corners: np.ndarray, s: np.ndarray, degree: int) -> sparse.csr_matrix:
    """(p, nodes) the multipliers ψ at the places s (p,); those of the two ends are 0.

    On each interval ψ = diag(∫ φ_i) M⁻¹ φ with its mass matrix M. In the first and the last one
    the ψ of the end goes to the others by the weights that extrapolate polynomials of the degree
    below: so Σ ψ_i = 1, and the work of a constant force along the seam is exact.
    """
    interval, xi = _locate(corners, s)
    points, weights = leggauss(degree + 1)
    phi = _local_shapes((points + 1) / 2, degree)
    mass = phi.T @ (weights[:, None] / 2 * phi)
    dual = np.diag(mass.sum(axis=1)) @ np.linalg.inv(mass)
    psi = _local_shapes(xi, degree) @ dual.T
    count = len(corners) - 1
    extrapolation = np.array([1.0]) if degree == 1 else np.array([2.0, -1.0])
    if count == 1:  # both ends go to the node in the middle, if there is one
        extrapolation = np.eye(1, degree)[0]
    of_first, of_last = interval == 0, interval == count - 1
    first, last = psi[of_first, :1].copy(), psi[of_last, -1:].copy()
    psi[of_first, 1:] += first * extrapolation
    psi[of_last, :-1] += last * extrapolation[::-1]
    psi[of_first, 0] = 0.0
    psi[of_last, -1] = 0.0
    return _scatter(psi, interval, len(corners))
