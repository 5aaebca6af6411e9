"""What several threads gain: each loop and whole steps, on one thread and on all.

    python -m studies.evidence.benchmarks.threads [--only TEXT] [--quick]

Prints a table in Markdown for 50,000 triangles (`threads.md` has one), and the load of the machine
before and after. One thread, all and "auto", the default of `System`, which measures both, take
turns, and the fastest of many rounds counts, as other work on the machine can only delay. The last
column is the median over the rounds of "auto" over the better of both, which is the one with the
lesser median: calls of one round meet about the same other work. The copy of a long array shows
what the memory allows.
"""

from __future__ import annotations

import os
import sys

if "numba" not in sys.modules:  # before fecloth.study, which allows one thread only
    os.environ["NUMBA_NUM_THREADS"] = str(len(os.sched_getaffinity(0)))

import time
import warnings
from collections.abc import Callable, Iterator

import numba
import numpy as np

import fecloth as fc
from fecloth.integrators.explicit import LastForce
from fecloth.integrators.fused_loops import copy
from fecloth.integrators.fused_steps import FusedSteps
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.multigrid import Multigrid
from fecloth.linalg.pcg import PCG
from fecloth.terms.loops.shared_loop import SharedLoop
from studies import harness

ALL = max(2, numba.config.NUMBA_NUM_THREADS)
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
Call = Callable[[], object]
P1 = {
    "StVK": fc.StVK(),
    "BaraffWitkin": fc.BaraffWitkin(),
    "StrainRateDamping": fc.StrainRateDamping(0.01),
    "PlateBending": fc.PlateBending(),
    "HingeBending": fc.HingeBending(),
    "Springs": fc.Springs(),
    "Drag": fc.Drag(0.1),
}
P2 = {"StVK on P2": fc.StVK(), "PlateBending on P2": fc.PlateBending()}
ELASTIC = [fc.StVK(), fc.PlateBending(), fc.Gravity()]


def cloth_of(triangles: int, element: str = "P1") -> fc.Cloth:
    h = np.sqrt(2 / triangles)
    return fc.Cloth.rectangle(1.0, 1.0, h, pattern="right", element=element)


def stretched(system: fc.System) -> fc.State:
    """2 % of stretch in both directions, and a wave."""
    x = 1.02 * system.rest().x
    x[:, 2] = 0.02 * np.sin(3 * x[:, 0])
    return system.state(x)


def take_turns(calls: list[Call], rounds: int) -> np.ndarray:
    """Seconds (rounds, calls) of each call in each round."""
    times = [[] for _ in calls]
    for turn in range(rounds + 2):
        for call, seconds in zip(calls, times, strict=True):
            begin = time.perf_counter()
            call()
            if turn > 1:  # the first two set up
                seconds.append(time.perf_counter() - begin)
    return np.array(times).T


# --- what is measured: name → a function of the number of threads that makes the call -------------


def term_calls(cloth: fc.Cloth, terms: dict) -> Iterator[tuple[str, Callable[[object], Call]]]:
    """Yield the force and the tangent of each term."""
    for name, term in terms.items():

        def force(threads, term=term) -> Call:
            system = fc.System(cloth, FABRIC, [term], threads=threads)
            (bound,), at = system.bound, stretched(system)
            f = np.zeros_like(at.x)
            return lambda: bound.add_force(at.x, at.v, 0.0, f)

        def tangent(threads, term=term) -> Call:
            system = fc.System(cloth, FABRIC, [term], threads=threads)
            (bound,), at = system.bound, stretched(system)
            J = BlockMatrix.zeros(system.pattern, system.team)
            return lambda: bound.add_tangent(at.x, at.v, 0.0, 1.0, 1.0, J, True)

        yield f"{name}, force", force
        yield f"{name}, tangent", tangent


def memory(cloth: fc.Cloth) -> Callable[[object], Call]:
    """A copy of an array as long as the matrix of 50,000 triangles, ten times."""

    def make(threads) -> Call:
        team = fc.System(cloth, FABRIC, [], threads=threads).team
        a, b = np.ones((2, 250 * len(cloth.X), 3))
        loop = SharedLoop(team, np.arange(len(a))[:, None])
        return lambda: loop.each(lambda part: (copy, (a[part], b[part])))

    return make


