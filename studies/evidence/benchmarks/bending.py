"""What `PlateBending` costs beside `HingeBending`: force, tangents, iterations, set-up.

    python -m studies.evidence.benchmarks.bending [--quick]

On a wavy square of rows of right triangles and of Gmsh's, on one thread. Times are ratios of the
minima of several turns of both. The iterations are counted in conjugate gradients for a step of
backward Euler with StVK, to a residual of 1e-8; their matrix is the definite one.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.pcg import PCG
from studies import harness
from studies.evidence.benchmarks.measure import Measured, print_verdicts

BENDING = {"hinges": fc.HingeBending(), "plate": fc.PlateBending()}
EXACT = {"right": 2.0, "unstructured": 2.5}  # limits of the exact tangent's ratio
STEPS = (1e-3, 1e-2, 1e-1)  # s


def make_system(pattern: str, n: int, bending: str, *terms, stiffness=1e4) -> fc.System:
    """Return a square of n edges along a side, pinned along one; `stiffness` is Y h²/B."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / n, pattern)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1000.0 / stiffness / n**2)
    return fc.System(cloth, fabric, [*terms, BENDING[bending]], ["left"])


def wavy_state(system: fc.System) -> fc.State:
    """Return a state with waves along both directions that bends every hinge."""
    X, Y = system.cloth.X.T
    z = 0.03 * np.sin(9 * X + 1) * np.cos(7 * Y) + 0.02 * np.sin(5 * Y)
    return system.state(np.column_stack([1.01 * X, 1.005 * Y, z]))


def turns(calls: dict[str, Callable[[], object]], count: int) -> dict[str, float]:
    """Return the least CPU seconds of each call in several turns, after one to warm up."""
    least = dict.fromkeys(calls, np.inf)
    for turn in range(count + 1):
        for name, call in calls.items():
            begin = time.process_time()
            call()
            if turn:
                least[name] = min(least[name], time.process_time() - begin)
    return least


def kernels(pattern: str, n: int, count: int) -> list[Measured]:
    """Return the times of force and tangents over the hinges' own, the exact one for tangents."""
    forces: dict[str, Callable[[], object]] = {}
    tangents: dict[str, Callable[[], object]] = {}
    for name in BENDING:
        system = make_system(pattern, n, name)
        state, term = wavy_state(system), system.bound[0]
        at, f = (state.x, state.v, state.t), np.zeros_like(state.x)
        J = BlockMatrix.zeros(system.pattern)
        forces[f"{name} force"] = lambda term=term, at=at, f=f: term.add_force(*at, f)
        for kind, is_definite in (("exact", False), ("definite", True)):
            tangents[f"{name} {kind}"] = lambda term=term, at=at, J=J, d=is_definite: (
                term.add_tangent(*at, 1.0, 0.0, J, d)
            )
    seconds = turns(forces, 4 * count) | turns(tangents, count)
    exact, m = seconds["hinges exact"], len(system.cloth.triangles)
    for name, value in seconds.items():
        print(f"  {pattern}, {m} triangles, {name}: {1e9 * value / m:.0f} ns per triangle")
    of = f"of the hinges', {pattern}"
    return [
        Measured(f"force {of}", seconds["plate force"] / seconds["hinges force"], "ratio", 1.2),
        Measured(f"definite tangent {of} exact", seconds["plate definite"] / exact, "ratio", 1.5),
        Measured(f"exact tangent {of}", seconds["plate exact"] / exact, "ratio", EXACT[pattern]),
    ]


def iterations(pattern: str, n: int, dt: float, stiffness: float) -> Measured:
    """Return the iterations for a step with the plate over the iterations with hinges.

    `stiffness` is Y h²/B: at 100 the bending decides, at 10,000 the membrane.
    """
    counts = {}
    for name in BENDING:
        system = make_system(pattern, n, name, fc.StVK(), fc.Gravity(), stiffness=stiffness)
        state, J = wavy_state(system), BlockMatrix.zeros(system.pattern)
        system.project(system.assemble(J, state, dt**2, 0.0, 1.0, definite=True))
        solver = PCG(100_000)
        solver.prepare(J)
        b = system.constraints.project(dt**2 * system.force(state))
        counts[name] = solver.solve(b, 1e-8)[1].iterations
    case = f"{pattern} {n}, {1e3 * dt:g} ms, Y h²/B {stiffness:g}"
    words = f"iterations of the hinges' {counts['hinges']}, {case}"
    return Measured(words, counts["plate"] / counts["hinges"], "ratio", 1.1)


def set_up(pattern: str, triangles: int) -> Measured:
    """Return the CPU seconds that a system with the plate alone takes, after a smaller one."""
    h = (2 / triangles) ** 0.5 if pattern == "right" else 1.52 / triangles**0.5
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    for size in (0.1, h):
        cloth = fc.Cloth.rectangle(1.0, 1.0, size, pattern)
        begin = time.process_time()
        system = fc.System(cloth, fabric, [fc.PlateBending()], ["left"])
        seconds = time.process_time() - begin
    m = len(system.cloth.triangles)
    return Measured(f"set-up, {pattern}, {m} triangles", seconds, "s", 5.0)


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small meshes")
    quick = parser.parse_args().quick
    n, sizes, triangles = (40, (20,), 20_000) if quick else (80, (40, 80), 200_000)
    jobs = [lambda p=p: kernels(p, n, 5 if quick else 20) for p in EXACT]
    jobs += [
        lambda p=p, size=size, y=y: [iterations(p, size, dt, y) for dt in STEPS]
        for p in EXACT
        for size in sizes
        for y in (1e2, 1e4)
    ]
    jobs += [lambda p=p: [set_up(p, triangles)] for p in EXACT]
    return print_verdicts(jobs, quick)


if __name__ == "__main__":
    harness.run_main(main)
