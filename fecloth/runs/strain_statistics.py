"""Rows of strains.csv: extremes and percentiles of the principal stretches of a frame."""

from __future__ import annotations

import numpy as np

STRETCHES = ("smallest", "1 %", "median", "99 %", "largest")


def stretch_row(t: float, stretches: np.ndarray) -> dict[str, float]:
    """Return a row of strains.csv for the principal stretches (m, 2), smaller and larger.

    "1 %" is a percentile of the smaller stretches, "99 %" one of the larger; the median is that of
    the larger stretches.
    """
    smaller, larger = np.asarray(stretches).T
    low, high = np.percentile(smaller, 1), np.percentile(larger, 99)
    values = smaller.min(), low, np.median(larger), high, larger.max()
    return {"t": float(t)} | {k: float(v) for k, v in zip(STRETCHES, values, strict=True)}
