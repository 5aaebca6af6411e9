"""Time of each kernel in this tree over that in another tree, such as an earlier commit.

    python -m studies.benchmarks.compare_trees PATH [--quick]

PATH is a folder that holds `fecloth/`. A process for each tree measures force and tangent of one
term after the other. The trees take turns in many short repeats, and the minimum of each counts, so
that other work on the machine disturbs little. A ratio of 1 means that nothing has changed.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import fecloth
from fecloth import study
from fecloth.errors import InputError

TERMS = {
    "StVK": "fc.StVK()",
    "TensionField": "fc.TensionField()",
    "NeoHookean": "fc.NeoHookean()",
    "Springs": "fc.Springs()",
    "HingeBending": "fc.HingeBending()",
    "BaraffWitkin": "fc.BaraffWitkin()",
}
# Runs with either tree: it uses only names that all versions have.
CHILD = """
import sys, time
import numpy as np
import fecloth as fc
try:
    from fecloth.linalg.block_matrix import BlockMatrix
except ImportError:
    from fecloth.blocks import BlockMatrix

cloth = fc.Cloth.rectangle(1.0, 1.0, h=1.52 / np.sqrt({triangles}))
fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
X, m = cloth.X, len(cloth.triangles)
x = np.column_stack([1.02 * X, 0.02 * np.sin(3 * X[:, 0])])
v, f = np.zeros_like(x), np.zeros_like(x)
calls = {{}}
for name, term in {{{terms}}}.items():
    system = fc.System(cloth, fabric, [term])
    J, bound = BlockMatrix.zeros(system.pattern), system.bound[0]
    calls[name + " force"] = lambda bound=bound: bound.add_force(x, v, 0.0, f)
    calls[name + " tangent"] = lambda bound=bound, J=J: bound.add_tangent(
        x, v, 0.0, 1.0, 0.0, J, False
    )
for call in calls.values():
    call()
print(fc.__file__, flush=True)
for line in sys.stdin:
    call, best = calls[line.strip()], 1e9
    for _ in range(5):
        begin = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - begin)
    print(1e9 * best / m, flush=True)
"""


def start(tree: Path, names: list[str], triangles: int) -> subprocess.Popen:
    """Start the process that measures a tree; raise `InputError` if it uses another tree."""
    terms = ", ".join(f"{name!r}: {made}" for name, made in TERMS.items() if name in names)
    command = [sys.executable, "-c", CHILD.format(triangles=triangles, terms=terms)]
    environment = os.environ | {"PYTHONPATH": str(tree)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=tree, env=environment, **pipes)
    file = process.stdout.readline().strip()
    if not file or not Path(file).is_relative_to(tree):
        process.kill()
        raise InputError(f"PATH = {tree}", "must be a folder with a fecloth that can be imported")
    return process


def measure(process: subprocess.Popen, name: str) -> float:
    """Return ns per triangle of a term's force or tangent, the minimum of a few calls."""
    process.stdin.write(f"{name}\n")
    process.stdin.flush()
    return float(process.stdout.readline())


def compare(
    other: Path, terms: list[str], triangles: int, rounds: int
) -> dict[str, tuple[float, float]]:
    """Return ns per triangle of each kernel in this tree and in the other one."""
    trees = (Path(fecloth.__file__).resolve().parents[1], other.resolve())
    processes = [start(tree, terms, triangles) for tree in trees]
    names = [f"{term} {part}" for term in terms for part in ("force", "tangent")]
    best = {name: [math.inf, math.inf] for name in names}
    for turn in range(rounds):
        for name in names:
            for i in (0, 1) if turn % 2 else (1, 0):
                best[name][i] = min(best[name][i], measure(processes[i], name))
    for process in processes:
        process.stdin.close()
        process.wait()
    return {name: (ours, theirs) for name, (ours, theirs) in best.items()}


def main() -> None:
    parser = study.Parser(description=__doc__)
    parser.add_argument("tree", type=Path, metavar="PATH", help="folder of the other fecloth")
    parser.add_argument("--terms", nargs="+", choices=TERMS, default=list(TERMS), metavar="TERM")
    parser.add_argument("--triangles", type=int, default=8_000)
    parser.add_argument("--rounds", type=int, default=60, help="repeats of every kernel (60)")
    parser.add_argument("--quick", action="store_true", help="few repeats")
    options = parser.parse_args()
    rounds = 5 if options.quick else options.rounds
    times = compare(options.tree, options.terms, options.triangles, rounds)
    print(f"{'kernel':<22} {'this tree':>10} {'the other':>10} {'ratio':>7}   ns per triangle")
    for name, (ours, theirs) in times.items():
        print(f"{name:<22} {ours:>10.1f} {theirs:>10.1f} {ours / theirs:>7.3f}")
    ratios = [ours / theirs for ours, theirs in times.values()]
    print(f"ratios from {min(ratios):.3f} to {max(ratios):.3f}")


if __name__ == "__main__":
    study.run_main(main)
