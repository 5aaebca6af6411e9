"""CPU time of the linear solver "auto" over the best of all, on membranes and plates of all sizes.

    python -m studies.evidence.benchmarks.auto_solver [--only TEXT] [--long] [--quick]

Membranes and plates that hang at an edge swing for 12 and for 100 steps (BDF2, 5 ms, 500 to 100,000
triangles; --long takes the 100 steps on more than 10,000 triangles too, for an hour). The other
runs take a few steps: sheets held at two corners in free motion, in steps of 0.5 to 33 ms, other
scenes, methods and fabrics, and static solutions by steps of backward Euler that are so long that
nothing of the inertia is left. All are on one thread. Each solver starts anew, and the first run of
all only compiles. Of several repeats the fastest counts; a solver that has taken `HOPELESS` times
as long as the best one is stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

import fecloth as fc
from fecloth.scene.scene import load_scene
from fecloth.study.result import markdown_table
from studies import harness
from studies.evidence.benchmarks import step_costs
from studies.evidence.benchmarks.measure import FABRIC, SCENES, square

SOLVERS = ("multigrid", "direct", "pcg")  # "direct" is PARDISO where it is installed, else rslab
MEAN, WORST = 1.1, 1.25  # limits of the ratio
HOPELESS = 3.0
SWINGING = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
COTTON = fc.Fabric(0.15, (3000.0, 1500.0), 0.2, 60.0, 1e-5)


@dataclass(frozen=True, eq=False)
class Run:
    """A system, a method, a start, the size and the number of steps, and Newton's options.

    The seconds are of all steps, or also of the first ones: up to each number in `steps`.
    """

    system: fc.System
    method: object
    state: fc.State
    dt: float
    steps: tuple[int, ...]
    newton: fc.Newton

    def seconds(self, solver: str, most: float = math.inf) -> np.ndarray:
        """Return the CPU seconds of the steps; infinite from where they exceed `most`."""
        context, _ = fc.solver_for(self.system, self.method, self.dt, solver, self.newton)
        t_end = self.state.t + (self.steps[-1] - 0.5) * self.dt
        seconds = np.full(len(self.steps), math.inf)
        begin = time.process_time()
        march = fc.march(self.system, self.method, self.state, self.dt, t_end, solver=context)
        for number, _ in enumerate(march, start=1):
            now = time.process_time() - begin
            if now > most:
                break
            if number in self.steps:
                seconds[self.steps.index(number)] = now
        return seconds


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
        return Run(system, method or fc.BackwardEuler(), state, dt, (steps,), fc.Newton())


def of_scene(name: str, steps: int, *overrides: str) -> Run:
    """Return a run of a file in studies/scenes."""
    built = load_scene(SCENES / f"{name}.toml", overrides).build()
    return Run(built.system, built.method, built.start, built.dt, (steps,), built.newton)


def swinging(kind: str, triangles: int, steps: tuple[int, ...]) -> Run:
    """Return a run of a flat sheet, "membrane" or "plate", that hangs at an edge and is let go."""
    terms: list = [fc.StVK(), fc.Gravity()]
    if kind == "plate":
        terms += [fc.PlateBending(), fc.StrainRateDamping(0.02)]
    system = fc.System(square(triangles), SWINGING, terms, [fc.Pin("top")])
    return Run(system, fc.BDF2(), system.rest(), 5e-3, steps, fc.Newton())


def damped(h: float) -> Run:
    """Return a run of a sheet with strain-rate damping."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h)
    terms = [fc.StVK(), fc.StrainRateDamping(0.02), fc.Gravity()]
    system = fc.System(cloth, FABRIC, terms, pins=["left"])
    return Run(system, fc.ImplicitMidpoint(), system.rest(), 2e-3, (20,), fc.Newton())


def hanging(triangles: int) -> Run:
    """Return a static solution of a sheet under gravity that is held at an edge and bends."""
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity((0.0, -9.81, -1.0))]
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)
    system = fc.System(square(triangles), fabric, terms, [fc.Pin("top")])
    return Run(system, fc.BackwardEuler(), system.rest(), 10.0, (3,), fc.Newton())


