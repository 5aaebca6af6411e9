"""Deformation gradients, stretches and strains of triangles."""

import math

import numpy as np

from fecloth.compiled.jit import kernel
from fecloth.mesh.cloth import Cloth
from fecloth.terms.loops.green_strain import gradient, green_strain

ALL = slice(None)


def deformation_gradient(
    cloth: Cloth,
    x: np.ndarray,
    gradients: np.ndarray | None = None,
    triangles: slice = ALL,
) -> np.ndarray:
    """Deformation gradient F = Σ x_a ⊗ G_a (m, q, 3, 2) at every quadrature point.

    Parameters
    ----------
    x
        Positions (n, 3) of the nodes [m].
    gradients
        The G_a (m, q, k, 2) of all triangles [1/m]; left out, the gradients along X and Y.
    triangles
        The triangles to compute; left out, all.
    """
    G = gradients
    if G is None:
        G = cloth.gradients
    return np.einsum("eai,eqaj->eqij", x[cloth.stencil[triangles]], G[triangles])


def principal_stretches(cloth: Cloth, x: np.ndarray, triangles: slice = ALL) -> np.ndarray:
    """Return the smaller and the larger principal stretch (m, 2) of each triangle.

    They belong to the mean of FᵀF over the area of the triangle.
    """
    F = deformation_gradient(cloth, x, triangles=triangles)
    return stretches_of(mean_over_triangles(cloth, F.swapaxes(2, 3) @ F, triangles))


def mean_over_triangles(cloth: Cloth, values: np.ndarray, triangles: slice) -> np.ndarray:
    """Return the means (m, …) of values at the quadrature points (m, q, …) of triangles."""
    weights = cloth.weights[triangles]
    share = weights / weights.sum(axis=1, keepdims=True)
    return (share.reshape(*share.shape, *[1] * (values.ndim - 2)) * values).sum(axis=1)


def stretches_of(FTF: np.ndarray) -> np.ndarray:
    """Return the smaller and the larger principal stretch (m, 2) of FᵀF (m, 2, 2)."""
    mean = 0.5 * (FTF[:, 0, 0] + FTF[:, 1, 1])
    radius = np.hypot(0.5 * (FTF[:, 0, 0] - FTF[:, 1, 1]), FTF[:, 0, 1])
    squared_stretches = np.column_stack([mean - radius, mean + radius])
    return np.sqrt(np.maximum(squared_stretches, 0.0))  # they may be < 0 by round-off


def largest_stretch(cloth: Cloth, x: np.ndarray) -> float:
    """Largest principal stretch of all triangles; NaN if any stretch is NaN."""
    return extreme_stretches(cloth, x)[1]


def extreme_stretches(cloth: Cloth, x: np.ndarray) -> tuple[float, float]:
    """Smallest and largest principal stretch of all triangles; NaN if any stretch is NaN."""
    return _extreme_stretches(*cloth.shape, cloth.stencil, cloth.gradients, x)


@kernel
def _extreme_stretches(K, Q, nodes, G, x):
    """Return the smallest and the largest principal stretch, over all points of all triangles.

    They are the roots of the eigenvalues of FᵀF = 2E + I, which are mean ± radius. Returns NaN
    for both if any of them is NaN.
    """
    least = np.inf
    largest = 0.0
    for e in range(len(nodes)):
        for q in range(len(Q)):
            E11, E22, E12 = green_strain(gradient(K, nodes, G, e, q, x))
            mean = 1.0 + (E11 + E22)
            half_difference = 0.5 * (E11 - E22)
            radius = 2.0 * math.sqrt(half_difference * half_difference + E12 * E12)
            if mean != mean or radius != radius:  # NaN, which no comparison below would find
                return math.nan, math.nan
            if mean - radius < least:
                least = mean - radius
            if mean + radius > largest:
                largest = mean + radius
    return math.sqrt(max(least, 0.0)), math.sqrt(largest)  # least may be < 0 by round-off


@kernel
def fill_extreme_stretches(K, Q, nodes, G, x, out):
    """out (2,) = the smallest and the largest principal stretch."""
    out[0], out[1] = _extreme_stretches(K, Q, nodes, G, x)


def green_strains(F: np.ndarray) -> np.ndarray:
    """(..., 3) E11, E22, E12 of deformation gradients F (..., 3, 2)."""
    C = np.einsum("...ij,...ik->...jk", F, F)
    return np.stack([(C[..., 0, 0] - 1) / 2, (C[..., 1, 1] - 1) / 2, C[..., 0, 1] / 2], axis=-1)
