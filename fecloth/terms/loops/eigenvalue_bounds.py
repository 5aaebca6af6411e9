"""Upper bounds of the eigenvalues of M⁻¹A, where A is a sum of matrices of stencils."""

import numpy as np

from fecloth.fabric.panel import Panel
from fecloth.mesh.elements import blocks


def membrane_bound(panel: Panel, moduli: np.ndarray, mass: np.ndarray) -> float:
    """Bound the largest eigenvalue of M⁻¹K of a membrane at F = I with ℂ (m, 6) [N/m], in 1/s².

    The largest eigenvalue of a sum of element matrices is at most the largest of the elements'
    own (Irons and Treharne 1971); each node's mass is shared among its triangles by theirs. With
    ℂ = L Lᵀ the nonzero eigenvalues of M_e⁻¹ K_e are the eigenvalues of the matrix of 3×3 blocks,
    one for each pair of quadrature points, Lᵀ (Σ_a √(w_p w_q) B_ap B_aqᵀ / m_a) L. The mass (n,)
    [kg] is lumped.
    """
    cloth = panel.cloth
    area = cloth.weights.sum(axis=1) * panel.density
    around = np.bincount(cloth.stencil.ravel(), np.repeat(area, cloth.stencil.shape[1]), len(mass))
    most = -np.inf
    for part in blocks(len(area)):
        share = area[part, None] * (mass / around)[cloth.stencil[part]]  # (m, k)
        scale = np.sqrt(cloth.weights[part, :, None] / share[:, None, :])  # (m, q, k)
        rows = _scaled_strains(panel.gradients[part], scale, moduli[part])
        most = max(most, np.linalg.eigvalsh(rows @ rows.transpose(0, 2, 1))[:, -1].max())
    return float(most)


def _scaled_strains(gradients: np.ndarray, scale: np.ndarray, moduli: np.ndarray) -> np.ndarray:
    """(m, 3q, 2k) Lᵀ B times a `scale` (m, q, k) of each node and point."""
    L = np.linalg.cholesky(moduli[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]])  # (m, 3, 3)
    G1, G2 = np.moveaxis(gradients, -1, 0)  # (m, q, k)
    zero = np.zeros_like(G1)
    B = np.stack([np.stack([G1, zero], -1), np.stack([zero, G2], -1), np.stack([G2, G1], -1)], -2)
    m, q, k = G1.shape
    rows: np.ndarray = np.einsum("eli,eqalj,eqa->eqiaj", L, B, scale, optimize=True)
    return rows.reshape(m, 3 * q, 2 * k)


def stencil_bound(nodes: np.ndarray, blocks: np.ndarray, mass: np.ndarray) -> float:
    """Bound the largest eigenvalue of M⁻¹A from blocks (m, k, k, 3, 3) of A's stencils (m, k)."""
    return bound_from_squares(nodes, squared_norms(blocks), mass)


def squared_norms(blocks: np.ndarray) -> np.ndarray:
    """Squared Frobenius norms (m, k, k) of the blocks (m, k, k, 3, 3) of A's symmetric part."""
    A = 0.5 * (blocks + blocks.transpose(0, 2, 1, 4, 3))
    squares: np.ndarray = np.sum(A**2, axis=(3, 4))
    return squares


def bound_from_squares(nodes: np.ndarray, squares: np.ndarray, mass: np.ndarray) -> float:
    """Compute `stencil_bound` from `squared_norms`, which a caller may form in parts.

    The largest eigenvalue of a sum is at most the largest of the parts' own (Irons and Treharne
    1971), each with a share of the nodes' masses in proportion to the norms of its rows, which
    bound its eigenvalue.
    """
    rows = np.sqrt(squares.sum(axis=2))  # (m, k)
    around = np.bincount(nodes.ravel(), rows.ravel(), len(mass))[nodes]
    # rows / (mass share) with share = mass · rows / around; a node without rows does not count
    factor = np.divide(around, rows, out=np.zeros_like(rows), where=rows > 0) / mass[nodes]
    scaled = squares * factor[:, :, None] * factor[:, None, :]
    return float(np.sqrt(scaled.sum(axis=(1, 2)).max()))