def linear(cloth: fc.Cloth, kind: type[PCG], again: bool = False) -> Callable[[object], Call]:
    """The solve of an implicit step with dt = 5 ms to 1 %; or the preparation of its matrix."""

    def make(threads) -> Call:
        system = fc.System(cloth, FABRIC, ELASTIC, ["left"], threads=threads)
        J, at = BlockMatrix.zeros(system.pattern, system.team), stretched(system)
        system.project(system.assemble(J, at, 1.0, 0.0, 1 / 5e-3**2, True))
        b, solver = system.force(system.rest()), kind()

        def prepare() -> None:
            solver.drop()
            solver.begin(1.0, 1.0, at.x)
            solver.prepare(J)

        prepare()
        return prepare if again else lambda: solver.solve(b, 1e-2)

    return make


def explicit(cloth: fc.Cloth, terms: list, steps: int) -> Callable[[object], Call]:
    """Steps of central differences without Python between them."""

    def make(threads) -> Call:
        system = fc.System(cloth, FABRIC, terms, ["left"], threads=threads)
        fused, start, dt = FusedSteps.bind(system), system.rest(), 1e-6
        last = LastForce(np.zeros_like(start.x), start)
        times = dt * np.arange(steps + 1)
        limits = (0, 64), 0.0, 20.0
        return lambda: fused.take(start, last, times, np.full(steps, dt), *limits)

    return make


def implicit(cloth: fc.Cloth, solver: str) -> Callable[[object], Call]:
    """Steps of backward Euler after its release, with dt = 2 ms."""

    def make(threads) -> Call:
        system = fc.System(cloth, FABRIC, ELASTIC, ["left"], threads=threads)
        run = system, fc.BackwardEuler(), system.rest(), 2e-3, 10.0
        march = fc.march(*run, solver=solver, newton=fc.Newton(tolerance=1e-3))
        return lambda: next(march)

    return make


def rows(triangles: int, rounds: int, few: bool, only: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name and the milliseconds (rounds, 3) with one thread, all, and "auto"."""
    cloth, quadratic = cloth_of(triangles), cloth_of(triangles // 4, "P2")
    steps = 32
    loops = [
        ("copy of a long array", memory(cloth), 1),
        ("PCG, a solve at dt = 5 ms", linear(cloth, PCG), 1),
        ("multigrid, a solve at dt = 5 ms", linear(cloth, Multigrid), 1),
        ("explicit step, StVK", explicit(cloth, [fc.StVK(), fc.Gravity()], steps), steps),
        ("explicit step, StVK and PlateBending", explicit(cloth, ELASTIC, steps), steps),
        ("multigrid, coarse matrices", linear(cloth, Multigrid, again=True), 1),
        ("implicit step by PCG", implicit(cloth, "pcg"), 1),
        ("implicit step by multigrid", implicit(cloth, "multigrid"), 1),
        *((name, make, 1) for name, make in term_calls(cloth, P1)),
        *((name, make, 1) for name, make in term_calls(quadratic, P2)),
    ]
    for name, make, units in loops[:5] if few else loops:
        if only not in name:
            continue
        calls = [make(threads) for threads in (1, ALL, "auto")]
        yield name, 1e3 / units * take_turns(calls, rounds)


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    cores = len(os.sched_getaffinity(0))
    parser.add_argument("--only", default="", metavar="TEXT", help="rows with this in their name")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    triangles, rounds = (2000, 3) if options.quick else (50_000, 9)
    print(f"load {os.getloadavg()[0]:.1f} on {cores} cores\n")
    print(f"| | one thread [ms] | {ALL} threads [ms] | one / {ALL} | auto [ms] | auto / better |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for name, times in rows(triangles, rounds, options.quick, options.only):
        one, on_all, auto = times.min(axis=0)
        better = np.median(times[:, :2], axis=0).argmin()
        ratio = np.median(times[:, 2] / times[:, better])
        ratios = f"{one / on_all:.2f} | {auto:.3g} | {ratio:.2f}"
        print(f"| {name} | {one:.3g} | {on_all:.3g} | {ratios} |", flush=True)
    print(f"\nload {os.getloadavg()[0]:.1f}")
    return 0


if __name__ == "__main__":
    harness.run_main(main)
