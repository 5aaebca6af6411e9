"""What the benchmarks share: a measured number with its limit, timing, a square cloth."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fecloth as fc

FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
SCENES = Path(__file__).parents[2] / "scenes"


@dataclass(frozen=True)
class Measured:
    """A measured number and its limit."""

    what: str
    value: float
    unit: str
    limit: float
    at_least: bool = False

    @property
    def is_met(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def __str__(self) -> str:
        sign, verdict = (">=" if self.at_least else "<="), ("met" if self.is_met else "MISSED")
        return (
            f"{self.what:<62} {self.value:>10.4g} {sign} {self.limit:<6g} {self.unit:<18} {verdict}"
        )


def fastest(
    function: Callable[[], object], repeat: int = 7, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the seconds of the fastest of several calls, after one call to warm up."""
    function()
    times = []
    for _ in range(repeat):
        begin = clock()
        function()
        times.append(clock() - begin)
    return min(times)


def square(triangles: int, pattern: str = "unstructured") -> fc.Cloth:
    """Return a unit square of about that many triangles."""
    h = (1.52 if pattern == "unstructured" else np.sqrt(2)) / np.sqrt(triangles)
    return fc.Cloth.rectangle(1.0, 1.0, h=h, pattern=pattern)


def print_verdicts(jobs: list[Callable[[], list[Measured]]], is_quick: bool) -> int:
    """Run the jobs and print their numbers; return 1 if a limit is missed, except with --quick."""
    measured = []
    for job in jobs:
        for one in job():
            print(one, flush=True)
            measured.append(one)
    missed = sum(not one.is_met for one in measured)
    print(f"{len(measured) - missed} of {len(measured)} figures met")
    return 1 if missed and not is_quick else 0
