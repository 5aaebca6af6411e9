"""References on up to 2,000,000 triangles, and what the charts gain from them.

    python -m studies.evidence.distributed.references --scene trampoline
    mpiexec -n 2 python -m studies.evidence.distributed.references --scene cantilever
    mpiexec -n 2 python -m studies.evidence.distributed.references --scene table
    python -m studies.evidence.distributed.references [--quick]

The first three commands run a scene of the charts on meshes whose edges are halved from one to the
next, and keep the results in references.json; with --quick they only print them. The last one tells
how far the results are from each other and from solutions without triangles, and what a chart would
say that ends at each mesh.

The trampoline is marched explicitly, by one process. The other two are plates at rest. On 2,000,000
triangles two processes take 13 and 11 GB for one, with the factor of MUMPS on the disk:
PETSC_OPTIONS="-fecloth_mumps_mat_mumps_icntl_22 1".
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator

import fecloth as fc
from fecloth.distributed.environment import count_processes
from fecloth.distributed.launch import run_on_all
from fecloth.runs.environment import peak_memory
from studies import harness
from studies.evidence.distributed.gains import report
from studies.evidence.work_precision.bending_scenes import REST, MakeSystem
from studies.work_precision.runs import march_fused
from studies.work_precision.scenes import Scene, trampoline

FILE = Path(__file__).with_name("references.json")
STEP = 6e-3  # s/m: explicit steps over the size of the triangles
ROUND_OFF = 4e-16  # m²: times 1/h², above the relative round-off of the forces
SIZES = {  # m, of the triangles
    "trampoline": [0.0152 / 2**i for i in range(5)],
    "cantilever": [0.009728 / 2**i for i in range(7)],
    "table": [0.0096 / 2**i for i in range(6)],
}
QUICK = {
    "trampoline": [0.1, 0.05, 0.025],
    "cantilever": [0.04, 0.02, 0.01],
    "table": [0.03, 0.02],
}
Rows = list[dict]
Keep = Callable[[dict], None]


def fall(sizes: Sequence[float], keep: Keep) -> None:
    """Run the trampoline with explicit steps on each mesh."""
    for h in sizes:
        problem = trampoline("StVK", "P1", h)
        begin = time.process_time()
        (mean, centre), counts = march_fused(problem, STEP * h, problem.t_end)
        used = [{"cpu_seconds": time.process_time() - begin, "peak_memory_MB": peak_memory()}]
        row = describe("trampoline", h, problem, used) | {"steps": counts["steps"]}
        keep(row | {"mean": mean.tolist(), "point": centre.tolist()})


def rest(make_system: MakeSystem, scene: str, sizes: Sequence[float], keep: Keep) -> None:
    """Solve for the equilibrium on each mesh, from the solution on the mesh before."""
    before = None
    for h in sizes:
        problem = REST[scene]("plate", h, make_system)
        system = problem.system
        start = system.state(raise_to(problem, *before)) if before else problem.state
        begin = usage(system)
        tolerance = max(1e-9, ROUND_OFF / h**2)
        found = fc.equilibrium(system, start, solver="direct", tolerance=tolerance)
        used = [
            b | {"cpu_seconds": b["cpu_seconds"] - a["cpu_seconds"]}
            for a, b in zip(begin, usage(system), strict=True)
        ]
        mean, point = (float(value) for value in problem.values_of(found.x))
        row = describe(scene, h, problem, used) | {"newton": found.iterations}
        keep(row | {"residual": found.residual, "mean": mean, "point": point})
        before = system.cloth.X, found.x - system.rest().x


def raise_to(problem: Scene, X: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return positions with the displacements of nodes at X, interpolated smoothly.

    Linear interpolation would fold the cloth along the edges of the coarser mesh.
    """
    system, flat = problem.system, problem.system.cloth.X[:, :2]
    u = CloughTocher2DInterpolator(X[:, :2], moved, fill_value=0.0)(flat)
    x: np.ndarray = system.rest().x + system.constraints.project(u)
    return x


def usage(system: fc.System) -> Rows:
    """Return CPU seconds and peak memory of each process."""
    if system.is_whole:
        return [{"cpu_seconds": time.process_time(), "peak_memory_MB": peak_memory()}]
    return system.usage()["processes"]  # type: ignore[attr-defined,no-any-return]


def describe(scene: str, h: float, problem: Scene, used: Rows) -> dict:
    """Return the size of a case, and what its processes used."""
    return {
        "scene": scene,
        "h": h,
        "triangles": len(problem.system.cloth.triangles),
        "processes": len(used),
        "seconds": [round(one["cpu_seconds"], 2) for one in used],
        "memory_MB": [round(one["peak_memory_MB"]) for one in used],
    }


def keep_in_file(row: dict) -> None:
    """Write a row to references.json, in place of an older one of the same mesh."""
    rows = read() if FILE.exists() else []
    key = row["scene"], row["h"]
    rows = [one for one in rows if (one["scene"], one["h"]) != key] + [row]
    rows.sort(key=lambda one: (one["scene"], -one["h"]))
    FILE.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n", encoding="utf-8")
    show(row)


def show(row: dict) -> None:
    """Print a row without its paths."""
    shown = {name: value for name, value in row.items() if not isinstance(value, list)}
    print(shown, row["seconds"], row["memory_MB"], flush=True)


def read() -> Rows:
    """Return the rows of references.json."""
    rows: Rows = json.loads(FILE.read_text(encoding="utf-8"))
    return rows


def make(scene: str, sizes: Sequence[float], keep: Keep) -> int:
    """Run a scene on this process, or on all that mpiexec started."""

    def run(make_system: MakeSystem) -> int:
        rest(make_system, scene, sizes, keep)
        return 0

    if scene == "trampoline":
        fall(sizes, keep)
        return 0
    return run_on_all(run) if count_processes() > 1 else run(fc.System)


def main() -> int:
    scene = {"choices": sorted(SIZES), "help": "run it, and keep the results"}
    sizes = {"type": float, "nargs": "+", "metavar": "M", "help": "of its triangles"}
    options = harness.parse_arguments(__doc__, scene=scene, sizes=sizes)
    if options.scene:
        sizes = (QUICK if options.quick else SIZES)[options.scene]
        return make(options.scene, options.sizes or sizes, show if options.quick else keep_in_file)
    rows: Rows = []
    if options.quick:
        fall(QUICK["trampoline"], rows.append)
        rest(fc.System, "cantilever", QUICK["cantilever"], rows.append)
    return report(options, rows or read())


if __name__ == "__main__":
    harness.run_main(main)
