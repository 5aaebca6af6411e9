"""What is left of the speed of a flat cloth that hits a plane.

    python -m studies.evidence.contact.restitution [--quick]

A sheet of two triangles (200 g/m²) flies onto a plane without gravity, gap 1 mm, κ = 2 kPa, at
eight phases of the touch in the step. For each restitution, speed, step and method the table has
the least and the largest part of the speed that is left, and by how much the total energy exceeds
its first value at most. For e = 0 the part must be 0 … 0.05, and otherwise e ± 0.05 with BDF2 where
steps resolve the bounce, dt ≤ gap/(50 v). The full form writes restitution.md.
"""

from __future__ import annotations

import inspect
import sys
import warnings
from pathlib import Path

import numpy as np

import fecloth as fc
from studies import harness

HERE = Path(__file__).parent
GAP, STIFFNESS = 1e-3, 2000.0
SPEEDS, STEPS, PARTS = (0.1, 1.0, 5.0), (1e-2, 1e-3, 1e-4), (1.0, 0.5)
PHASES = (np.arange(8) + 0.5) / 8
METHODS = (fc.BackwardEuler(), fc.BDF2())
ROUND = 1e-9
TITLE = "| e | speed [m/s] | dt | method | left, least | largest | gain of energy |"


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


def rows(quick: bool) -> tuple[list[str], list[str]]:
    """Return the rows of the table, and what is missed."""
    lines, missed = [], []
    for e, v, dt in cases(quick):
        for method in METHODS:
            runs = [bounce(method, v, dt, at, e) for at in (PHASES[::4] if quick else PHASES)]
            left, gain = zip(*runs, strict=True)
            name = type(method).__name__
            told = (
                f"{1e3 * dt:.3g} ms | {name} | {min(left):.3f} | {max(left):.3f} | {max(gain):.0e}"
            )
            lines.append(f"| {e:g} | {v:g} | {told} |")
            resolved = name == "BDF2" and dt <= GAP / (50 * v)
            low, high = (0.0, 0.05) if e == 0 else (e - 0.05, e + 0.05) if resolved else (-1, 2)
            if min(left) < low or max(left) > high or max(gain) > ROUND:
                missed.append(lines[-1])
    return lines, missed


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one speed, two phases")
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fc.FeclothWarning)
        lines, missed = rows(options.quick)
    verdict = f"{len(missed)} of {len(lines)} rows miss their range or gain energy"
    head = f"{TITLE}\n|{'---|' * TITLE[1:].count('|')}\n"
    page = f"# Restitution\n\n{inspect.getdoc(sys.modules[__name__])}\n\n{head}"
    page += "\n".join(lines) + f"\n\n{verdict}: {'missed' if missed else 'met'}.\n"
    print(page)
    if not options.quick:
        (HERE / "restitution.md").write_text(page, encoding="utf-8")
    return len(missed)


if __name__ == "__main__":
    harness.run_main(main)
