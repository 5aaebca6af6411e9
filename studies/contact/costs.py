"""What does a second of motion with contact cost at an error of 1 %?

The step of BDF2 is halved from 10 ms on, until the distance to the run with half of it is at most
1 % of the way.

    python -m studies.contact.costs [--quick] [--triangles 500 2000 8000]
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import fecloth as fc
from fecloth import study
from studies import harness
from studies.contact.everyday import S, level, on, scene, upright
from studies.contact.motions import distance, march

SIZES, FIRST, LEAST = (500, 2000, 8000), 1e-2, 1e-4  # triangles; steps [s]
ALLOWED, T_END = 1.0, 0.2  # % of the way; s


def set_up(name: str, triangles: int):
    """The system, its start and its end in time."""
    width, height = (0.5, 0.8) if name == "curtain and wall" else (0.5, 0.5)
    h = 1.52 * math.sqrt(width * height / triangles)  # of triangles as Gmsh makes them
    cloth = fc.Cloth.rectangle(width, height, h)
    if name == "curtain and wall":
        wind = fc.Wind((0, 3.0, 0), normal=1.0)
        wall = on(S.Plane((0, 0.02, 0), (0, -1, 0)))
        return scene(cloth, [wall], ["top"], upright(cloth), t_end=T_END, more=[wind])
    shapes = {
        "cloth on a box": S.Box((0, 0, -0.1), (0.25, 0.25, 0.2)),
        "cloth on a ball": S.Sphere((0, 0, -0.12), 0.12),
    }
    return scene(cloth, [on(shapes[name])], x=level(cloth), t_end=T_END)


def halve(name: str, triangles: int, t_end: float) -> dict:
    """The row of the longest step whose error is at most `ALLOWED`."""
    warnings.simplefilter("ignore", fc.FeclothWarning)
    system, start, _ = set_up(name, triangles)
    dt, motion = FIRST, march(system, start, fc.BDF2(), FIRST, t_end)
    while True:
        finer = march(system, start, fc.BDF2(), 0.5 * dt, t_end)
        size = distance(system, finer.places, start.x[None])
        error = 100 * distance(system, motion.places, finer.places) / size
        if error <= ALLOWED or dt <= LEAST:
            break
        dt, motion = 0.5 * dt, finer
    return {
        "triangles made": len(system.cloth.triangles),
        "dt [ms]": 1e3 * dt,
        "error %": error,
        "CPU s a second": motion.cpu_seconds / t_end,
        "Newton a step": motion.run.newton / motion.run.steps,
    }


def main() -> int:
    """Run the scenes, and write the report."""
    sizes = {"type": int, "nargs": "+", "default": list(SIZES), "metavar": "N"}
    options = harness.parse_arguments(__doc__, triangles=sizes)
    names = ("cloth on a box", "cloth on a ball", "curtain and wall")
    sizes, t_end = ([100], 0.4 * T_END) if options.quick else (options.triangles, T_END)
    cases = [{"name": name, "triangles": n, "t_end": t_end} for n in sizes for name in names]
    rows = study.run_cases(cases, halve, **harness.run_options(options, alone=True))
    title, _ = harness.about(__doc__)
    harness.require_results(options, title, rows)
    errors = [row["error %"] for row in rows if row["status"] == "ok"]
    findings = [harness.Finding("largest error of a row, %", max(errors), high=ALLOWED)]
    hidden = ("t_end", "status", "cause")
    table = [{key: cell for key, cell in row.items() if key not in hidden} for row in rows]
    page = Path(__file__).with_suffix("")
    return harness.conclude(options, __doc__, page, rows, findings, {"Costs": table})


if __name__ == "__main__":
    harness.run_main(main)
