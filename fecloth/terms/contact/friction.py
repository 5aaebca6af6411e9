"""Coulomb friction with a smooth passage from rest to sliding.

    F = −μ λ f₁(y)/y w,   f₁(y) = 2y/ε − y²/ε² for y < ε, else 1

with the normal force λ, the velocity w of sliding, y = |w|, and a small speed ε. F is the
derivative of the potential −μ λ f₀(y) by w, f₀′ = f₁. At rest the cloth creeps with less than ε.

Source: Li et al. (2020), Incremental Potential Contact, ACM Trans. Graph. 39(4), section on
friction; f₀ and f₁ as the IPC Toolkit has them.
"""

from __future__ import annotations

import numpy as np

LEAST = 1e-300
CREEP = 1e-3  # extents of the cloth a second, below which friction counts as that at rest


def potential(y: np.ndarray, eps: float) -> np.ndarray:
    """f₀(y)."""
    inside = -(y**3) / (3 * eps**2) + y**2 / eps + eps / 3
    return np.where(y < eps, inside, y)


def factor(y: np.ndarray, eps: float) -> np.ndarray:
    """f₁(y)/y."""
    return np.where(y < eps, 2 / eps - y / eps**2, 1 / np.maximum(y, LEAST))


def slope(w: np.ndarray, eps: float) -> np.ndarray:
    """(m, 3, 3) ∂(f₁(y)/y w)/∂w of velocities (m, 3); positive semi-definite."""
    y = np.sqrt(np.einsum("mi,mi->m", w, w))
    change = np.where(y < eps, -1 / eps**2, -1 / np.maximum(y, eps) ** 2) / np.maximum(y, LEAST)
    rank_one = change[:, None, None] * w[:, :, None] * w[:, None, :]
    return factor(y, eps)[:, None, None] * np.eye(3) + rank_one
