"""The prescribed motion of pins at the ends of many steps, for loops without Python."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.system.constraints import Constraints


@dataclass(frozen=True, eq=False)
class MotionRows:
    """What `Constraints.target` adds in each of several steps."""

    # (s + 1,) begin and ends of the steps, (s,) their sizes, and (s,) begin plus size [s], which
    # may differ from the end by round-off.
    times: np.ndarray
    sizes: np.ndarray
    reached: np.ndarray
    # (s, c, 3) displacement over each step [m] and velocity at its end [m/s] of the constrained
    # nodes; one row for all steps where no pin moves.
    path: np.ndarray
    speed: np.ndarray

    @classmethod
    def are_known(cls, constraints: Constraints) -> bool:
        """Whether the motion does not depend on where the nodes are."""
        return all(pin.rotate is None for pin, _ in constraints.groups.values())

    @classmethod
    def of(cls, constraints: Constraints, times: np.ndarray, sizes: np.ndarray) -> MotionRows:
        """Evaluate the motion at the `times` (s + 1,) of steps of `sizes` (s,)."""
        moved = [(pin, nodes) for pin, nodes in constraints.groups.values() if pin.moves]
        reached = times[:-1] + sizes
        shape = len(sizes) if moved else 1, len(constraints.nodes), 3
        path, speed = np.zeros(shape), np.zeros(shape)
        for pin, nodes in moved:
            at = np.searchsorted(constraints.nodes, nodes)
            known, last = None, None  # the end of a step is nearly always the start of the next
            for s, (t, end) in enumerate(zip(times.tolist(), reached.tolist(), strict=False)):
                begin = last if t == known else pin.displacement(t)
                known, last = end, pin.displacement(end)
                path[s, at], speed[s, at] = last - begin, pin.speed(end, since=t)
        return cls(times, sizes, reached, path, speed)
