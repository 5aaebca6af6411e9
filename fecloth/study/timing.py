"""Measured seconds: after a warm-up, without compilation, the minimum of several calls."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Seconds:
    """Duration of a call.

    Attributes
    ----------
    wall, cpu
        Wall-clock and processor time of the fastest call, each [s].
    first
        Wall-clock time of the first call [s], which compiles and does not count.
    value
        Result of the last call.
    """

    wall: float
    cpu: float
    first: float
    value: object = None

    @property
    def compiling(self) -> float:
        """Time of compiling and loading in the first call, first − wall ≥ 0 [s]."""
        return max(0.0, self.first - self.wall)

    @property
    def row(self) -> dict[str, float]:
        """Columns of a case's row."""
        return {"seconds": self.wall, "cpu_seconds": self.cpu, "compile_seconds": self.compiling}


def measure_seconds(function: Callable[[], object], repeats: int = 3) -> Seconds:
    """Call a function once to warm up, then `repeats` times, and return the shortest times.

    Examples
    --------
    >>> calls = []
    >>> seconds = measure_seconds(lambda: calls.append(1), repeats=3)
    >>> len(calls), seconds.wall <= seconds.first + seconds.wall
    (4, True)
    """
    first, _, _ = _measure_one_call(function)
    calls = [_measure_one_call(function) for _ in range(repeats)]
    wall = min(call[0] for call in calls)
    cpu = min(call[1] for call in calls)
    return Seconds(wall, cpu, first, calls[-1][2])


def _measure_one_call(function) -> tuple[float, float, object]:
    wall, cpu = time.perf_counter(), time.process_time()
    value = function()
    return time.perf_counter() - wall, time.process_time() - cpu, value
