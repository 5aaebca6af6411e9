"""Lengths and rates without their rigid part, so that they are the same for every observer."""

import math
from collections.abc import Sequence

import numpy as np

from fecloth.compiled.jit import kernel
from fecloth.linalg.reductions import mean, rms

# Over the sum of the moments of inertia: below, a body is not turned about that axis.
LEAST_INERTIA = 1e-12


def rms_without_rigid(w: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    """Return the root mean square of a field y without its rigid part.

    The rigid part is the field c + ω × x nearest to y, by weighted least squares: c is the mean,
    and ω solves I ω = L with the moments of inertia I and the moment of momentum L.

    Parameters
    ----------
    w
        (n,) weights of the nodes, such as their masses.
    x, y
        (n, 3) positions and the field.
    """
    xx, xy, yy = _sums(w, x - mean(w, x), y - mean(w, y), np.zeros((3, 3, 3)))
    inertia = xx.trace() * np.eye(3) - xx
    moment = np.array([xy[i - 2, i - 1] - xy[i - 1, i - 2] for i in range(3)])
    inertias, axes = np.linalg.eigh(inertia)
    turns = inertias > LEAST_INERTIA * inertias.sum()
    turning = ((moment @ axes)[turns] ** 2 / inertias[turns]).sum()
    return math.sqrt(max(yy.trace() - turning, 0.0) / w.sum())


def rms_of_deformation(w: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Return the root mean square distance of two shapes after the rigid motion that fits best.

    It is the least rms of b − R a − c over all rotations R and shifts c (Kabsch 1976, A solution
    for the best rotation to relate two sets of vectors).

    Parameters
    ----------
    w
        (n,) weights of the nodes, such as their masses.
    a, b
        (n, 3) positions of the nodes in both shapes.
    """
    p = a - mean(w, a)
    r = b - mean(w, b)
    weighted = w[:, None] * r
    U, _, Vt = np.linalg.svd(weighted.T @ p)
    U[:, 2] *= np.sign(np.linalg.det(U @ Vt))  # a rotation, no reflection
    rotation = U @ Vt
    return rms(w, r - p @ rotation.T)


@kernel
def _sums(w, x, y, sums):
    """Add the weighted sums of x xᵀ, x yᵀ and y yᵀ."""
    for i in range(len(w)):
        for j in range(3):
            for k in range(3):
                sums[0, j, k] += w[i] * x[i, j] * x[i, k]
                sums[1, j, k] += w[i] * x[i, j] * y[i, k]
                sums[2, j, k] += w[i] * y[i, j] * y[i, k]
    return sums


def derivative(times: Sequence[float], values: Sequence[np.ndarray]) -> np.ndarray:
    """Return d^p/dt^p (n, 3) of values at p + 1 times: p! times Newton's divided difference.

    Its weights add up to 0, so that it is taken of the differences from the first value: these
    keep the digits of a cloth that is far from the origin.
    """
    y = np.zeros_like(values[0])
    scale = math.factorial(len(times) - 1)
    for t, value in zip(times[1:], values[1:], strict=True):
        weight = scale / math.prod(t - other for other in times if other != t)
        y += float(weight) * (value - values[0])
    return y
