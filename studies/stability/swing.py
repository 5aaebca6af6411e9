"""Error of each method on the stiff swing against short explicit steps: `fc.study.sweep`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fecloth import study
from fecloth.integrators import METHODS
from fecloth.scene.scene import load_scene
from studies import harness

SCENE = Path(__file__).parents[1] / "scenes" / "failures" / "stiff_swing.toml"
SPAN = 0.7  # s
COUNTS = (8, 16, 32, 64, 128, 256)  # steps of a run
QUANTITIES = [
    f"mean_displacement.{c} at {part} s" for part in (0.175, 0.35, 0.525, 0.7) for c in "xz"
]
RIGHT = {"bdf2": 16, "energy_momentum": 64, "linearly_implicit_euler": 256}
SHORT = ["time.method=central_difference", "time.dt=auto"]  # 0.9 of the stable step


def measure_errors(running: dict) -> list[dict]:
    """Return the error of each method and step, over the largest mean displacement.

    The error is the largest distance of the mean displacement at the quarters of the time.
    """
    how = {"cache" if key == "out" else key: value for key, value in running.items()}
    exact = study.sweep(load_scene(SCENE, SHORT), {"output.frames": [1]}, QUANTITIES, **how)
    over = {"time.method": list(METHODS), "time.dt": [SPAN / count for count in COUNTS]}
    found = study.sweep(SCENE, over, QUANTITIES, **how)
    right = values_of(exact.table[0])
    size = np.linalg.norm(right, axis=1).max()
    rows = []
    for row in found.table:
        line = {"method": row["time.method"], "dt": row["time.dt"], "outcome": row["status"]}
        if row["status"] == "ok":
            apart = np.linalg.norm(values_of(row) - right, axis=1).max()
            line["error"] = float(apart / size)
        rows.append(line)
    return rows


def values_of(row) -> np.ndarray:
    """Return the mean displacement (x, z) at each quarter of the time [m]."""
    return np.array([row[name] for name in QUANTITIES]).reshape(-1, 2)


def conclude_errors(rows: list[dict]) -> list[harness.Finding]:
    """Return the errors at the longest steps that are to be right within 10 %."""
    findings = []
    for row in rows:
        count = RIGHT.get(row["method"])
        if count and row["dt"] == SPAN / count:
            words = f"{row['method']} on the stiff swing at {1e3 * row['dt']:.3g} ms"
            error = row.get("error", np.nan)
            findings.append(harness.Finding(f"{words}: error against short steps", error, high=0.1))
    return findings
