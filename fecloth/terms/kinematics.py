"""Deformation gradient and principal stretches of the triangles of a cloth."""

from __future__ import annotations

import math

import numpy as np

from fecloth.compiled.jit import kernel
from fecloth.mesh.cloth import Cloth
from fecloth.terms.loops.green_strain import gradient, green_strain


def deformation_gradient(
    cloth: Cloth,
    x: np.ndarray,
    gradients: np.ndarray | None = None,
    triangles: slice = slice(None),
) -> np.ndarray:
    """Deformation gradient F = Σ x_a ⊗ G_a (m, q, 3, 2) at every quadrature point.

    `gradients` (m, q, k, 2) are the G_a of all triangles; without them they are those along X and
    Y. With `triangles`, the F of some of the triangles.
    """
    G = cloth.gradients if gradients is None else gradients
    return np.einsum("eai,eqaj->eqij", x[cloth.stencil[triangles]], G[triangles])


def principal_stretches(cloth: Cloth, x: np.ndarray, triangles: slice = slice(None)) -> np.ndarray:
    """Smaller and larger principal stretch (m, 2), from the mean FᵀF of each triangle."""
    F, weights = deformation_gradient(cloth, x, triangles=triangles), cloth.weights[triangles]
    share = weights / weights.sum(axis=1, keepdims=True)
    right = np.einsum("eq,eqij,eqik->ejk", share, F, F)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(right), 0.0))


def largest_stretch(cloth: Cloth, x: np.ndarray) -> float:
    """Largest principal stretch of all triangles; NaN if any stretch is NaN."""
    return extreme_stretches(cloth, x)[1]


def extreme_stretches(cloth: Cloth, x: np.ndarray) -> tuple[float, float]:
    """Smallest and largest principal stretch of all triangles; NaN if any stretch is NaN."""
    return _extreme_stretches(*cloth.shape, cloth.stencil, cloth.gradients, x)


@kernel
def _extreme_stretches(K, Q, nodes, G, x):
    """√ of the least and largest eigenvalue of FᵀF = 2E + I."""
    least, largest = np.inf, 0.0
    for e in range(len(nodes)):
        for q in range(len(Q)):
            E11, E22, E12 = green_strain(gradient(K, nodes, G, e, q, x))
            mean, half_difference = 1.0 + (E11 + E22), 0.5 * (E11 - E22)
            radius = 2.0 * math.sqrt(half_difference * half_difference + E12 * E12)
            if mean != mean or radius != radius:
                return math.nan, math.nan
            least = min(least, mean - radius)
            largest = max(largest, mean + radius)
    return math.sqrt(max(least, 0.0)), math.sqrt(largest)


@kernel
def fill_extreme_stretches(K, Q, nodes, G, x, out):
    """out (2,) = the smallest and the largest principal stretch."""
    out[0], out[1] = _extreme_stretches(K, Q, nodes, G, x)
