"""Lengths and rates without their rigid part, so that they are the same for every observer."""

from __future__ import annotations

import math

import numpy as np

from fecloth.jit import kernel

FLAT = 1e-12  # of the largest moment of inertia: below, a body cannot be turned about that axis


def deformation(weights: np.ndarray, start: np.ndarray, x: np.ndarray) -> float:
    """Return the rms distance [m] of x (n, 3) from the nearest rigid copy of `start` (n, 3).

    Source: Kabsch (1976), A solution for the best rotation to relate two sets of vectors, Acta
    Crystallographica A 32.
    """
    a, b = (y - np.einsum("i,ij->j", weights, y) / weights.sum() for y in (start, x))
    u, _, v = np.linalg.svd(np.einsum("i,ij,ik->jk", weights, a, b))
    v[2] *= np.sign(np.linalg.det(u @ v))  # a rotation, not a reflection
    distance = b - np.einsum("ij,jk->ik", a, u @ v)
    return math.sqrt(np.einsum("i,ij,ij->", weights, distance, distance) / weights.sum())


def rms_without_rigid(weights: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    """Return the rms of y (n, 3) less the field c + w × x (n, 3) nearest to it."""
    mass, mean, inertia, moment, total = _moments(weights, x, y)
    turning = moment @ np.linalg.pinv(inertia, rcond=FLAT, hermitian=True) @ moment
    return math.sqrt(max(total - mass * (mean @ mean) - turning, 0.0) / mass)


@kernel
def _moments(w, x, y):
    """Σ w, mean of y, Σ w (r·r I − r rᵀ), Σ w r × y and Σ w y·y, with r from the centre of x."""
    mass, centre, mean = 0.0, np.zeros(3), np.zeros(3)
    for i in range(len(w)):
        mass += w[i]
        for k in range(3):
            centre[k] += w[i] * x[i, k]
            mean[k] += w[i] * y[i, k]
    centre /= mass
    mean /= mass
    inertia, moment, total = np.zeros((3, 3)), np.zeros(3), 0.0
    for i in range(len(w)):
        r0, r1, r2 = x[i, 0] - centre[0], x[i, 1] - centre[1], x[i, 2] - centre[2]
        y0, y1, y2 = y[i, 0], y[i, 1], y[i, 2]
        inertia[0, 0] += w[i] * (r1 * r1 + r2 * r2)
        inertia[1, 1] += w[i] * (r0 * r0 + r2 * r2)
        inertia[2, 2] += w[i] * (r0 * r0 + r1 * r1)
        inertia[0, 1] -= w[i] * r0 * r1
        inertia[0, 2] -= w[i] * r0 * r2
        inertia[1, 2] -= w[i] * r1 * r2
        moment[0] += w[i] * (r1 * y2 - r2 * y1)
        moment[1] += w[i] * (r2 * y0 - r0 * y2)
        moment[2] += w[i] * (r0 * y1 - r1 * y0)
        total += w[i] * (y0 * y0 + y1 * y1 + y2 * y2)
    for i in range(3):
        for j in range(i):
            inertia[i, j] = inertia[j, i]
    return mass, mean, inertia, moment, total
