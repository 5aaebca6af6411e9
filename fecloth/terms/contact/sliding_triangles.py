"""Pairs of triangles that slide on each other, with friction."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.terms.contact.toolkit import ContactSets


@dataclass(frozen=True, eq=False)
class SlidingTriangles:
    """Pairs of triangles that slide on each other; velocities belong to all nodes (n, 3).

    Attributes
    ----------
    sets
        The contacts.
    lagged
        The toolkit's own record of them, with their normal forces and directions of sliding.
    surface
        Velocity (n, 3) of the fixed mesh at the nodes [m/s]; 0 without one.
    R
        Rotation (3, 3) of the fixed mesh; None if it does not turn.
    eps
        Speed [m/s] from which friction has its full value.
    """

    sets: ContactSets
    lagged: Any
    surface: np.ndarray | float
    R: np.ndarray | None
    eps: float

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        return of_nodes

    def slip(self, v: np.ndarray) -> np.ndarray:
        """(n, 3) velocities relative to the fixed mesh, in its frame."""
        w: np.ndarray = v - self.surface
        if self.R is None:
            return w
        return w @ self.R

    def rate(self, w: np.ndarray) -> float:
        rate, _ = self.sets.rub(self.lagged, w, self.eps)
        return rate

    def power(self, w: np.ndarray) -> float:
        _, force = self.sets.rub(self.lagged, w, self.eps)
        return -float((force * w).sum())

    def force(self, w: np.ndarray) -> np.ndarray:
        """(n, 3) force on the nodes [N]."""
        _, force = self.sets.rub(self.lagged, w, self.eps)
        return turn(force, self.R)

    def damping(self, w: np.ndarray, weight: float) -> sparse.csr_matrix | None:
        """(3n, 3n) `weight` times −∂force/∂v, positive semi-definite; None without contacts."""
        D = self.sets.rub_slope(self.lagged, w, self.eps)
        if D is None:
            return None
        return turn_matrix(weight * D, self.R)


def turn(f: np.ndarray, R: np.ndarray | None) -> np.ndarray:
    """Vectors (n, 3) in space, from vectors in the frame of the fixed mesh."""
    if R is None:
        return f
    return f @ R.T


def turn_matrix(K: sparse.csr_matrix, R: np.ndarray | None) -> sparse.csr_matrix:
    """(3n, 3n) R K Rᵀ, in space."""
    if R is None:
        return K
    all_R = sparse.kron(sparse.identity(K.shape[0] // 3), R, format="csr")
    return (all_R @ K @ all_R.T).tocsr()
