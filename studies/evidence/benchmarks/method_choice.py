"""The choice of `Auto`, and its CPU time over the time of the fastest option.

    python -m studies.evidence.benchmarks.method_choice

Six scenes of different character run at one tolerance, on one thread, with `Auto`, with `Adaptive`
central differences, and with the implicit methods and either kind of linear solver. The CPU seconds
are the minimum of several runs, without compilation. The seconds of Auto include the time of its
choice, which is also printed alone. A run stops (–) when it takes more than three times the best so
far. The numbers in brackets are the errors of the last positions over the tolerance: the rms
distance from a run with a twentieth of the tolerance, over rtol R t.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth.scene.scene import load_scene
from fecloth.simulation.resolve import choose_steps, resolve
from studies import harness

SCENES = Path(__file__).parents[2] / "scenes"
RTOL = 1e-2  # 1/s
TIGHTER = 20
LIMIT = 1.5  # largest ratio of auto to the best
PATIENCE = 3.0  # times the best time; then a run stops
QUICK = ("trampoline", "dome")
METHODS = {"GenAlpha": fc.GeneralizedAlpha, "Midpoint": fc.ImplicitMidpoint, "BDF2": fc.BDF2}
OPTIONS = {"explicit": (fc.CentralDifference, "auto")} | {
    f"{name} {solver}": (method, solver)
    for name, method in METHODS.items()
    for solver in ("pcg", "direct")
}


@dataclass(frozen=True, eq=False)
class Case:
    """A run: system, start, end and options."""

    system: fc.System
    state: fc.State
    t_end: float
    newton: fc.Newton | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """CPU seconds of a run, and the state at its end (None if it was stopped)."""

    seconds: float
    choosing: float = 0.0
    steps: int = 0
    rejected: int = 0
    chosen: str = ""
    state: fc.State | None = None


def run_case(case: Case, method, solver: str = "auto", most: float = math.inf) -> Run:
    """Run one case, including the choice of the method; stop after `most` seconds."""
    begin, count, rejected = time.process_time(), 0, 0
    run = case.system, choose_steps(method, None), case.state, case.t_end
    method, chosen, why = resolve(*run, solver, case.newton)
    choosing, last = time.process_time() - begin, None
    steps = fc.march(case.system, method, case.state, None, case.t_end, solver=chosen)
    for state, info in steps:
        count, rejected = count + 1, rejected + info.counts.rejected
        if time.process_time() - begin > most:
            return Run(math.inf)
        last = state
    name = type(method.method).__name__ if hasattr(method, "method") else why
    return Run(time.process_time() - begin, choosing, count, rejected, name, last)


# --- the scenes -----------------------------------------------------------------------------------

FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)


def from_file(name: str, t_end: float, *overrides: str) -> Case:
    """Return the run of a file in studies/scenes."""
    built = load_scene(SCENES / f"{name}.toml", overrides).build()
    return Case(built.system, built.start, t_end, built.newton)


def stiff_strip(t_end: float, h: float) -> Case:
    """Return a strip as stiff as a tarpaulin, pinned at its top, which swings after a push."""
    cloth = fc.Cloth.rectangle(0.2, 1.0, h=h)
    terms = [fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(2e-3), fc.Gravity((0, -9.81, 0))]
    fabric = fc.Fabric(0.5, tensile_stiffness=1e5, poisson_ratio=0.2, bending_rigidity=1e-3)
    system = fc.System(cloth, fabric, terms, pins=["top"])
    y = cloth.X[:, 1] - cloth.X[:, 1].max()
    push = np.zeros((len(y), 3))
    push[:, 2] = -y
    return Case(system, system.state(system.rest().x, push), t_end)


def bending_swing(t_end: float, h: float) -> Case:
    """Return a falling sheet of paper pinned along an edge: bending waves outrun the fall."""
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=h)
    fabric = fc.Fabric(0.08, tensile_stiffness=2000.0, poisson_ratio=0.3, bending_rigidity=1e-4)
    terms = [fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(5e-3), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, pins=["left"])
    return Case(system, system.rest(), t_end)


def dome(t_end: float, h: float) -> Case:
    """Return a clamped disk that pressure inflates during the run; it stays in motion."""
    cloth = fc.Cloth.disk(0.5, h=h)
    terms = [fc.StVK(), fc.Pressure(f"100 * min(t / {t_end}, 1)")]
    system = fc.System(cloth, FABRIC, terms, pins=["boundary"])
    return Case(system, system.rest(), t_end)


def slow_pull(t_end: float, h: float) -> Case:
    """Return a sheet pulled by a tenth and back, slowly compared with its waves: nearly static.

    The run ends within a period. After a whole period even steps that miss the motion are right.
    """
    rate = 2 * np.pi  # rad/s

    def motion(t):
        return np.array([0.025 * (1 - np.cos(rate * t)), 0.0, 0.0])

    def velocity(t):
        return np.array([0.025 * rate * np.sin(rate * t), 0.0, 0.0])

    cloth = fc.Cloth.rectangle(0.5, 0.5, h=h)
    pins = [fc.Pin("left"), fc.Pin("right", motion, velocity)]
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.StrainRateDamping(0.02)], pins)
    return Case(system, system.rest(), t_end)


def cases(quick: bool) -> dict[str, Callable[[], Case]]:
    """Return all runs; with `quick` only some of them, which end early, on coarser meshes."""
    h, t = (2.0, 0.2) if quick else (1.0, 1.0)
    every = {
        "trampoline": lambda: from_file("trampoline", 0.2 * t, f"cloth.h={0.02 * h}"),
        "damped flag": lambda: from_file("benchmark_flag", 0.4 * t, f"cloth.h={0.05 * h}"),
        "stiff strip": lambda: stiff_strip(0.5 * t, 0.02 * h),
        "swing, bending": lambda: bending_swing(0.3 * t, 0.01 * h),
        "dome": lambda: dome(0.3 * t, 0.025 * h),
        "slow pull": lambda: slow_pull(1.75 * t, 0.02 * h),
    }
    return {name: every[name] for name in QUICK} if quick else every


# --- the measurement ------------------------------------------------------------------------------


def fastest_runs(case: Case, repeat: int) -> dict[str, Run]:
    """Return the fastest of several runs of each option and of Auto, after a short warm-up."""
    best, warm = {}, Case(case.system, case.state, 1e-3 * case.t_end, case.newton)
    for method, solver in OPTIONS.values():
        run_case(warm, fc.Adaptive(method(), RTOL), solver)
    options = {name: (fc.Adaptive(m(), RTOL), s) for name, (m, s) in OPTIONS.items()}
    for _ in range(repeat):
        for name, (method, solver) in ({"auto": (fc.Auto(RTOL), "auto")} | options).items():
            least = min((run.seconds for run in best.values()), default=math.inf)
            if best.get(name) and math.isinf(best[name].seconds):
                continue  # it was too slow before
            run = run_case(case, method, solver, math.inf if name == "auto" else PATIENCE * least)
            best[name] = min(best.get(name, run), run, key=lambda run: run.seconds)
    return best


def reference(case: Case, runs: dict[str, Run]) -> fc.State:
    """Return the end of a run of the fastest option with a smaller tolerance."""
    name = min((n for n in runs if n != "auto"), key=lambda n: runs[n].seconds)
    method, solver = OPTIONS[name]
    return run_case(case, fc.Adaptive(method(), RTOL / TIGHTER), solver).state


def relative_error(case: Case, run: Run, exact: fc.State) -> float:
    """Return the error of the last positions over the tolerance."""
    if run.state is None:
        return math.nan
    mass = case.system.nodal_mass / case.system.nodal_mass.sum()

    def rms(y):
        return math.sqrt(mass @ (y**2).sum(axis=1))

    allowed = RTOL * rms(exact.x - mass @ exact.x) * (case.t_end - case.state.t)
    return rms(run.state.x - exact.x) / allowed


def report(name: str, case: Case, runs: dict[str, Run]) -> float:
    """Print a scene's options; return the time of auto over the time of the fastest."""
    exact, auto = reference(case, runs), runs["auto"]
    print(f"{name}, {len(case.system.cloth.X)} nodes, {case.t_end:g} s")
    for option, run in runs.items():
        text = f"{run.seconds:8.3f} s {run.steps:6} steps {run.rejected:4} rejected"
        error = f"  [{relative_error(case, run, exact):.2f}]"
        print(f"  {option:<16}" + (f"{text}{error}" if run.state else "       –"))
    ratio = auto.seconds / min(run.seconds for n, run in runs.items() if n != "auto")
    print(f"  auto took {auto.chosen}, {auto.choosing:.3f} s to choose: {ratio:.2f} of the best")
    return ratio


def main() -> None:
    parser = harness.Parser(description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="few short runs: the choice takes a larger part"
    )
    parser.add_argument("--only", help="run only the scene of this name")
    options = parser.parse_args()
    ratios = {}
    for name, make in cases(options.quick).items():
        if options.only in (None, name):
            case = make()
            ratios[name] = report(name, case, fastest_runs(case, 1 if options.quick else 3))
    worst = max(ratios, key=ratios.get)
    verdict = "met" if ratios[worst] <= LIMIT else "MISSED"
    print(f"auto over the best: at most {ratios[worst]:.2f} ({worst}), limit {LIMIT}: {verdict}")


if __name__ == "__main__":
    harness.run_main(main)
