"""Errors and seconds between and beyond measured runs: powers of a size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

LOWEST = 0.5  # order that is assumed at least, where refinement helps at all
STALLED = 0.3  # observed order below which refinement does not help


@dataclass(frozen=True, eq=False)
class Curve:
    """Values y at sizes x, with powers of x between and beyond them.

    Attributes
    ----------
    x
        (k,) increasing sizes, as √triangles or the number of steps.
    y
        (k, q) positive values.
    slope
        Power of x beyond the largest x.
    below
        Power of x below the smallest x.
    """

    x: np.ndarray
    y: np.ndarray
    slope: np.ndarray | float
    below: np.ndarray | float

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return (m, q) values at (m,) sizes."""
        s, t = np.log(np.asarray(x, dtype=float)), np.log(self.x)
        inside = np.stack([np.interp(s, t, column) for column in np.log(self.y).T], axis=1)
        beyond = np.maximum(s - t[-1], 0.0)[:, None] * self.slope
        before = np.minimum(s - t[0], 0.0)[:, None] * self.below
        return np.exp(inside + beyond + before)

    def scaled(self, factor: float) -> Curve:
        """Return the curve of `factor` times the values."""
        return replace(self, y=factor * self.y)


def error_curve(x: Sequence[float], errors: Sequence[np.ndarray], theory: np.ndarray) -> Curve:
    """Return errors that do not grow with x, with their order beyond the measured ones.

    An error that is smaller than that of a finer run is so by chance: it is replaced by it. The
    order beyond is that between the last two runs, but at least 1/2 and at most the theory; below
    the first run it is that between the first two, but at least 1.
    """
    order = np.argsort(x)
    sizes, values = np.asarray(x, dtype=float)[order], np.asarray(errors, dtype=float)[order]
    values = np.maximum.accumulate(values[::-1])[::-1]
    slope = -0.75 * theory
    if len(sizes) > 1:
        slope = -np.log(values[-2] / values[-1]) / np.log(sizes[-1] / sizes[-2])
    first = -theory
    if len(sizes) > 1:
        first = -np.log(values[0] / values[1]) / np.log(sizes[1] / sizes[0])
    beyond = np.clip(slope, -theory, -np.minimum(LOWEST, theory))
    below = np.clip(first, -theory, -np.minimum(1.0, theory))
    return Curve(sizes, values, beyond, below)


def cost_curve(x: Sequence[float], seconds: Sequence[float], low: float, high: float) -> Curve:
    """Return seconds over a size; beyond the measured runs their power lies in [low, high]."""
    order = np.argsort(x)
    sizes = np.asarray(x, dtype=float)[order]
    values = np.maximum.accumulate(np.maximum(np.asarray(seconds, dtype=float)[order], 1e-6))
    power = (low + high) / 2
    if len(sizes) > 1:
        power = float(np.log(values[-1] / values[-2]) / np.log(sizes[-1] / sizes[-2]))
    power = min(max(power, low), high)
    return Curve(sizes, values[:, None], power, power)
