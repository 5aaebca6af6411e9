"""CPU time of whole runs with each linear solver, and of "auto" over the best.

    python -m studies.evidence.benchmarks.linear_solvers

The scenes differ in character: a flag, a hanging strip and a dome (static), a swinging sheet, the
trampoline at 1 and at 4 ms, and a fine damped sheet. The solvers take turns, on one thread. The CPU
seconds are the minimum of several runs, so that they include neither compilation nor the loading of
the MKL. `full` is PARDISO (or SuperLU) with a new factor in every Newton iteration; `direct` reuses
the factor.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import fecloth as fc
from fecloth.nonlinear.statistics import Counts
from fecloth.scene.scene import load_scene
from studies import harness

SCENES = Path(__file__).parents[2] / "scenes"
SOLVERS = ("full", "direct", "superlu", "pcg", "auto")
LIMIT = 1.5  # largest ratio of auto to the best
SMALL = 1_000  # largest number of nodes for SuperLU


@dataclass(frozen=True, eq=False)
class Case:
    """A run: system, method, start, steps and options."""

    system: fc.System
    method: object
    state: fc.State
    dt: float
    t_end: float
    newton: fc.Newton

    def march(self, solver: str) -> tuple[float, Counts]:
        """Return the CPU seconds and the counts of all steps."""
        options = replace(self.newton, reuse=solver != "full")
        name = "direct" if solver == "full" else solver
        chosen, _ = fc.solver_for(self.system, self.method, self.dt, name, options)
        steps = fc.march(self.system, self.method, self.state, self.dt, self.t_end, solver=chosen)
        begin, counts = time.process_time(), Counts()
        for _, info in steps:
            counts = counts.plus(info.counts)
        return time.process_time() - begin, counts


def scene(name: str, *overrides: str) -> Case:
    """Return the run of a file in studies/scenes."""
    built = load_scene(SCENES / f"{name}.toml", overrides).build()
    return Case(built.system, built.method, built.start, built.dt, built.t_end, built.newton)


def damped_sheet(h: float, t_end: float) -> Case:
    """Return a square pinned along an edge that falls; strain-rate damping stiffens the matrix."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h)
    terms = [fc.StVK(), fc.StrainRateDamping(0.02), fc.Gravity()]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, pins=["left"])
    return Case(system, fc.ImplicitMidpoint(), system.rest(), 2e-3, t_end, fc.Newton())


def cases(quick: bool) -> dict[str, Case]:
    """Return all runs; with `quick` they end early and the sheet is coarser."""
    flag, swing, short, long = (0.05, 0.1, 0.01, 0.02) if quick else (0.6, 0.6, 0.1, 0.2)
    return {
        "flag": scene("benchmark_flag", f"time.t_end={flag}"),
        "hanging strip": scene("hanging_strip"),
        "swing": scene("swing", f"time.t_end={swing}"),
        "dome": scene("dome"),
        "trampoline, 1 ms": scene("trampoline", f"time.t_end={short}"),
        "trampoline, 4 ms": scene("trampoline", f"time.t_end={long}", "time.dt=0.004"),
        "damped sheet": damped_sheet(0.04 if quick else 0.0145, 0.04 if quick else 0.2),
    }


def fastest_runs(case: Case, repeat: int) -> dict[str, tuple[float, Counts]]:
    """Return the fastest of several runs with each solver; the solvers take turns."""
    small, best = len(case.system.cloth.X) <= SMALL, {}
    for _ in range(repeat):
        for solver in SOLVERS:
            if solver == "superlu" and not small:
                continue
            run = case.march(solver)
            best[solver] = min(best.get(solver, run), run, key=lambda run: run[0])
    return best


def table_row(name: str, case: Case, runs: dict[str, tuple[float, Counts]]) -> tuple[str, float]:
    """Return a row of the table, and the time of auto over the time of the fastest solver."""
    seconds = [f"{runs[s][0]:>8.3f}" if s in runs else f"{'':>8}" for s in SOLVERS]
    ratio = runs["auto"][0] / min(runs[s][0] for s in runs if s != "auto")
    few, many = runs["direct"][1], runs["full"][1]
    iterations = (
        f"{few.newton:>6} {many.newton:>6} {few.factorisations:>6} {many.factorisations:>6}"
    )
    columns = [f"{name:<17} {len(case.system.cloth.X):>6}", *seconds, f"{ratio:>7.2f}", iterations]
    return " ".join(columns), ratio


def main() -> None:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="shorter runs")
    options = parser.parse_args()
    heads = " ".join(f"{s:>8}" for s in SOLVERS)
    print(
        f"{'scene':<17} {'nodes':>6} {heads} auto/best   Newton direct, full; factors direct, full"
    )
    ratios = {}
    for name, case in cases(options.quick).items():
        row, ratios[name] = table_row(name, case, fastest_runs(case, 1 if options.quick else 3))
        print(row, flush=True)
    worst = max(ratios, key=ratios.get)
    verdict = "met" if ratios[worst] <= LIMIT else "MISSED"
    print(f"auto over the best: at most {ratios[worst]:.2f} ({worst}), limit {LIMIT}: {verdict}")


if __name__ == "__main__":
    harness.run_main(main)
