"""Cost of a step against the number of triangles, for every solver, explicit and implicit.

    python -m studies.evidence.benchmarks.step_costs [--quick] [--out FOLDER]

A square sheet, held at two corners, has fallen for 0.4 s on 8,000 triangles. Its motion is
interpolated to the other meshes and goes on there, after two steps that settle it. Implicit steps
are of backward Euler at 5 ms, explicit ones of central differences at half their largest step; both
are measured in CPU time, on one thread. The figure has two lines of what the memory allows. A
bandwidth is measured with a loop a[i] = b[i] + 2 c[i] over arrays that no cache holds. "State read
and written" is the time to move what an explicit step cannot do without: x and v twice, the masses,
and of each triangle its corners, gradients and area. "Matrix read once" is the time to read the
blocks of the tangent; conjugate gradients read it in each of their iterations.
"""

from __future__ import annotations

import time
from pathlib import Path

import numba
import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator, NearestNDInterpolator

import fecloth as fc
from fecloth import study
from fecloth.study.result import markdown_table, write_csv
from studies import harness
from studies.evidence.benchmarks.measure import square

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
DT = 5e-3
SIZES = (500, 2_000, 8_000, 50_000, 200_000, 2_000_000)
REGULAR = 500_000  # triangles from which on they are in rows: Gmsh takes minutes to place them
LARGEST = {  # triangles to which a solver is taken: beyond it a step takes minutes, or the memory
    "superlu": 8_000,
    "pcg": 200_000,
    "pardiso": 200_000,
    "multigrid": 2_000_000,
    "auto": 200_000,
}
SMALLEST = {"multigrid": 2_000}
EXPLICIT = ("explicit step", "explicit, 5 ms of motion")
ALLOWED = ("state read and written", "matrix read once")


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


def steps(system: fc.System, state: fc.State, solvers: list[str], count: int) -> dict[str, float]:
    """Return the mean CPU seconds of a step with each solver.

    The solvers take the same steps in turns, after each has taken the first of them once.
    """
    marches = {}
    for solver in solvers:
        context, _ = fc.solver_for(system, fc.BackwardEuler(), DT, solver)
        run = system, fc.BackwardEuler(), state, DT
        next(fc.march(*run, DT, solver=context))
        context.drop()
        marches[solver] = fc.march(*run, (count + 0.5) * DT, solver=context)
    seconds = dict.fromkeys(solvers, 0.0)
    for _ in range(count):
        for solver, march in marches.items():
            begin = time.process_time()
            next(march)
            seconds[solver] += (time.process_time() - begin) / count
    return seconds


@numba.njit
def triad(a, b, c):
    """Compute a = b + 2 c."""
    for i in range(len(a)):
        a[i] = b[i] + 2.0 * c[i]


def bandwidth() -> float:
    """Return the bytes a second that one thread moves."""
    a, b, c = (np.ones(8_000_000) for _ in range(3))
    return 3 * a.nbytes / harness.measure_seconds(lambda: triad(a, b, c), 7).wall


def bytes_moved(system: fc.System) -> tuple[int, int]:
    """Return the bytes of what an explicit step needs, and of the tangent."""
    cloth = system.cloth
    nodes = len(cloth.X) * (4 * 24 + 8)  # x and v, read and written; masses
    triangles = cloth.triangles.nbytes + cloth.gradients.nbytes + cloth.weights.nbytes
    return nodes + triangles, 72 * len(system.pattern.indices)  # 3 x 3 numbers a block


def explicit_step(system: fc.System, state: fc.State, work: int) -> tuple[float, float]:
    """Return the CPU seconds of a step, and its length [s]: two runs, without what both share.

    The shorter run has about `work` triangles times steps.
    """
    dt, method = 0.5 * fc.critical_dt(system, state), fc.CentralDifference()
    few = min(500, max(8, work // len(system.cloth.triangles)))

    def run(count: int) -> float:
        end = state.t + count * dt
        return harness.measure_seconds(lambda: fc.run(system, method, state, dt, end), 2).cpu

    return (run(4 * few) - run(few)) / (3 * few), dt


def costs_of(
    triangles: int, start: tuple[fc.System, fc.State], moved: float, count: int, work: int
) -> dict:
    """Return a row of the table: CPU seconds of a step by each solver."""
    is_regular = triangles >= REGULAR
    system = sheet(triangles, "right" if is_regular else "unstructured")
    state = transfer(*start, system)
    chosen = [name for name, most in LARGEST.items() if SMALLEST.get(name, 0) <= triangles <= most]
    row: dict[str, float | None] = {"triangles": len(system.cloth.triangles)}
    row |= steps(system, state, chosen, min(count, 2) if is_regular else count)
    seconds, dt = explicit_step(system, state, work)
    row |= zip(EXPLICIT, (seconds, seconds * DT / dt), strict=True)
    return row | dict(zip(ALLOWED, (size / moved for size in bytes_moved(system)), strict=True))


def draw(rows: list[dict], out: Path) -> None:
    """Draw the cost of a step against triangles."""
    series = [*LARGEST, *EXPLICIT]
    heads = "triangles", "CPU time of a step [s]", "One thread; implicit steps of 5 ms"
    with harness.figure(out, "step_costs", *heads, size=(9.0, 6.0)) as (_, ax):
        for name in series:
            points = [(row["triangles"], row[name]) for row in rows if row.get(name)]
            ax.plot(*zip(*points, strict=True), **study.line_style(series.index(name)), label=name)
        for name, dash in zip(ALLOWED, (":", "--"), strict=True):
            points = [(row["triangles"], row[name]) for row in rows]
            ax.plot(*zip(*points, strict=True), color="0.5", ls=dash, label=f"memory: {name}")
        ax.legend(ncols=2)


def main() -> int:
    options = harness.parse_arguments(__doc__)
    sizes, count, work = (SIZES, 3, 1_000_000)
    if options.quick:
        sizes, count, work = ((500, 2_000), 1, 20_000)
    start = fallen(500, 0.1) if options.quick else fallen(8_000, 0.4)
    moved, rows = bandwidth(), list[dict]()
    print(f"one thread moves {1e-9 * moved:.1f} GB/s", flush=True)
    for triangles in sizes:
        rows.append(costs_of(triangles, start, moved, count, work))
        words = ", ".join(f"{k} {v:.3g}" for k, v in rows[-1].items())
        print(words, flush=True)
    write_csv(rows, options.out / "step_costs.csv")
    draw(rows, options.out)
    print(markdown_table(rows))
    return 0


if __name__ == "__main__":
    harness.run_main(main)
