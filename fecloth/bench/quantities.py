"""What cases ask, of positions x (times, n, 3) [m]: one value a time, linear between nodes."""

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from fecloth.bench.cases import Map, points


def mean(case: Map, x: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean displacement from (X, Y, 0), over the area of the flat cloth [m]."""
    corners = case["X"][case["triangles"]]
    area = np.linalg.det(corners[:, 1:] - corners[:, :1])
    return _moved(case, x)[:, case["triangles"], axis].mean(axis=2) @ area / area.sum()


def point(case: Map, x: np.ndarray, axis: int, at: list, beside: list | None = None) -> np.ndarray:
    """Return the displacement of the point `at` of the flat cloth, less that of `beside` [m]."""
    between = LinearNDInterpolator(case["X"], _moved(case, x)[:, :, axis].T)
    return between(*at) - (between(*beside) if beside else 0.0)


def away(case: Map, x: np.ndarray, motion: list[str]) -> np.ndarray:
    """Return the largest distance of a node from three formulas of X, Y and t [m]."""
    return np.linalg.norm(x - points(motion, case["X"], case["times"]), axis=2).max(axis=1)


def period(case: Map, x: np.ndarray, axis: int) -> np.ndarray:
    """Return twice the mean time between zeros of the mean displacement [s]; NaN without two."""
    y, t = mean(case, x, axis), case["times"]
    i = np.flatnonzero(y[:-1] * y[1:] < 0)
    zeros = t[i] + (t[i + 1] - t[i]) * y[i] / (y[i] - y[i + 1])
    return 2 * np.diff(zeros).mean(keepdims=True) if len(zeros) > 1 else np.array([np.nan])


def shadow(case: Map, x: np.ndarray, support: float) -> np.ndarray:
    """Return the share of the ring beyond a radius that is in shadow (Cusick, 1968) [%]."""
    flat = np.pad(case["X"], ((0, 0), (0, 1)))[None]
    ring, *lit = (_count_cells(y[case["triangles"], :2], support) for y in (*flat, *x))
    return 100 * np.array(lit) / ring


def _count_cells(corners: np.ndarray, support: float) -> int:
    """Return how many cells of a grid triangles cover beyond the support; overlaps count once."""
    cell = support / 200
    count = int(np.ceil(2 * np.ptp(corners, axis=1).max() / cell))
    i, j = np.nonzero(np.tri(count + 1)[::-1])  # points of each triangle, closer than the cells
    weights = np.stack([i, j, count - i - j], axis=1) / count
    cells = np.unique(np.floor(weights @ corners / cell).astype(int).reshape(-1, 2), axis=0)
    return np.count_nonzero(np.hypot(*(cells.T + 0.5)) * cell >= support)


def _moved(case: Map, x: np.ndarray) -> np.ndarray:
    return x - np.pad(case["X"], ((0, 0), (0, 1)))
