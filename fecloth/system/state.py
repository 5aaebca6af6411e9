"""The state of a cloth at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.system.records import remembered


@remembered
@dataclass(frozen=True, eq=False)
class State:
    """Time t [s], positions x (n, 3) [m] and velocities v (n, 3) [m/s]."""

    t: float
    x: np.ndarray
    v: np.ndarray

    def __repr__(self) -> str:
        return f"<State of {len(self.x)} nodes at t = {self.t:g} s>"
