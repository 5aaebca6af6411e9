"""An upper bound of the eigenvalues of M⁻¹A, where A is a sum of matrices of stencils."""

from __future__ import annotations

import numpy as np


def stencil_bound(nodes: np.ndarray, blocks: np.ndarray, mass: np.ndarray) -> float:
    """Bound of the largest eigenvalue of M⁻¹A by the stencils' own, from A's symmetric part.

    Parameters
    ----------
    nodes
        (m, k) of each stencil.
    blocks
        (m, k, k, 3, 3) of A.
    mass
        (n,) lumped [kg].
    """
    return bound_of_squares(nodes, squares(blocks), mass)


def squares(blocks: np.ndarray) -> np.ndarray:
    """(m, k, k) squared Frobenius norms of the blocks (m, k, k, 3, 3) of A's symmetric part."""
    A = 0.5 * (blocks + blocks.transpose(0, 2, 1, 4, 3))
    return np.sum(A**2, axis=(3, 4))


def bound_of_squares(nodes: np.ndarray, squares: np.ndarray, mass: np.ndarray) -> float:
    """`stencil_bound` from what `squares` gives, which may come in parts.

    The largest eigenvalue of a sum is at most the largest of the parts' own (Irons and Treharne
    1971), each with its share of the nodes' masses: here in proportion to the norms of the node's
    rows. A Frobenius norm bounds an eigenvalue, and equals it where the matrix has rank one.
    """
    rows = np.sqrt(squares.sum(axis=2))  # (m, k)
    around = np.bincount(nodes.ravel(), rows.ravel(), len(mass))[nodes]
    # rows / (mass share) with share = mass · rows / around; a node without rows has no say
    factor = np.divide(around, rows, out=np.zeros_like(rows), where=rows > 0) / mass[nodes]
    scaled = squares * factor[:, :, None] * factor[:, None, :]
    return float(np.sqrt(scaled.sum(axis=(1, 2)).max()))
