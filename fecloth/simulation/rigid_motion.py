"""Lengths and rates without their rigid part, so that they are the same for every observer."""

import math
from collections.abc import Sequence

import numpy as np

from fecloth.compiled.jit import inner, kernel

FLAT = 1e-12  # of the sum of the moments of inertia: below, a body is not turned about that axis


def rms_without_rigid(w: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    """Return the rms of y (n, 3), with weights w (n,), less its nearest field c + ω × x (n, 3)."""
    return _rms_without_rigid(w, x, y, np.zeros((3, 3)), np.zeros((3, 3)))


@kernel
def _rms_without_rigid(w, x, y, vectors, inertia):
    mass, centre, mean, moment = 0.0, vectors[0], vectors[1], vectors[2]
    for i in range(len(w)):
        mass += w[i]
        for k in range(3):
            centre[k] += w[i] * x[i, k]
            mean[k] += w[i] * y[i, k]
    for k in range(3):
        centre[k] /= mass
        mean[k] /= mass
    total = 0.0
    for i in range(len(w)):
        r0, r1, r2 = x[i, 0] - centre[0], x[i, 1] - centre[1], x[i, 2] - centre[2]
        y0, y1, y2 = y[i, 0] - mean[0], y[i, 1] - mean[1], y[i, 2] - mean[2]
        inertia[0, 0] += w[i] * (r1 * r1 + r2 * r2)
        inertia[1, 1] += w[i] * (r0 * r0 + r2 * r2)
        inertia[2, 2] += w[i] * (r0 * r0 + r1 * r1)
        inertia[1, 0] -= w[i] * r0 * r1
        inertia[2, 0] -= w[i] * r0 * r2
        inertia[2, 1] -= w[i] * r1 * r2
        moment[0] += w[i] * (r1 * y2 - r2 * y1)
        moment[1] += w[i] * (r2 * y0 - r0 * y2)
        moment[2] += w[i] * (r0 * y1 - r1 * y0)
        total += w[i] * (y0 * y0 + y1 * y1 + y2 * y2)
    total -= _turning(inertia, moment)
    return math.sqrt((0.0 if total < 0.0 else total) / mass)


@inner
def _turning(inertia, moment):
    """moment · inertia⁻¹ moment by L D Lᵀ in the lower triangle, without axes of no inertia."""
    least, turning = FLAT * (inertia[0, 0] + inertia[1, 1] + inertia[2, 2]), 0.0
    for k in range(3):
        if inertia[k, k] <= least:
            continue
        turning += moment[k] * moment[k] / inertia[k, k]
        for i in range(k + 1, 3):
            share = inertia[i, k] / inertia[k, k]
            moment[i] -= share * moment[k]
            for j in range(k + 1, i + 1):
                inertia[i, j] -= share * inertia[j, k]
    return turning


def derivative(times: Sequence[float], values: Sequence[np.ndarray]) -> np.ndarray:
    """Return d^p/dt^p (n, 3) of values at p + 1 times: p! times Newton's divided difference."""
    # Its weights add up to 0: differences from the first keep the digits of a cloth far away.
    y, scale = np.zeros_like(values[0]), math.factorial(len(times) - 1)
    for t, value in zip(times[1:], values[1:], strict=True):
        weight = scale / math.prod(t - other for other in times if other != t)
        y += float(weight) * (value - values[0])
    return y
