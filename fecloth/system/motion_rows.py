"""The motion of the pins in many steps, evaluated at once."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from fecloth.system.constraints import Constraints


@dataclass(frozen=True, eq=False)
class MotionRows:
    """What `Constraints.target` adds in each of several steps.

    `path` and `speed` have one row for all steps where no pin moves.

    Attributes
    ----------
    times
        (s + 1,) the begin and the ends of the steps [s].
    sizes
        (s,) their sizes [s].
    reached
        (s,) begin plus size [s], which may differ from the end by round-off.
    path
        (s, c, 3) displacement of the constrained nodes over each step [m].
    speed
        (s, c, 3) their velocity at the end of each step [m/s].
    """

    times: np.ndarray
    sizes: np.ndarray
    reached: np.ndarray
    path: np.ndarray
    speed: np.ndarray

    @classmethod
    def can_evaluate(cls, constraints: Constraints) -> bool:
        """Whether the motion does not depend on where the nodes are."""
        turns = any(pin.rotate for pin, _ in constraints.groups.values())
        return not (turns or constraints.followers.closes)

    @classmethod
    def evaluate(cls, constraints: Constraints, times: np.ndarray, sizes: np.ndarray) -> Self:
        """Evaluate the motion of the pins in s steps.

        `times` (s + 1,) are the begin and the ends of the steps [s], and `sizes` (s,) their
        sizes [s]. The pins must not rotate, see `can_evaluate`.
        """
        moved = constraints.moved
        reached = times[:-1] + sizes
        rows = len(sizes) if moved else 1
        shape = rows, len(constraints.nodes), 3
        path = np.zeros(shape)
        speed = np.zeros(shape)
        for group in moved:
            at = np.searchsorted(constraints.nodes, group.nodes)
            path[:, at], speed[:, at] = group.rows(times[:-1], reached)
        return cls(times, sizes, reached, path, speed)
