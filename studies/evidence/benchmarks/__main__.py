"""Cost of every part of fecloth, beside a fixed kernel and beside another commit.

    python -m studies.evidence.benchmarks [--against COMMIT] [-o FILE.json] [--quick]

The parts are the kernels of the terms, a step of a run by central differences, implicit steps with
each linear solver, binding, and a frame. Each is measured in CPU time on one thread, the minimum of
many short repeats, and divided by the time of a reference kernel of the same run: the force of StVK
in its plainest form, which never changes. So these ratios can be compared between machines and
between years; the file has them, with the commit and the machine.

--against takes a commit, or a folder that holds fecloth/. It runs in a process of its own, in turns
with this tree, so that other work on the machine disturbs little.
"""

from __future__ import annotations

import json
import math
from contextlib import ExitStack
from datetime import date
from pathlib import Path

from studies import harness
from studies.evidence.benchmarks.parts import program
from studies.evidence.benchmarks.trees import OWN, Child, git, tree_of

Times = dict[str, float]
"""CPU seconds per triangle of each part."""
REFERENCE = "reference"


def measure(trees: list[Path], cells: int, rounds: int) -> list[Times]:
    """Return the times of each tree; the trees take turns."""
    with ExitStack() as stack:
        children = [stack.enter_context(Child(tree, program(cells))) for tree in trees]
        known = [child.ask("names") for child in children]
        best: list[Times] = [dict.fromkeys(names, math.inf) for names in known]
        for turn in range(rounds):
            order = range(len(trees)) if turn % 2 else reversed(range(len(trees)))
            places = list(order)
            for name in known[0]:
                for i in places:
                    if name in best[i]:
                        best[i][name] = min(best[i][name], children[i].ask(name))
    return best


def relative(times: Times) -> Times:
    """Return each part over the reference kernel."""
    return {name: time / times[REFERENCE] for name, time in times.items()}


def record(times: Times, triangles: int) -> dict:
    """Return what the file holds."""
    return {
        "commit": git("describe", "--always", "--dirty").decode().strip(),
        "date": date.today().isoformat(),
        "machine": harness.hardware(),
        "triangles": triangles,
        "reference [ns per triangle]": round(1e9 * times[REFERENCE], 3),
        "over reference": {name: round(value, 4) for name, value in relative(times).items()},
    }


def print_table(times: Times, others: Times) -> None:
    """Print each part, and its ratio to the other tree's."""
    print(f"{'part':<26} {'ns/triangle':>11} {'/ reference':>11} {'/ other':>8}")
    ratios = {}
    for name, over in relative(times).items():
        if name in others:
            ratios[name] = times[name] / others[name]
        last = f"{ratios[name]:>8.3f}" if name in ratios else f"{'new' if others else '':>8}"
        print(f"{name:<26} {1e9 * times[name]:>11.1f} {over:>11.3f} {last}")
    gone = sorted(set(others) - set(times))
    if gone:
        print(f"only in the other: {', '.join(gone)}")
    compared = [ratio for name, ratio in ratios.items() if name != REFERENCE]
    if compared:
        print(f"ratios from {min(compared):.3f} to {max(compared):.3f}")


def main() -> None:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--against", metavar="COMMIT", help="commit or folder")
    parser.add_argument("--output", "-o", type=Path, metavar="FILE", help="where the ratios go")
    parser.add_argument("--triangles", type=int, default=8_000)
    parser.add_argument("--rounds", type=int, default=20, help="repeats of every part (20)")
    parser.add_argument("--quick", action="store_true", help="a small mesh and few repeats")
    options = parser.parse_args()
    triangles, rounds = (200, 1) if options.quick else (options.triangles, options.rounds)
    cells = round(math.sqrt(triangles / 2))
    trees = [OWN, *([tree_of(options.against)] if options.against else [])]
    times, *rest = measure(trees, cells, rounds)
    print_table(times, rest[0] if rest else {})
    found = record(times, 2 * cells**2)
    path = options.output or OWN / "out" / "benchmarks" / f"{found['commit']}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(found, indent=1) + "\n")
    print(f"the ratios are in {path.relative_to(OWN) if path.is_relative_to(OWN) else path}")


if __name__ == "__main__":
    harness.run_main(main)
