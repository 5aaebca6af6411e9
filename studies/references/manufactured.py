"""A manufactured solution: a motion with the body force that makes it exact.

The method is from Roache (2002, J. Fluids Eng. 124). The motion is a taut sheet with three plane
waves in and out of its plane, of amplitude c:

    x_i(X, c) = A_iJ X_J + c a_i sin θ_i,    θ_i = q_i·X + φ_i,    F = A + c a_i q_i cos θ_i.

With the body force b = ρ c̈ a_i sin θ_i − Div P per reference area it solves the equations of an
isotropic St. Venant-Kirchhoff membrane, and both principal stresses are positive for −1 ≤ c ≤ 1.
"""

from __future__ import annotations

import numpy as np
from scipy.special import roots_legendre

DENSITY, Y, NU = 0.2, 1000.0, 0.3  # kg/m², N/m, -
A = np.array([[1.2, 0.05], [0.0, 1.15], [0.1, -0.05]])
WAVES = np.pi * np.array([[1.0, 0.5], [-0.5, 1.0], [1.0, 1.0]])  # q [1/m], a row each
HEIGHTS = np.array([0.02, 0.02, 0.04])  # a [m]
PHASES = np.array([0.3, 1.1, -0.4])  # φ


def wave(X: np.ndarray) -> np.ndarray:
    """Return ∂x/∂c = a sin θ, (p, 3) [m]."""
    return HEIGHTS * np.sin(X @ WAVES.T + PHASES)


def position(X: np.ndarray, c: float = 1.0) -> np.ndarray:
    """Return x, (p, 3) [m]."""
    return X @ A.T + c * wave(X)


def gradient(X: np.ndarray, c: float = 1.0) -> np.ndarray:
    """Return F = ∂x/∂X, (p, 3, 2)."""
    slope = HEIGHTS * np.cos(X @ WAVES.T + PHASES)
    return A + c * slope[:, :, None] * WAVES


def second_gradient(X: np.ndarray, c: float = 1.0) -> np.ndarray:
    """Return G_iJK = ∂F_iJ/∂X_K, (p, 3, 2, 2) [1/m]."""
    return -c * wave(X)[:, :, None, None] * WAVES[:, :, None] * WAVES[:, None, :]


def law(E: np.ndarray) -> np.ndarray:
    """Return S = Y/(1 − ν²) ((1 − ν) E + ν tr E I) of strains (..., 2, 2) [N/m]."""
    trace = np.trace(E, axis1=-2, axis2=-1)[..., None, None]
    return Y / (1 - NU**2) * ((1 - NU) * E + NU * trace * np.eye(2))


def strain(X: np.ndarray, c: float = 1.0) -> np.ndarray:
    """Return E = (FᵀF − I)/2, (p, 2, 2)."""
    F = gradient(X, c)
    return (np.einsum("piJ,piK->pJK", F, F) - np.eye(2)) / 2


def stress(X: np.ndarray, c: float = 1.0) -> np.ndarray:
    """Return P = F S, (p, 3, 2) [N/m]."""
    return gradient(X, c) @ law(strain(X, c))


def divergence(X: np.ndarray, c: float = 1.0) -> np.ndarray:
    """Return ∂P_iL/∂X_L = G_iJL S_JL + F_iJ ∂S_JL/∂X_L, (p, 3) [N/m²]."""
    F, G = gradient(X, c), second_gradient(X, c)
    half = np.einsum("piJ,piKL->pLJK", F, G)
    of_stress = law((half + half.swapaxes(2, 3)) / 2)  # ∂S_JK/∂X_L as LJK
    along = np.einsum("piJL,pJL->pi", G, law(strain(X, c)))
    return along + np.einsum("piJ,pLJL->pi", F, of_stress)


def energy(c: float = 1.0, speed: float = 0.0, points: int = 24) -> float:
    """Return the strain and kinetic energy of the unit square [J]; `speed` is dc/dt.

    The rule of Gauss and Legendre has `points` points along each side.
    """
    at, weights = roots_legendre(points)
    X = np.stack(np.meshgrid((1 + at) / 2, (1 + at) / 2), axis=-1).reshape(-1, 2)
    E = strain(X, c)
    density = np.einsum("pJK,pJK->p", law(E), E) / 2
    density += DENSITY / 2 * speed**2 * np.sum(wave(X) ** 2, axis=1)
    return float(np.outer(weights, weights).ravel() / 4 @ density)


def least_stress(points: int = 40) -> float:
    """Return the smallest principal S on a grid of the unit square and c in [−1, 1] [N/m]."""
    side = np.linspace(0, 1, points)
    X = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return min(np.linalg.eigvalsh(law(strain(X, c))).min() for c in np.linspace(-1, 1, 21))
