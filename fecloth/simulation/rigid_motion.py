"""Lengths and rates without their rigid part, so that they are the same for every observer."""

from __future__ import annotations

import math

import numpy as np

from fecloth.compiled.jit import inner, kernel

FLAT = 1e-12  # of the sum of the moments of inertia: below, a body is not turned about that axis


def deformation(weights: np.ndarray, start: np.ndarray, x: np.ndarray) -> float:
    """Return the rms distance [m] of x (n, 3) from the nearest rigid copy of `start` (n, 3).

    Source: Kabsch (1976), A solution for the best rotation to relate two sets of vectors, Acta
    Crystallographica A 32.
    """
    total, a, b, products = _products(weights, start, x)
    u, _, v = np.linalg.svd(products)
    v[2] *= np.sign(np.linalg.det(u @ v))  # a rotation, not a reflection
    return math.sqrt(_distance(weights, start, x, a, b, u @ v) / total)


@kernel
def _products(w, x, y):
    """Σ w, the means of x and y, and Σ w x yᵀ (3, 3) from these means."""
    total, a, b, products = 0.0, np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for i in range(len(w)):
        total += w[i]
        for k in range(3):
            a[k] += w[i] * x[i, k]
            b[k] += w[i] * y[i, k]
    for k in range(3):
        a[k] /= total
        b[k] /= total
    for i in range(len(w)):
        for j in range(3):
            for k in range(3):
                products[j, k] += w[i] * (x[i, j] - a[j]) * (y[i, k] - b[k])
    return total, a, b, products


@kernel
def _distance(w, x, y, a, b, R):
    """Σ w ‖y − b − (x − a) R‖²."""
    total = 0.0
    for i in range(len(w)):
        for k in range(3):
            d = y[i, k] - b[k]
            for j in range(3):
                d -= (x[i, j] - a[j]) * R[j, k]
            total += w[i] * d * d
    return total


@kernel
def rms_without_rigid(w, x, y):
    """Return the rms of y (n, 3), with weights w (n,), less its nearest field c + ω × x (n, 3)."""
    mass, centre, mean = 0.0, np.zeros(3), np.zeros(3)
    for i in range(len(w)):
        mass += w[i]
        for k in range(3):
            centre[k] += w[i] * x[i, k]
            mean[k] += w[i] * y[i, k]
    for k in range(3):
        centre[k] /= mass
        mean[k] /= mass
    inertia, moment, total = np.zeros((3, 3)), np.zeros(3), 0.0
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
    return math.sqrt(max(total - _turning(inertia, moment), 0.0) / mass)


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


@kernel
def weighted_sum(arrays, weights):
    """Σ weights[k] (arrays[k] − arrays[0]) of a tuple of arrays (n, 3)."""
    first = arrays[0]
    y = np.empty_like(first)
    for i in range(len(first)):
        for k in range(3):
            total = 0.0
            for m in range(1, len(arrays)):
                total += weights[m] * (arrays[m][i, k] - first[i, k])
            y[i, k] = total
    return y
