"""Quantities that cases ask for: values over time of displacements u (times, n, 3) [m]."""

import numpy as np
import scipy

from fecloth.bench.cases import points


def mean(case: dict, u: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean displacement along an axis over the area of the flat cloth [m]."""
    corners = case["X"][case["triangles"]]
    area = np.linalg.det(corners[:, 1:] - corners[:, :1])
    return u[:, case["triangles"], axis].mean(axis=2) @ area / area.sum()


def point(case: dict, u: np.ndarray, axis: int, at: list, beside: list | None = None) -> np.ndarray:
    """Return the displacement of the point `at` of the flat cloth [m].

    If there is a point `beside`, it is relative to the displacement of that point.
    """
    displacement = scipy.interpolate.LinearNDInterpolator(case["X"], u[:, :, axis].T)
    if beside is None:
        return displacement(*at)
    return displacement(*at) - displacement(*beside)


def away(case: dict, u: np.ndarray, motion: list[str]) -> np.ndarray:
    """Return the largest distance of a node from its place by formulas of X, Y and t [m]."""
    return np.linalg.norm(u - points(motion, case["X"], case["times"]), axis=2).max(axis=1)


def period(case: dict, u: np.ndarray, axis: int) -> np.ndarray:
    """Return twice the mean time between zeros of the mean displacement [s].

    It is NaN if there are fewer than two zeros.
    """
    y = mean(case, u, axis)
    t = case["times"]
    i = np.flatnonzero(y[:-1] * y[1:] < 0)
    zeros = t[i] + (t[i + 1] - t[i]) * y[i] / (y[i] - y[i + 1])
    if len(zeros) < 2:
        return np.array(np.nan)
    return np.array(2 * np.diff(zeros).mean())


def shadow(case: dict, u: np.ndarray, support: float) -> np.ndarray:
    """Return the part of the ring beyond the radius `support` [m] that is in shadow [%], (times,).

    The ring is the flat cloth without the support, and light falls along z. The triangles are
    drawn on a grid of cells, of which 200 are as long as the radius, and cells that a triangle
    covers are counted. Source: Cusick (1965).
    """
    covered = []  # number of cells in shadow: of the flat cloth, then at each time
    flat = np.pad(case["X"], ((0, 0), (0, 1)))
    for x in flat + [0 * u[0], *u]:
        corners = 200 / support * x[case["triangles"], :2]  # in cells
        count = int(np.ceil(2 * np.ptp(corners, axis=1).max()))
        i, j = np.nonzero(np.tri(count + 1)[::-1])  # points in a triangle, closer than cells
        weights = np.stack([i, j, count - i - j], axis=1) / count
        cells = np.unique(np.floor(weights @ corners) @ (1, 1j))  # x + i y of their lower corners
        covered.append(np.sum(np.abs(cells + 0.5 + 0.5j) >= 200))
    return 100 * np.array(covered[1:]) / covered[0]
