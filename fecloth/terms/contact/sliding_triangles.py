"""Pairs of triangles that slide on each other, with friction; and what turns with a fixed mesh."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.terms.contact.toolkit import ContactSets


@dataclass(frozen=True, eq=False)
class SlidingTriangles:
    """Pairs of triangles that slide on each other; velocities belong to all nodes (n, 3)."""

    # The contacts, and the toolkit's own with their normal forces and directions.
    sets: ContactSets
    lagged: Any
    surface: np.ndarray | float  # (n, 3) velocity of the fixed mesh [m/s]
    R: np.ndarray | None  # (3, 3) rotation of the fixed mesh; None if it does not turn
    eps: float  # speed from which friction has its full value [m/s]

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        return of_nodes

    def slip(self, v: np.ndarray) -> np.ndarray:
        """(n, 3) velocities relative to the fixed mesh, in its frame."""
        w: np.ndarray = v - self.surface
        return w if self.R is None else w @ self.R

    def rate(self, w: np.ndarray) -> float:
        return self.sets.rub(self.lagged, w, self.eps)[0]

    def power(self, w: np.ndarray) -> float:
        return -float((self.sets.rub(self.lagged, w, self.eps)[1] * w).sum())

    def force(self, w: np.ndarray) -> np.ndarray:
        """(n, 3) force on the nodes [N]."""
        return turn(self.sets.rub(self.lagged, w, self.eps)[1], self.R)

    def damping(self, w: np.ndarray, weight: float) -> sparse.csr_matrix | None:
        """(3n, 3n) `weight` times −∂force/∂v, positive semi-definite; None if nothing touches."""
        D = self.sets.rub_slope(self.lagged, w, self.eps)
        if D is None:
            return None
        return turn_matrix(weight * D, self.R)


def turn(f: np.ndarray, R: np.ndarray | None) -> np.ndarray:
    """Vectors (n, 3) in space, from vectors in the frame of the fixed mesh."""
    return f if R is None else f @ R.T


def turn_matrix(K: sparse.csr_matrix, R: np.ndarray | None) -> sparse.csr_matrix:
    """(3n, 3n) R K Rᵀ, in space."""
    if R is None:
        return K
    all_R = sparse.kron(sparse.identity(K.shape[0] // 3), R, format="csr")
    return (all_R @ K @ all_R.T).tocsr()