def inflated(triangles: int) -> Run:
    """Return a static solution of a square membrane under pressure."""
    terms = [fc.StVK(), fc.Pressure(100.0)]
    system = fc.System(square(triangles), FABRIC, terms, [fc.Pin("boundary")])
    X, Y = system.cloth.X.T
    height = 0.8 * X * (1 - X) * Y * (1 - Y)
    state = system.state(np.column_stack([X, Y, height]))
    return Run(system, fc.BackwardEuler(), state, 10.0, (2,), fc.Newton())


def runs(quick: bool, takes_long: bool) -> dict[str, Callable[[], Run]]:
    """Return what makes each run, by its name."""
    sheets = Sheets(500, 0.1) if quick else Sheets()
    if quick:
        return {
            "plate, 500": lambda: swinging("plate", 500, (2, 4)),
            "strip at rest, 1,000": lambda: of_scene("hanging_strip", 2),
        }
    made: dict[str, Callable[[], Run]] = {}
    for kind in ("membrane", "plate"):
        for triangles in (500, 1_000, 2_000, 8_000, 32_000, 100_000):
            steps = (12, 100) if takes_long or triangles < 10_000 else (12,)
            made[f"{kind}, {triangles:,}"] = partial(swinging, kind, triangles, steps)
    for triangles, dt, steps in (
        (500, 33e-3, 30),
        (8_000, 5e-4, 12),
        (8_000, 33e-3, 12),
        (50_000, 5e-4, 6),
        (50_000, 17e-3, 2),
        (200_000, 5e-4, 4),
    ):
        name = f"sheet, {triangles:,}, {1e3 * dt:g} ms"
        made[name] = partial(sheets.run, triangles, dt, steps)
    trampoline = "trampoline", 20, "time.dt=0.004"
    return made | {
        "cotton, 8,000, 17 ms": lambda: sheets.run(8_000, 1 / 60, 8, fabric=COTTON),
        "trampoline, 8,000, 1 ms": lambda: of_scene("trampoline", 20),
        "trampoline, 2,000, 4 ms": lambda: of_scene(*trampoline, "cloth.h=0.03"),
        "flag, 10 ms": lambda: of_scene("benchmark_flag", 30),
        "damped sheet, 11,000, 2 ms": lambda: damped(0.0145),
        "at rest: strip, 1,000": lambda: of_scene("hanging_strip", 3),
        "at rest: sheet that bends, 8,000": lambda: hanging(8_000),
        "at rest: membrane, 50,000": lambda: inflated(50_000),
    }


def compare(name: str, make: Callable[[], Run], least: float) -> list[dict]:
    """Return the seconds of each solver, the fastest of `least` CPU seconds.

    There is a row of the table for each number in the `steps` of the run.
    """
    run = make()
    run.seconds("auto", 1.0)
    solvers = (*SOLVERS, "auto")
    best = {solver: np.full(len(run.steps), math.inf) for solver in solvers}
    begin = time.process_time()
    while math.isinf(best["auto"][-1]) or time.process_time() - begin < least:
        for solver in solvers:
            most = HOPELESS * min(seconds[-1] for seconds in best.values())
            best[solver] = np.minimum(best[solver], run.seconds(solver, most))
    rows = []
    for i, steps in enumerate(run.steps):
        at = {solver: float(seconds[i]) for solver, seconds in best.items()}
        fastest = min(SOLVERS, key=lambda solver: at[solver])
        ratio = at["auto"] / at[fastest]
        rows.append({"run": name, "steps": steps, **at, "best": fastest, "auto / best": ratio})
    return rows


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two short runs, no limits")
    parser.add_argument("--long", action="store_true", help="100 steps of the largest sheets too")
    parser.add_argument("--only", default="", help="runs whose names have this text")
    options = parser.parse_args()
    rows = []
    for name, make in runs(options.quick, options.long).items():
        if options.only in name:
            rows += compare(name, make, 0.0 if options.quick else 3.0)
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
