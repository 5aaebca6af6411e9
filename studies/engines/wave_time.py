"""The time that limits the explicit steps of an engine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def crossing_time(case: Mapping[str, Any]) -> float:
    """Return the time in which a wave crosses the smallest altitude of a triangle [s]."""
    fabric, corners = case["fabric"], case["X"][case["triangles"]]
    plane = fabric["tensile_stiffness"][0] / (1 - fabric["poisson_ratio"] ** 2)
    area = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float((area / sides.max(axis=1)).min() * math.sqrt(fabric["areal_density"] / plane))
