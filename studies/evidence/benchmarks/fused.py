"""Cost of explicit steps without Python between them, and of whole runs of them.

    python -m studies.evidence.benchmarks.fused [--against COMMIT] [--quick]

The first table has the CPU time of a fused step of central differences over the summed CPU time of
its terms' forces, each in a compiled loop of its own, without any call from Python. The second has
the CPU time of a whole `fc.run`, with energies, probes and estimates of error, for each of its
steps; with --against, over the same in that commit or folder. The earlier tree records every step,
so that few steps tell its cost.
"""

from __future__ import annotations

import time
from pathlib import Path

import numba
import numpy as np

import fecloth as fc
from fecloth.compiled.calls import call, join
from fecloth.integrators.fused_forces import compiled_force
from fecloth.integrators.fused_steps import FusedSteps
from studies import harness
from studies.evidence.benchmarks.measure import Measured, fastest, print_verdicts
from studies.evidence.benchmarks.trees import OWN, Child, tree_of

LISTS = {
    "StVK": "[fc.StVK(), fc.Gravity()]",
    "StVK, damped": "[fc.StVK(), fc.StrainRateDamping(1e-5), fc.Gravity()]",
    "NeoHookean, MassDamping": "[fc.NeoHookean(), fc.MassDamping(1.0), fc.Gravity()]",
    "Springs": "[fc.Springs(), fc.Gravity()]",
    "StVK, hinges": "[fc.StVK(), fc.HingeBending(), fc.Gravity()]",
    "StVK, hinges, wind": "[fc.StVK(), fc.HingeBending(), fc.Wind((3.0, 0, 1), normal=0.3)]",
    "StVK, plate, damped": "[fc.StVK(), fc.PlateBending(), fc.BendingDamping(1e-4), fc.Gravity()]",
}
LIMIT, RUN_LIMIT = 1.15, 0.5
# Runs with either tree: it uses only names that all versions have. Prints CPU seconds a step.
PROGRAM = """
import json, sys, time, warnings
import numpy as np
import fecloth as fc

warnings.simplefilter("ignore")
print(fc.__file__, flush=True)
h, terms, steps, repeats = json.loads(sys.stdin.readline())
cloth = fc.Cloth.rectangle(1.0, 1.0, h=h, pattern="right")
fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
system = fc.System(cloth, fabric, eval(terms), pins=["left"])
start, method = system.rest(), fc.CentralDifference()
dt = 0.5 * fc.critical_dt(system, start)
fc.run(system, method, start, dt, 8 * dt)
seconds = []
for _ in range(repeats):
    begin = time.process_time()
    fc.run(system, method, start, dt, steps * dt)
    seconds.append(time.process_time() - begin)
print(json.dumps(min(seconds) / steps))
"""


@numba.njit
def repeat(address, steps):
    """Make the joined calls at an address `steps` times."""
    for _ in range(steps):
        call(address)


def system_of(h: float, terms: str) -> fc.System:
    """Return the square sheet with the terms, held along an edge."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h, pattern="right")
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    return fc.System(cloth, fabric, eval(terms, {"fc": fc}), pins=["left"])


def step_over_forces(h: float, name: str, work: int) -> Measured:
    """Return the ratio for a list of terms; `work` is the number of triangles times steps."""
    system = system_of(h, LISTS[name])
    x = system.rest().x + 1e-4 * np.random.default_rng(0).normal(size=(len(system.cloth.X), 3))
    dt, v, f = 1e-7, np.zeros_like(x), np.zeros_like(x)
    steps = max(8, work // len(system.cloth.triangles))
    first = fc.CentralDifference().step(system, system.state(x), dt)
    fused, times, sizes = FusedSteps.bind(system), dt * np.arange(1, steps + 2), np.full(steps, dt)
    given = first.state, first.memory, times, sizes, (0, 64), 0.0, np.inf
    clock = time.thread_time
    whole = fastest(lambda: fused.take(*given), 15, clock)
    parts = [join(compiled_force(term, x, v, f)) for term in system.bound]
    forces = sum(fastest(lambda p=p: repeat(p.address, steps), 15, clock) for p in parts)
    what = f"{name}, {len(system.cloth.triangles)}: {1e6 * forces / steps:.3g} us, step / forces"
    return Measured(what, whole / forces, "ratio", LIMIT)


def run_over_before(
    h: float, name: str, steps: int, few: int, before: Path | None
) -> list[Measured]:
    """Return the ratio of whole runs to the same runs of the tree before."""
    now = seconds_of(OWN, h, name, steps, 1)
    size = 2 * round(1 / h) ** 2
    print(f"run, {name}, {size} triangles, {steps} steps: {1e6 * now:.4g} us a step", flush=True)
    if before is None:
        return []
    then = seconds_of(before, h, name, few, 3)
    what = f"run, {name}, {size}: now / before ({1e6 * then:.4g} us)"
    return [Measured(what, now / then, "ratio", RUN_LIMIT)]


def seconds_of(tree: Path, h: float, name: str, steps: int, repeats: int) -> float:
    """Return CPU seconds a step of runs in another process, with the `fecloth` of a tree."""
    with Child(tree, PROGRAM) as child:
        return child.ask([h, LISTS[name], steps, repeats])


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few terms, small meshes")
    parser.add_argument("--against", metavar="COMMIT", help="commit or folder")
    options = parser.parse_args()
    sides, names, work = ((0.1, 0.03125, 0.01), list(LISTS), 400_000)
    runs = [(0.1, 20_000, 500), (0.03125, 20_000, 300), (0.01, 20_000, 60)]
    if options.quick:
        sides, names, work, runs = (0.1,), list(LISTS)[:1], 50_000, [(0.1, 2500, 100)]
    jobs = [
        lambda h=h, name=name: [step_over_forces(h, name, work)] for h in sides for name in names
    ]
    other = tree_of(options.against) if options.against else None
    jobs += [
        lambda run=run, name=name: run_over_before(run[0], name, *run[1:], other)
        for run in runs
        for name in names[:2]
    ]
    return print_verdicts(jobs, options.quick)


if __name__ == "__main__":
    harness.run_main(main)
