"""Cost of an explicit step with a moved pin, over one with a fixed pin.

    python -m studies.evidence.benchmarks.moved_pin

A sheet of about 800 triangles is pinned along an edge. The pin is fixed, or moves by formulas, as
in a scene. The runs take turns in many short repeats on one thread, and the shortest count.
Formulas are evaluated for 64 steps at once: a repeat has as many steps, so that each contains one
evaluation.

The last lines are of `fc.run` with a row at each step, with its warnings before the run: a row with
a moved pin also has the work of the pin, and the energy of the deformation beside a rigid motion.
"""

from __future__ import annotations

import math
import time

import numpy as np

import fecloth as fc
from fecloth.system.constraints import TIMES_AT_ONCE
from studies import harness
from studies.evidence.benchmarks.measure import FABRIC, Measured, print_verdicts, square

TRIANGLES, STEPS, DT = 800, TIMES_AT_ONCE, 1e-6  # dt is far below the limit of stability
LIMIT = 1.3
ROWS, LIMIT_OF_ROWS = 1000, 1.7
MOTIONS = {
    "moved along z": ["0", "0", "0.1 * sin(2 * pi * t)"],
    "moved along all axes": ["0.1 * t", "0.1 * t**2", "0.1 * cos(20 * t) - 0.1"],
    "moved by formulas of t and Y": [
        "0.01 * sqrt(1 + t * Y)",
        "0.02 * sin(9 * t) * (1 - Y)",
        "0.03 * sin(7 * t + 2 * Y) * where(t < 0.4, t, 0.4)",
    ],
}


def make_sheet(motion: list[str] | None) -> tuple[fc.System, fc.State]:
    pin = fc.Pin("left", motion=motion) if motion else fc.Pin("left")
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity()]
    fabric = fc.Fabric(FABRIC.areal_density, 1000.0, 0.3, bending_rigidity=1e-5)
    system = fc.System(square(TRIANGLES), fabric, terms, [pin])
    X = system.cloth.X
    wave = np.column_stack([X, 0.02 * np.sin(3 * X[:, 0])])  # zero at the pin, as the motions are
    return system, system.state(wave)


def make_steps(motion: list[str] | None):
    """Return an iterator over the steps of central differences, compiled and started."""
    system, start = make_sheet(motion)
    steps = fc.march(system, fc.CentralDifference(), start, DT, 10.0)
    next(steps)
    return steps


def measure_rows(repeats: int, rows: int) -> list[Measured]:
    """Return the ratio of a run that records each step with each motion to a fixed pin."""
    sheets = {name: make_sheet(motion) for name, motion in {"fixed": None, **MOTIONS}.items()}
    best = dict.fromkeys(sheets, math.inf)
    for _ in range(repeats + 1):
        for name, (system, start) in sheets.items():
            begin = time.thread_time()
            fc.run(system, fc.CentralDifference(), start, DT, rows * DT)
            best[name] = min(best[name], time.thread_time() - begin)
    fixed = best.pop("fixed")
    print(f"fixed pin, with a row at each step: {1e6 * fixed / rows:.0f} µs per step")
    what = "the same with a row at each step, pin {} / fixed"
    return [
        Measured(what.format(name), t / fixed, "ratio", LIMIT_OF_ROWS) for name, t in best.items()
    ]


def measure(repeats: int) -> list[Measured]:
    """Return the ratio of a step with each motion to one with a fixed pin."""
    runs = {name: make_steps(motion) for name, motion in {"fixed": None, **MOTIONS}.items()}
    best = dict.fromkeys(runs, math.inf)
    for _ in range(repeats):
        for name, steps in runs.items():
            begin = time.thread_time()
            for _ in range(STEPS):
                next(steps)
            best[name] = min(best[name], time.thread_time() - begin)
    fixed = best.pop("fixed")
    print(f"fixed pin: {1e6 * fixed / STEPS:.0f} µs per step")
    what = f"explicit step of {TRIANGLES} triangles, pin {{}} / fixed"
    return [Measured(what.format(name), t / fixed, "ratio", LIMIT) for name, t in best.items()]


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few repeats")
    options = parser.parse_args()
    few = options.quick
    repeats, ways = (3, (1, 100)) if few else (300, (10, ROWS))
    jobs = [lambda: measure(repeats), lambda: measure_rows(*ways)]
    return print_verdicts(jobs, few)


if __name__ == "__main__":
    harness.run_main(main)
