"""CPU time and error of implicit steps at 1/60 s on nine sheets, over another tree's.

    python -m studies.evidence.benchmarks.newton_sheets COMMIT [--quick]

COMMIT may also be a folder that holds `fecloth/`. A sheet of 1 m × 1 m and 4,000
triangles, of a knit, a denim or a stiff cotton, falls from rest in a horizontal plane, held at two
corners, for half a second: by backward Euler, BDF2 and generalised-α, with the default options of
Newton's iteration. A process for each tree uses public names only and one thread; the trees take
turns. Of each tree the cheapest linear solver of `SOLVERS` counts.

The reference is by central differences at a quarter of their largest step, on the same mesh: errors
are errors in time, as a root mean square over the nodes at ten times. "Apart" is the distance of
the two trees, relative to the error. It says how much of the error is Newton's, as long as both
crumple alike; the other tree's linear solvers are up to 0.16 apart.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from fecloth.study.result import markdown_table
from studies import harness
from studies.evidence.benchmarks.trees import OWN, Child, tree_of

FABRICS = ("interlock", "denim-wang", "cotton")
METHODS = ("BackwardEuler", "BDF2", "GeneralizedAlpha")
SOLVERS = ("pcg", "auto", "direct")
REFERENCE = "CentralDifference"
MEAN, WORST, ERROR = 0.6, 0.8, 1.1  # limits of the ratios of CPU time and of errors
# Runs with either tree: it uses only names that all versions have.
PROGRAM = """
import json, sys, time, warnings
import numpy as np
import fecloth as fc

warnings.simplefilter("ignore")
print(fc.__file__, flush=True)
for line in sys.stdin:
    fabric, method, solver, h, steps, path = json.loads(line)
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h)
    cotton = fc.Fabric(0.15, (3000.0, 1500.0), 0.2, 60.0, 1e-5)
    chosen = cotton if fabric == "cotton" else fc.Fabric.preset(fabric)
    corners = fc.Pin(lambda X: (X[:, 1] > 1 - 1e-9) & (abs(X[:, 0] - 0.5) > 0.5 - 1e-9))
    system = fc.System(cloth, chosen, [fc.StVK(), fc.HingeBending(), fc.Gravity()], [corners])
    start, integrator, shorter = system.rest(), getattr(fc, method)(), 1
    options = {} if solver == "none" else {"solver": solver}
    if solver == "none":
        _, info = next(fc.march(system, integrator, start, None, 1.0))
        shorter = int(4 / 60 / info.dt) + 1
    dt, every = 1 / 60 / shorter, steps // 10 * shorter
    next(fc.march(system, integrator, start, dt, dt, **options))  # compiles
    found, newton, modified, begin = [], 0, 0, time.process_time()
    for state, info in fc.march(system, integrator, start, dt, steps / 60, **options):
        newton, modified = newton + info.counts.newton, modified + info.counts.modified
        if info.step % every == 0:
            found.append(state.x)
    seconds = time.process_time() - begin
    np.save(path, np.array(found))
    counts = {"seconds": seconds, "newton": newton / steps, "modified": modified / steps}
    print(json.dumps(counts | {"triangles": len(cloth.triangles)}), flush=True)
"""


class Tree:
    """A process that runs sheets with the fecloth of a folder."""

    def __init__(self, folder: Path, scratch: Path, h: float, steps: int):
        self.scratch, self.h, self.steps = scratch, h, steps
        self.child = Child(folder, PROGRAM)

    def run(self, fabric: str, method: str, solver: str) -> dict:
        """Return CPU seconds, counts a step and positions (times, n, 3) of a sheet."""
        path = self.scratch / "positions.npy"
        counts = self.child.ask([fabric, method, solver, self.h, self.steps, str(path)])
        return counts | {"x": np.load(path), "solver": solver}


def rms(x: np.ndarray) -> float:
    """Return the root mean square over times and nodes of vectors (times, n, 3)."""
    return math.sqrt((x**2).sum(axis=2).mean())


def compare(trees: tuple[Tree, Tree], fabric: str, method: str, reference: np.ndarray) -> dict:
    """Return a row of the table: this tree against the other one."""
    runs: list[list[dict]] = [[], []]
    for turn, solver in enumerate(SOLVERS):
        for i in (0, 1) if turn % 2 else (1, 0):
            runs[i].append(trees[i].run(fabric, method, solver))
    ours, theirs = (min(each, key=lambda run: run["seconds"]) for each in runs)
    error, before = (rms(run["x"] - reference) for run in (ours, theirs))
    same = next(run for run in runs[1] if run["solver"] == ours["solver"])
    return {
        "fabric": fabric,
        "method": method,
        "the other tree": f"{theirs['seconds']:.2f} s, {theirs['solver']}",
        "this tree": f"{ours['seconds']:.2f} s, {ours['solver']}",
        "ratio": ours["seconds"] / theirs["seconds"],
        "iterations": f"{theirs['newton']:.1f} → {ours['newton']:.1f}",
        "modified tangents": f"{theirs['modified']:.1f} → {ours['modified']:.1f}",
        "error [mm]": 1e3 * error,
        "error, ratio": error / before,
        "apart": rms(ours["x"] - same["x"]) / rms(same["x"] - reference),
    }


def run_all(other: Path, fabrics: tuple[str, ...], h: float, steps: int) -> list[dict]:
    """Return the rows of all sheets."""
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        ours, theirs = (Tree(folder, Path(scratch), h, steps) for folder in (OWN, other))
        with ours.child, theirs.child:
            for fabric in fabrics:
                reference = ours.run(fabric, REFERENCE, "none")["x"]
                rows += [compare((ours, theirs), fabric, method, reference) for method in METHODS]
    return rows


def verdicts(rows: list[dict]) -> list[harness.Finding]:
    """Return the figures that are required."""
    ratios = [row["ratio"] for row in rows]
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    return [
        harness.Finding("CPU time, geometric mean", mean, high=MEAN),
        harness.Finding("CPU time, the worst sheet", max(ratios), high=WORST),
        harness.Finding(
            "error, the worst sheet", max(row["error, ratio"] for row in rows), high=ERROR
        ),
    ]


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("tree", metavar="COMMIT", help="commit or folder of the other fecloth")
    parser.add_argument("--quick", action="store_true", help="one small sheet, ten steps")
    options = parser.parse_args()
    sizes = (FABRICS[:1], 0.1, 10) if options.quick else (FABRICS, 0.0245, 30)
    rows = run_all(tree_of(options.tree), *sizes)
    print(markdown_table(rows), end="\n\n")
    findings = verdicts(rows)
    print(*findings, sep="\n")
    return 0 if options.quick or all(finding.is_met for finding in findings) else 1


if __name__ == "__main__":
    harness.run_main(main)
