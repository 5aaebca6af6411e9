"""Rows of strains.csv: extremes and percentiles of the principal stretches of a frame."""

from __future__ import annotations

import numpy as np

STRETCHES = ("smallest", "1 %", "median", "99 %", "largest")


def stretch_row(t: float, stretches: np.ndarray) -> dict[str, float]:
    """A row of strains.csv: extremes and percentiles of the principal stretches (m, 2).

    "1 %" is the stretch that one in a hundred triangles falls short of, by its smaller one; "99 %"
    the one that as many exceed, by their larger one; the median is of the larger ones.
    """
    smaller, larger = np.asarray(stretches).T
    values = smaller.min(), np.percentile(smaller, 1), np.median(larger)
    values += np.percentile(larger, 99), larger.max()
    return {"t": float(t)} | {k: float(v) for k, v in zip(STRETCHES, values, strict=True)}
