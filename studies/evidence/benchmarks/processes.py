"""Benchmarks that start processes: seconds to the first step, peak memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import fecloth as fc
from studies.evidence.benchmarks.measure import FABRIC, SCENES, Measured, square


def first_step() -> list[Measured]:
    """Return the seconds from the start of `fecloth run` to its first step, run twice."""
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        for what, limit in (("nothing compiled yet", 30), ("a second run", 4)):
            out = Path(folder) / what.replace(" ", "_")
            command = [sys.executable, "-m", "fecloth", "run", str(SCENES / "benchmark_flag.toml")]
            command += ["-o", str(out), "--quiet", "--set", "time.t_end=0.05"]
            seconds = seconds_to_first_row(command, environment, out / "steps.csv")
            figures.append(Measured(f"flag scene: first step, {what}", seconds, "s", limit))
    return figures


def seconds_to_first_row(command, environment, table: Path) -> float:
    """Return the seconds from the start of a process until its table has a row below the header."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, env=environment)
    while process.poll() is None:
        if table.exists() and table.read_text(encoding="utf-8").count("\n") > 1:
            break
        time.sleep(0.01)
    seconds = time.perf_counter() - begin
    if process.wait():
        raise SystemExit(f"{' '.join(command)} failed")
    return seconds


def memory() -> list[Measured]:
    """Return the increase of the peak memory with the number of triangles, with PCG."""
    peaks = {}
    for triangles in (50_000, 200_000):
        command = [
            sys.executable,
            "-m",
            "studies.evidence.benchmarks.kernels",
            "--peak-of",
            str(triangles),
        ]
        peaks[triangles] = np.array(
            json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        )
    (peak, count), (peak_large, count_large) = peaks.values()
    slope = 1e3 * (peak_large - peak) / (count_large - count)
    return [Measured("peak memory besides a factor, 50,000 to 200,000", slope, "kB/triangle", 2)]


def print_peak(triangles: int) -> None:
    """Print [peak MB, triangles] of a short PCG run in this process."""
    from fecloth.runs.environment import peak_memory

    system = fc.System(square(triangles), FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    for _ in fc.march(system, fc.ImplicitMidpoint(), system.rest(), 1e-4, 3e-4, solver="pcg"):
        pass
    print(json.dumps([peak_memory(), len(system.cloth.triangles)]))
