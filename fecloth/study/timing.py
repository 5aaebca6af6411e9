"""Honest seconds: warm, compilation apart, the minimum of several runs, CPU and wall."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Seconds:
    """What a call takes.

    Attributes
    ----------
    wall, cpu
        Seconds of the fastest of the counted calls, by the clock and by the processor.
    first
        Seconds of the first call by the clock, which is not counted.
    compiling
        What of the first call was compiling and loading, first − wall, at least 0.
    value
        What the last call returned.
    """

    wall: float
    cpu: float
    first: float
    value: object = None

    @property
    def compiling(self) -> float:
        return max(0.0, self.first - self.wall)

    @property
    def row(self) -> dict[str, float]:
        """For the row of a case."""
        return {"seconds": self.wall, "cpu_seconds": self.cpu, "compile_seconds": self.compiling}


def timed(function: Callable[[], object], repeats: int = 3) -> Seconds:
    """Call once to warm up, then `repeats` times; the minimum counts.

    Examples
    --------
    >>> calls = []
    >>> seconds = timed(lambda: calls.append(1), repeats=3)
    >>> len(calls), seconds.wall <= seconds.first + seconds.wall
    (4, True)
    """
    first, _, _ = _once(function)
    runs = [_once(function) for _ in range(repeats)]
    wall, cpu = (min(run[i] for run in runs) for i in (0, 1))
    return Seconds(wall, cpu, first, runs[-1][2])


def _once(function) -> tuple[float, float, object]:
    wall, cpu = time.perf_counter(), time.process_time()
    value = function()
    return time.perf_counter() - wall, time.process_time() - cpu, value
