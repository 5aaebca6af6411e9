"""Time and memory of meshing, binding, the first step, the first tangent and a frame.

    python -m studies.evidence.benchmarks.binding [--against COMMIT] [--quick]

A square of the pattern "right", on one thread, a process for each size. "explicit" is StVK and
gravity with a first step of central differences, "implicit" has hinges besides and a first tangent.
Seconds are CPU time. Memory is the peak above what the process had before it meshed,
for "frame" above what it had before that. With --against the sizes are also measured with the
fecloth of a commit or a folder, in turns, and the ratios are printed. Linux only, for the memory.
"""

from __future__ import annotations

import math
from pathlib import Path

from studies import harness
from studies.evidence.benchmarks.measure import Measured, print_verdicts
from studies.evidence.benchmarks.trees import OWN, Child, tree_of

SIZES, QUICK = (200_000, 2_000_000), (2_000, 20_000)
KINDS = ("explicit", "implicit")
# Runs with any version: it uses only names that all of them have.
PROGRAM = """
import ctypes, json, pathlib, sys, tempfile, time
import fecloth as fc

def memory(line):
    status = pathlib.Path("/proc/self/status").read_text()
    return 1024 * int(status.split(line + ":")[1].split()[0])

def measured(cells, bending):
    laps, before = {}, memory("VmRSS")
    def lap(name, function):
        pathlib.Path("/proc/self/clear_refs").write_text("5")  # resets VmHWM
        begin = time.process_time()
        result = function()
        laps[name] = time.process_time() - begin, memory("VmHWM") - before
        return result
    mesh = lambda: fc.Cloth.rectangle(1.0, 1.0, 1 / cells, pattern="right")
    cloth = lap("mesh", mesh)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    terms = [fc.StVK(), *bending, fc.Gravity()]
    system = lap("bind", lambda: fc.System(cloth, fabric, terms, pins=["left"]))
    state = system.rest()
    dt = 0.2 / cells * (0.2 / 1000) ** 0.5
    if bending:
        lap("tangent", lambda: system.stiffness(state))
    else:
        lap("step", lambda: list(fc.march(system, fc.CentralDifference(), state, dt, dt)))
        ctypes.CDLL(None).malloc_trim(0)  # gives back what the step has freed
        before = memory("VmRSS")
        with tempfile.TemporaryDirectory() as folder:
            lap("frame", lambda: fc.write_vtk(folder + "/frame", cloth, state, system))
    return {name: (t, size / len(cloth.triangles)) for name, (t, size) in laps.items()}

print(fc.__file__, flush=True)
cells, kind = json.loads(sys.stdin.readline())
bending = [] if kind == "explicit" else [fc.HingeBending()]
measured(10, bending)  # compiles
laps = measured(cells, bending)
print(json.dumps({f"{kind} {name}": lap for name, lap in laps.items()}))
"""


def measure(tree: Path, kind: str, triangles: int) -> dict[str, tuple[float, float]]:
    """Return the CPU seconds and bytes per triangle of each part, by the fecloth in a folder."""
    with Child(tree, PROGRAM) as child:
        return child.ask([round(math.sqrt(triangles / 2)), kind])


def compare(
    tree: Path | None, triangles: int, kinds: tuple[str, ...]
) -> dict[str, tuple[float, float]]:
    """Print what both trees take for a size; return seconds and bytes per triangle of this one."""
    ours = {}
    for kind in kinds:
        here = measure(OWN, kind, triangles)
        there = measure(tree, kind, triangles) if tree else {}
        for name, (t, size) in here.items():
            line = f"{triangles:>9,} {name:<17} {t:>7.2f} s {size / 1e3:>7.3f} kB/triangle"
            if name in there:
                other_t, other = there[name]
                line += f"   ratios {t / other_t:>5.2f}, {size / max(other, 1.0):>5.2f}"
            print(line, flush=True)
        ours |= here
    return ours


def figures(tree: Path | None, sizes: tuple[int, int], kinds: list[tuple]) -> list[Measured]:
    """Return the figures of the larger size, and the growth from the smaller one."""
    small, large = (compare(tree, *each) for each in zip(sizes, kinds, strict=True))
    start = ("explicit mesh", "explicit bind", "explicit step")
    totals = [sum(laps[name][0] for name in start) for laps in (small, large)]
    growth = math.log(totals[1] / totals[0]) / math.log(sizes[1] / sizes[0])
    most = max(large[name][1] for name in start) / 1e3
    of = f"{sizes[1]:,} triangles"
    return [
        Measured(f"mesh, binding and first explicit step of {of}", totals[1], "s", 30),
        Measured("its growth with the number n of triangles, n^", growth, "", 1.15),
        Measured("peak memory of these", most, "kB/triangle", 0.7),
        Measured("memory of a frame besides", large["explicit frame"][1] / 1e3, "kB/triangle", 0.5),
    ]


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--against", metavar="COMMIT", help="commit or folder")
    parser.add_argument("--quick", action="store_true", help="small meshes")
    options = parser.parse_args()
    sizes, kinds = (QUICK, [KINDS[:1], KINDS]) if options.quick else (SIZES, [KINDS, KINDS])
    other = tree_of(options.against) if options.against else None
    return print_verdicts([lambda: figures(other, sizes, kinds)], options.quick)


if __name__ == "__main__":
    harness.run_main(main)
