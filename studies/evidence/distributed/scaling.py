"""Cost of a time step of one large cloth on several processes.

    mpiexec -n 2 python -m studies.evidence.distributed.scaling [--triangles 200000] [--quick]

A square metre of cloth, held at its corners, falls: StVK, HingeBending, backward Euler with
dt = 5 ms, PETSc's multigrid. Prints the work and the CPU seconds of each process for each step.
"""

from __future__ import annotations

import time

import numpy as np

import fecloth as fc
from fecloth.distributed.launch import MakeSystem, run_on_all
from studies import harness

FABRIC = fc.Fabric(
    areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3, bending_rigidity=1e-5
)
DT = 5e-3


def measure(make_system: MakeSystem, triangles: int, steps: int, solver: str) -> int:
    """March, and print a line for each step."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, np.sqrt(2 / triangles), pattern="right")
    terms, pins = [fc.StVK(), fc.HingeBending(), fc.Gravity()], ["corners"]
    system = make_system(cloth, FABRIC, terms, pins)
    bound = system.usage()["processes"]
    print(f"{len(cloth.triangles)} triangles, {len(bound)} processes", flush=True)
    print("binding: CPU s", *(f"{one['cpu_seconds']:.1f}" for one in bound), flush=True)
    newton = fc.Newton(tolerance=1e-6)
    march = fc.march(
        *(system, fc.BackwardEuler(), system.rest(), DT, steps * DT), solver=solver, newton=newton
    )
    begin, last = time.perf_counter(), bound
    for _, info in march:
        used = system.usage()["processes"]
        cpu = [b["cpu_seconds"] - a["cpu_seconds"] for a, b in zip(last, used, strict=True)]
        counts, now = info.counts, time.perf_counter()
        print(
            f"step {info.step}: Newton {counts.newton}, CG {counts.linear}, "
            f"CPU s {' '.join(f'{s:.2f}' for s in cpu)}, wall {now - begin:.2f} s, "
            f"assemble {counts.seconds['assemble']:.2f}, factor {counts.seconds['factor']:.2f}, "
            f"solve {counts.seconds['solve']:.2f}; "
            f"peak MB {' '.join(str(round(one['peak_memory_MB'])) for one in used)}, "
            f"ghosts {max(one['ghosts'] / one['nodes'] for one in used):.3f}",
            flush=True,
        )
        begin, last = time.perf_counter(), used
    return 0


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="2,000 triangles and one step")
    parser.add_argument("--triangles", type=int, default=200_000)
    parser.add_argument("--steps", type=int, default=2)
    parser.add_argument("--solver", default="multigrid")
    options = parser.parse_args()
    size = (2_000, 1) if options.quick else (options.triangles, options.steps)
    chosen = *size, options.solver
    return run_on_all(lambda make_system: measure(make_system, *chosen))


if __name__ == "__main__":
    harness.run_main(main)
