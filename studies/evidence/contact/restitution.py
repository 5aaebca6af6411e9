"""What is left of the speed of a flat cloth that hits a plane?

A sheet of two triangles (200 g/m²) flies onto a plane without gravity, gap 1 mm, κ = 2 kPa, at
eight phases of the touch in the step. For each restitution, speed, step and method the table has
the least and the largest part of the speed that is left, and by how much the total energy exceeds
its first value at most. For e = 0 the part must be 0 … 0.05, and otherwise e ± 0.05 with BDF2 where
steps resolve the bounce, dt ≤ gap/(50 v).

    python -m studies.evidence.contact.restitution [--quick]
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

import fecloth as fc
from studies import harness

GAP, STIFFNESS = 1e-3, 2000.0
SPEEDS, STEPS, PARTS = (0.1, 1.0, 5.0), (1e-2, 1e-3, 1e-4), (1.0, 0.5)
PHASES = (np.arange(8) + 0.5) / 8
METHODS = (fc.BackwardEuler(), fc.BDF2())
ROUND = 1e-9


def bounce(method: object, v: float, dt: float, phase: float, e: float) -> tuple[float, float]:
    """Return the part of the speed that is left, and the largest energy over the first, less 1."""
    cloth = fc.Cloth.rectangle(0.05, 0.05, 0.05, "right")
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    plane = fc.shapes.Plane((0, 0, 0), (0, 0, 1))
    floor = fc.Obstacle(plane, GAP, stiffness=STIFFNESS, restitution=e)
    system = fc.System(cloth, fabric, [fc.StVK(), floor])
    x = np.column_stack([cloth.X, np.full(len(cloth.X), GAP + (2 + phase) * v * dt)])
    start = system.state(x, 0 * x - [0, 0, v])
    steps = 8 + round(2 * GAP / v / dt) if e == 0 else 20 + round(3 * GAP / v / dt)
    run = fc.run(system, method, start, dt=dt, t_end=steps * dt)
    total = run.energies["total"]
    left = system.nodal_mass @ run.state.v[:, 2] / system.total_mass / v
    return float(left), float(total.max() / total[0] - 1)


def cases(quick: bool) -> list[tuple[float, float, float]]:
    """Return restitutions, speeds and steps; above e = 0 resolved and coarse ones."""
    speeds = SPEEDS[1:2] if quick else SPEEDS
    steps = STEPS[:1] if quick else STEPS
    found = [(0.0, v, dt) for v in speeds for dt in steps]
    fine = [(e, v, GAP / (50 * v)) for e in PARTS for v in speeds]
    coarse = [] if quick else [(e, v, dt) for e in PARTS for v in speeds for dt in STEPS[:2]]
    return found + fine + coarse


def measure(quick: bool) -> list[dict]:
    """Return a row for each restitution, speed, step and method."""
    rows = []
    for e, v, dt in cases(quick):
        for method in METHODS:
            runs = [bounce(method, v, dt, at, e) for at in (PHASES[::4] if quick else PHASES)]
            left, gain = zip(*runs, strict=True)
            row = {"e": e, "speed [m/s]": v, "dt [s]": dt, "method": type(method).__name__}
            row |= {"resolved": dt <= GAP / (50 * v)}
            rows.append(row | {"least": min(left), "largest": max(left), "gain": max(gain)})
    return rows


def is_missed(row: dict) -> bool:
    """Return whether a row gains energy, or what is left is outside its range."""
    e = row["e"]
    resolved = row["method"] == "BDF2" and row["resolved"]
    low, high = (0.0, 0.05) if e == 0 else (e - 0.05, e + 0.05) if resolved else (-1, 2)
    return row["least"] < low or row["largest"] > high or row["gain"] > ROUND


def summary(rows: list[dict]) -> list[dict]:
    """Return the extremes over speeds and steps."""
    keys, lines = ("e", "resolved", "method"), []
    for of in dict.fromkeys(tuple(row[key] for key in keys) for row in rows):
        own = [row for row in rows if tuple(row[key] for key in keys) == of]
        least, largest = min(row["least"] for row in own), max(row["largest"] for row in own)
        left = {"left, least": f"{least:.3f}", "largest": f"{largest:.3f}"}
        lines.append(dict(zip(keys, of, strict=True)) | left)
    return lines


def main() -> int:
    options = harness.parse_arguments(__doc__)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fc.FeclothWarning)
        rows = measure(options.quick)
    title, what = harness.about(__doc__)
    missed = sum(map(is_missed, rows))
    finding = harness.Finding("rows that miss their range or gain energy", missed, high=0)
    return harness.write_report(
        options,
        title,
        rows,
        conclusion=what,
        findings=[finding],
        tables={"Part of the speed that is left, over all speeds and steps": summary(rows)},
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
