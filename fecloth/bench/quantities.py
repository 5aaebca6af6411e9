"""What cases ask, of positions x (times, n, 3) [m]: one value a time, linear between nodes.

Displacements are from (X, Y, 0).
"""

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from fecloth.bench.cases import Map, points


def mean(case: Map, x: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean displacement along an axis, over the area of the flat cloth [m]."""
    corners = case["X"][case["triangles"]]
    area = np.linalg.det(corners[:, 1:] - corners[:, :1])
    return _moved(case, x)[:, case["triangles"], axis].mean(axis=2) @ area / area.sum()


def point(case: Map, x: np.ndarray, at: list[float], axis: int) -> np.ndarray:
    """Return the displacement along an axis of the point `at` of the flat cloth [m]."""
    return _between(case, _moved(case, x), at)[:, axis]


def narrowing(case: Map, x: np.ndarray, low: list[float], high: list[float]) -> np.ndarray:
    """Return by how much two points of the flat cloth come closer [m]."""
    apart = np.linalg.norm(_between(case, x, high) - _between(case, x, low), axis=1)
    return np.linalg.norm(np.subtract(high, low)) - apart


def away(case: Map, x: np.ndarray, motion: list[str]) -> np.ndarray:
    """Return the largest distance of a node from three formulas of X, Y and t [m]."""
    return np.linalg.norm(x - points(motion, case["X"], case["times"]), axis=2).max(axis=1)


def period(case: Map, x: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean time between downward zeros of the mean displacement [s]; NaN without two."""
    y, t = mean(case, x, axis), case["times"]
    i = np.flatnonzero((y[:-1] > 0) & (y[1:] <= 0))
    zeros = t[i] + (t[i + 1] - t[i]) * y[i] / (y[i] - y[i + 1])
    return np.diff(zeros).mean() if len(zeros) > 1 else np.array(np.nan)


def shadow(case: Map, x: np.ndarray, support: float) -> np.ndarray:
    """Return the share of the ring beyond a radius that is in shadow (Cusick, 1968) [%]."""
    flat = _shadow_area(_moved(case, 0 * x)[0] * -1, case["triangles"], support)
    return np.array([100 * _shadow_area(y, case["triangles"], support) / flat for y in x])


def _shadow_area(x: np.ndarray, triangles: np.ndarray, support: float) -> int:
    """Return how many cells of a grid are covered, seen from above; overlaps count once."""
    corners, cell = x[triangles, :2], support / 200
    count = int(np.ceil(2 * np.ptp(corners, axis=1).max() / cell))
    i, j = np.nonzero(np.tri(count + 1)[::-1])  # points of each triangle, closer than the cells
    weights = np.stack([i, j, count - i - j], axis=1) / count
    cells = np.unique(np.floor(weights @ corners / cell).astype(int).reshape(-1, 2), axis=0)
    return np.count_nonzero(np.hypot(*(cells.T + 0.5)) * cell >= support)


def _moved(case: Map, x: np.ndarray) -> np.ndarray:
    return x - np.pad(case["X"], ((0, 0), (0, 1)))


def _between(case: Map, x: np.ndarray, place: list[float]) -> np.ndarray:
    return LinearNDInterpolator(case["X"], x.transpose(1, 0, 2))(*place)
