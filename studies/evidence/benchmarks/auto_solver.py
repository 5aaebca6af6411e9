"""CPU time of the linear solver "auto" over the best of all, on twenty runs.

    python -m studies.evidence.benchmarks.auto_solver

The runs take a few steps each, on one thread: sheets held at two corners in free motion (500 to
200,000 triangles, steps of 0.5 to 33 ms), other scenes, methods and fabrics, and static solutions
by steps of backward Euler that are so long that nothing of the inertia is left. Each solver starts
anew, and the first run of all only compiles. Of several repeats the fastest counts; a solver that
has taken `HOPELESS` times as long as the best one is stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import fecloth as fc
from fecloth.scene.scene import load_scene
from fecloth.study.result import markdown_table
from studies import harness
from studies.evidence.benchmarks import step_costs
from studies.evidence.benchmarks.measure import FABRIC, SCENES, square

SOLVERS = ("multigrid", "pardiso", "pcg")
MEAN, WORST = 1.15, 1.4  # limits of the ratio
HOPELESS = 3.0
COTTON = fc.Fabric(0.15, (3000.0, 1500.0), 0.2, 60.0, 1e-5)


@dataclass(frozen=True, eq=False)
class Run:
    """A system, a method, a start, the size and the number of steps, and Newton's options."""

    system: fc.System
    method: object
    state: fc.State
    dt: float
    steps: int
    newton: fc.Newton

    def seconds(self, solver: str, most: float = math.inf) -> float:
        """Return the CPU seconds of the steps; infinite as soon as they exceed `most`."""
        context, _ = fc.solver_for(self.system, self.method, self.dt, solver, self.newton)
        t_end = self.state.t + (self.steps - 0.5) * self.dt
        begin = time.process_time()
        march = fc.march(self.system, self.method, self.state, self.dt, t_end, solver=context)
        for _ in march:
            if time.process_time() - begin > most:
                return math.inf
        return time.process_time() - begin


class Sheets:
    """Sheets of several meshes in the same motion."""

    def __init__(self, triangles: int = 2_000, t_end: float = 0.4):
        self.start, self.made = step_costs.fallen(triangles, t_end), {}

    def run(self, triangles: int, dt: float, steps: int, method=None, fabric=None) -> Run:
        """Return a run of a sheet."""
        if (triangles, fabric) not in self.made:
            system = step_costs.sheet(triangles, fabric=fabric or step_costs.FABRIC)
            self.made = {(triangles, fabric): (system, step_costs.transfer(*self.start, system))}
        system, state = self.made[triangles, fabric]
        return Run(system, method or fc.BackwardEuler(), state, dt, steps, fc.Newton())


def of_scene(name: str, steps: int, *overrides: str) -> Run:
    """Return a run of a file in studies/scenes."""
    built = load_scene(SCENES / f"{name}.toml", overrides).build()
    return Run(built.system, built.method, built.start, built.dt, steps, built.newton)


def damped(h: float) -> Run:
    """Return a run of a sheet with strain-rate damping."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h)
    terms = [fc.StVK(), fc.StrainRateDamping(0.02), fc.Gravity()]
    system = fc.System(cloth, FABRIC, terms, pins=["left"])
    return Run(system, fc.ImplicitMidpoint(), system.rest(), 2e-3, 20, fc.Newton())


def hanging(triangles: int) -> Run:
    """Return a static solution of a sheet under gravity that is held at an edge and bends."""
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity((0.0, -9.81, -1.0))]
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)
    system = fc.System(square(triangles), fabric, terms, [fc.Pin("top")])
    return Run(system, fc.BackwardEuler(), system.rest(), 10.0, 3, fc.Newton())


def inflated(triangles: int) -> Run:
    """Return a static solution of a square membrane under pressure."""
    terms = [fc.StVK(), fc.Pressure(100.0)]
    system = fc.System(square(triangles), FABRIC, terms, [fc.Pin("boundary")])
    X, Y = system.cloth.X.T
    height = 0.8 * X * (1 - X) * Y * (1 - Y)
    state = system.state(np.column_stack([X, Y, height]))
    return Run(system, fc.BackwardEuler(), state, 10.0, 2, fc.Newton())


def runs(quick: bool) -> dict[str, Callable[[], Run]]:
    """Return what makes each run, by its name."""
    sheets = Sheets(500, 0.1) if quick else Sheets()
    if quick:
        return {
            "sheet, 500 triangles, 5 ms": lambda: sheets.run(500, 5e-3, 2),
            "strip at rest, 1,000 triangles": lambda: of_scene("hanging_strip", 2),
        }
    found: dict[str, Callable[[], Run]] = {}
    for triangles, sizes, steps in (
        (500, (5e-4, 5e-3, 33e-3), 30),
        (8_000, (5e-4, 5e-3, 33e-3), 12),
        (50_000, (5e-4, 5e-3), 6),
        (200_000, (5e-4, 5e-3), 4),
    ):
        for dt in sizes:
            found[f"sheet, {triangles:,} triangles, {1e3 * dt:g} ms"] = (
                lambda triangles=triangles, dt=dt, steps=steps: sheets.run(triangles, dt, steps)
            )
    trampoline = "trampoline", 20, "time.dt=0.004"
    return found | {
        "sheet, 50,000 triangles, 17 ms": lambda: sheets.run(50_000, 1 / 60, 2),
        "BDF2, 2,000, 17 ms": lambda: sheets.run(2_000, 1 / 60, 20, fc.BDF2()),
        "cotton, 8,000, 17 ms": lambda: sheets.run(8_000, 1 / 60, 8, fabric=COTTON),
        "trampoline, 8,000, 1 ms": lambda: of_scene("trampoline", 20),
        "trampoline, 2,000, 4 ms": lambda: of_scene(*trampoline, "cloth.h=0.03"),
        "flag, 10 ms": lambda: of_scene("benchmark_flag", 30),
        "damped sheet, 11,000, 2 ms": lambda: damped(0.0145),
        "at rest: strip, 1,000": lambda: of_scene("hanging_strip", 3),
        "at rest: sheet that bends, 8,000": lambda: hanging(8_000),
        "at rest: membrane, 50,000": lambda: inflated(50_000),
    }


def compare(name: str, make: Callable[[], Run], least: float) -> dict:
    """Return a row of the table: the seconds of each solver, the fastest of `least` CPU seconds."""
    run = make()
    run.seconds("auto", 1.0)
    best = dict.fromkeys((*SOLVERS, "auto"), math.inf)
    begin = time.process_time()
    while math.isinf(best["auto"]) or time.process_time() - begin < least:
        for solver in best:
            most = HOPELESS * min(best.values())
            best[solver] = min(best[solver], run.seconds(solver, most))
    fastest = min(SOLVERS, key=lambda solver: best[solver])
    return {"run": name, **best, "best": fastest, "auto / best": best["auto"] / best[fastest]}


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two short runs, no limits")
    parser.add_argument("--only", default="", help="runs whose names have this text")
    options = parser.parse_args()
    rows = []
    for name, make in runs(options.quick).items():
        if options.only in name:
            rows.append(compare(name, make, 0.0 if options.quick else 3.0))
            print(rows[-1], flush=True)
    print(markdown_table(rows), end="\n\n")
    ratios = [row["auto / best"] for row in rows]
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    findings = [
        harness.Finding("auto over the best, geometric mean", mean, high=MEAN),
        harness.Finding("auto over the best, the worst run", max(ratios), high=WORST),
    ]
    print(*findings, sep="\n")
    return 0 if options.quick or all(finding.is_met for finding in findings) else 1


if __name__ == "__main__":
    harness.run_main(main)
