"""Implicit steps with multigrid, PARDISO and conjugate gradients on fine meshes.

    python -m studies.evidence.benchmarks.multigrid

A square sheet, held at two corners, has fallen for 0.4 s on 8,000 triangles. Its motion is
interpolated to finer meshes and goes on there, with backward Euler at 5 ms. Two steps settle what
the interpolation has disturbed. Then the solvers take the same steps in turns, on one thread, after
each has taken the first of them once to compile and to analyse the pattern. Compared are the mean
CPU seconds of a step, its growth between the meshes, and the memory that the solver allocates.
"""

from __future__ import annotations

import math
import time
import tracemalloc
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator, NearestNDInterpolator

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.multigrid import Multigrid
from fecloth.nonlinear.statistics import Counts
from studies import harness
from studies.evidence.benchmarks.measure import Measured, print_verdicts, square

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
DT = 5e-3
STEPS = 4
LARGEST = {"multigrid": math.inf, "pardiso": 200_000, "pcg": 50_000}  # triangles


@dataclass(frozen=True)
class Cost:
    """CPU seconds of a step, the mean of several, and their counts."""

    seconds: float
    counts: Counts


def sheet(triangles: int, pattern: str = "unstructured", fabric: fc.Fabric = FABRIC) -> fc.System:
    """Return a square of about that many triangles that hangs at two corners."""
    cloth = square(triangles, pattern)
    corners = [int(np.argmin(np.linalg.norm(cloth.X - c, axis=1))) for c in ((0, 1), (1, 1))]
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity()]
    return fc.System(cloth, fabric, terms, [fc.Pin(corners)])


def fallen(triangles: int, t_end: float) -> tuple[fc.System, fc.State]:
    """Return a sheet and its state after a fall."""
    system = sheet(triangles)
    *_, (state, _) = fc.march(system, fc.BackwardEuler(), system.rest(), DT, t_end)
    return system, state


def transfer(coarse: fc.System, state: fc.State, fine: fc.System) -> fc.State:
    """Interpolate a state with continuous first derivatives; two steps settle it."""
    points, places = coarse.cloth.X, fine.cloth.X
    arrays = []
    for values in (state.x, state.v):
        array = CloughTocher2DInterpolator(points, values)(places)
        outside = np.isnan(array).any(axis=1)  # by round-off, on the boundary
        array[outside] = NearestNDInterpolator(points, values)(places[outside])
        arrays.append(array)
    start = fine.state(*arrays)
    *_, (settled, _) = fc.march(fine, fc.BackwardEuler(), start, DT, 2 * DT, solver="multigrid")
    return fine.state(settled.x, settled.v)


def steps(system: fc.System, state: fc.State, solvers: list[str], count: int) -> dict[str, Cost]:
    """Take steps with each solver in turns, after the first one has been taken once to warm up."""
    marches = {}
    for solver in solvers:
        context, _ = fc.solver_for(system, fc.BackwardEuler(), DT, solver)
        run = system, fc.BackwardEuler(), state, DT
        next(fc.march(*run, DT, solver=context))
        context.drop()
        marches[solver] = fc.march(*run, (count + 0.5) * DT, solver=context)
    seconds, counts = dict.fromkeys(solvers, 0.0), dict.fromkeys(solvers, Counts())
    for _ in range(count):
        for solver, march in marches.items():
            begin = time.process_time()
            _, info = next(march)
            seconds[solver] += (time.process_time() - begin) / count
            counts[solver] = counts[solver].plus(info.counts)
    return {solver: Cost(seconds[solver], counts[solver]) for solver in solvers}


def memory(system: fc.System, state: fc.State) -> float:
    """Return the peak [kB per triangle] of what multigrid allocates for a matrix, without it."""
    A = BlockMatrix.zeros(system.pattern)
    system.project(system.assemble(A, state, wx=DT, wa=1 / DT, definite=True))
    solver = Multigrid()
    solver.begin(DT, 1 / DT, state.x)
    tracemalloc.start()
    solver.prepare(A)
    solver.solve(system.constraints.project(system.force(state)), rtol=0.01)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return 1e-3 * peak / len(system.cloth.triangles)


def compare(
    sizes: list[int], count: int, start: tuple[fc.System, fc.State], pattern: str
) -> list[Measured]:
    """Print a table of all meshes and solvers; return the figures with limits."""
    costs: list[dict[str, Cost]] = []
    print(f"{'triangles':>9} {'solver':<10} {'CPU s/step':>10} {'Newton':>7} {'linear':>7}")
    for triangles in sizes:
        system = sheet(triangles, pattern)
        state = transfer(*start, system)
        costs.append(steps(system, state, [s for s in LARGEST if triangles <= LARGEST[s]], count))
        for name, cost in costs[-1].items():
            newton, linear = cost.counts.newton / count, cost.counts.linear / count
            row = f"{cost.seconds:>10.3f} {newton:>7.1f} {linear:>7.1f}"
            print(f"{len(system.cloth.triangles):>9} {name:<10} {row}", flush=True)
    both = [(n, each) for n, each in zip(sizes, costs, strict=True) if "pardiso" in each]
    size, last = both[-1]
    ratio = last["multigrid"].seconds / last["pardiso"].seconds
    growth = costs[-1]["multigrid"].seconds / costs[0]["multigrid"].seconds
    exponent = math.log(growth) / math.log(sizes[-1] / sizes[0])
    return [
        Measured(f"a step, multigrid / PARDISO, {size} triangles", ratio, "ratio", 0.6),
        Measured(f"growth of a step, {sizes[0]} to {sizes[-1]}", exponent, "exponent", 1.15),
        Measured(f"memory of multigrid, {sizes[-1]}", memory(system, state), "kB/triangle", 2.5),
    ]


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small meshes, no limits")
    parser.add_argument("--sizes", type=int, nargs="+", default=[50_000, 200_000], metavar="N")
    parser.add_argument("--pattern", default="unstructured", help="of the triangles")
    options = parser.parse_args()
    sizes, count = ([2_000, 8_000], 2) if options.quick else (options.sizes, STEPS)
    start = fallen(500, 0.1) if options.quick else fallen(8_000, 0.4)
    return print_verdicts([lambda: compare(sizes, count, start, options.pattern)], options.quick)


if __name__ == "__main__":
    harness.run_main(main)
