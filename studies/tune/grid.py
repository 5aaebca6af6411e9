"""The cheapest setting of a scene that meets a tolerance, by an exhaustive search in order of cost.

    python -m studies.tune.grid [--names NAME …] [--longest SECONDS]

makes all twelve, in some 20 CPU minutes, and writes the best few of each into grid.json.

Element, method, h and dt vary; h in steps of √2 and dt in steps of 2, or rtol in steps of 4 where
a method chooses its own steps. Each combination of element and method is a lattice of (h, dt) that
begins so coarse that it costs nothing. The search always runs the cheapest of the settings that are
left, and ends where all of these cost more than the cheapest one that meets the tolerance. On a
rectangle the best combinations run on the other patterns, too.

Runs above `--longest` are not tried: with the seconds of a tuned run, all cheaper settings are.
Two rules save runs and change no result. Where half of dt changed the error by less than a
twentieth, and it is above twice the tolerance, shorter steps cannot help; the same for h.
"""

from __future__ import annotations

import contextlib
import heapq
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import count, product
from pathlib import Path

from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.study.change import Level
from fecloth.study.problems import SceneProblem
from fecloth.study.run_problems import Point, Runs, run_points
from fecloth.study.status import LATE, OK, REFUSED
from fecloth.study.workload import Workload
from studies import harness
from studies.tune.references import Reference, fingerprint, quantities_of, read
from studies.tune.scenes import TWELVE, Tried

FILE = Path(__file__).with_name("grid.json")

METHODS = (
    "backward_euler",
    "bdf2",
    "implicit_midpoint",
    "generalized_alpha",
    "central_difference",
    "auto",
)
ELEMENTS = ("P1", "P2")
PATTERNS = ("right", "cross", "equilateral", "unstructured")
FIRST_STEPS = 4  # of the coarsest dt over the run
FIRST_RTOL = 0.1  # 1/s
FIRST_RUN = 0.01  # s, as the cost of the coarsest of all
GROWTH = 1.6  # of the cost from one level to the next, less than the usual 2
UNCHANGED = 0.05  # of an error
BEST = 3  # combinations that also run on the other patterns
LONGEST = 30.0  # s
KEPT = 4  # the cheapest that meet the tolerance: their seconds are measured again, with care


@dataclass(frozen=True)
class Combination:
    """What a lattice of h and dt has in common."""

    element: str
    method: str
    pattern: str = ""

    @property
    def words(self) -> str:
        return " ".join(word for word in (self.element, self.method, self.pattern) if word)


@dataclass(frozen=True)
class Node:
    """A setting: h and dt of the combination, i and j levels finer."""

    combination: Combination
    i: int = 0
    j: int = 0


@dataclass(frozen=True, eq=False)
class Found:
    """What a setting cost and reached: the error is the largest over its tolerance's quantities."""

    node: Node
    problem: SceneProblem | None
    status: str
    seconds: float
    error: float


def search(tried: Tried, reference: Reference, runs: Runs, longest: float = LONGEST) -> list[Found]:
    """Return all settings that ran; none is expected to take more than `longest` [s]."""
    first = tried.scene()
    own = getattr(first.cloth, "pattern", "")
    methods = ("equilibrium",) if first.equilibrium else METHODS
    combinations = [Combination(e, m, own) for e, m in product(ELEMENTS, methods)]
    measure = _measure(tried, reference, replace(runs, time_limit=LONGEST))
    done = list(_in_order_of_cost(tried, combinations, measure, longest))
    if own:
        ranked = sorted(_good(tried, done), key=lambda one: one.seconds)
        best = list(dict.fromkeys(one.node.combination for one in ranked))[:BEST]
        others = [replace(c, pattern=p) for c, p in product(best, PATTERNS) if p != own]
        limit = min([longest, *(one.seconds for one in ranked[:1])])
        done += _in_order_of_cost(tried, others, measure, limit)
    return done


def _good(tried: Tried, done: list[Found]) -> list[Found]:
    return [one for one in done if one.error <= tried.tolerance]


def best_of(tried: Tried, done: list[Found]) -> list[Node]:
    """Return the cheapest few settings that meet the tolerance."""
    return [one.node for one in sorted(_good(tried, done), key=lambda one: one.seconds)[:KEPT]]


def _in_order_of_cost(
    tried: Tried,
    combinations: list[Combination],
    measure: Callable[[Node], Found],
    most_seconds: float,
) -> Iterator[Found]:
    """Run settings from the cheapest on, until one that meets the tolerance is cheaper than all."""
    number = count()  # ties in the order in which they came
    queue = [(FIRST_RUN, next(number), Node(one)) for one in combinations]
    done: dict[Node, Found] = {}
    limit = most_seconds
    while queue:
        cost, _, node = heapq.heappop(queue)
        if node in done or cost > limit:
            continue
        found = done[node] = measure(node)
        yield found
        if found.error <= tried.tolerance:
            limit = min(limit, found.seconds)
        spent = max(found.seconds if found.status == OK else cost, FIRST_RUN)
        for child in _finer(tried, node, done):
            heapq.heappush(queue, (GROWTH * spent, next(number), child))


def _finer(tried: Tried, node: Node, done: dict[Node, Found]) -> Iterator[Node]:
    """Yield the next setting in h, and the next in dt, where they can help."""
    found = done[node]
    if found.status == LATE:  # finer ones take longer
        return
    fixed = node.combination.method in ("central_difference", "equilibrium")
    for parent, child in (
        (replace(node, i=node.i - 1), replace(node, i=node.i + 1)),
        (replace(node, j=node.j - 1), replace(node, j=node.j + 1)),
    ):
        before = done.get(parent)
        if child.j > node.j and fixed:
            continue
        if found.status == REFUSED and (before is None or before.status == REFUSED) and node.i > 1:
            continue
        near = found.error <= 2 * tried.tolerance or math.isinf(found.error)
        if near or before is None or abs(found.error - before.error) > UNCHANGED * found.error:
            yield child


def _measure(tried: Tried, reference: Reference, runs: Runs) -> Callable[[Node], Found]:
    """Return the function that runs a setting."""

    def measure(node: Node) -> Found:
        try:
            problem = problem_of(tried, node)
            problem.first  # noqa: B018  # builds it: an unsuitable element is refused here
        except InputError:
            return Found(node, None, REFUSED, 0.0, math.inf)
        return run_setting(tried, reference, problem, node, runs)

    return measure


def run_setting(
    tried: Tried, reference: Reference, problem: SceneProblem, node: Node, runs: Runs
) -> Found:
    """Run one setting and compare it with the reference."""
    words = f"{tried.name}, {node.combination.words}, {node.i}, {node.j}"
    point = Point(problem, Level(), words, Workload(1, 1))
    with open(os.devnull, "w") as nothing, contextlib.redirect_stderr(nothing):
        (row,) = run_points([point], quantities_of(tried), runs)
    error = max(reference.errors(problem, row).values())
    return Found(node, problem, str(row["status"]), row.get("cpu_seconds", 0.0), error)


def measure_best(
    tried: Tried, reference: Reference, runs: Runs, nodes: Sequence[Node]
) -> Found | None:
    """Measure settings again, as in a chart; return the cheapest that meets the tolerance."""
    again = [
        run_setting(tried, reference, problem_of(tried, node), node, replace(runs, timed=True))
        for node in nodes
    ]
    return min(_good(tried, again), key=lambda one: one.seconds, default=None)


def problem_of(tried: Tried, node: Node) -> SceneProblem:
    """Return the scene with a setting."""
    one, first = node.combination, tried.scene()
    changes: dict[str, object] = {
        "cloth.element": one.element,
        "cloth.h": _coarsest(first) / 2 ** (node.i / 2),
        "mass": "lumped" if one.element == "P1" or one.method == "central_difference" else None,
    }
    if one.pattern:
        changes["cloth.pattern"] = one.pattern
    if not first.equilibrium:
        span = first.time.t_end - first.time.t_start
        steps = {"time.dt": "auto"}
        if one.method == "auto":
            steps["time.rtol"] = FIRST_RTOL / 4**node.j
        elif one.method != "central_difference":
            steps["time.dt"] = span / (FIRST_STEPS * 2**node.j)
        none = {"time.rtol": None, "time.atol": None, "time.longest": None}
        changes |= {"time.method": one.method, **none, **steps}
    return SceneProblem(tried.scene(changes), tried.name)


def _coarsest(scene) -> float:
    """Return a quarter of the size of the cloth, or its height or width if less."""
    cloth = scene.cloth
    if cloth.shape == "rectangle":
        return min(cloth.width, cloth.height, max(cloth.width, cloth.height) / 4)
    return math.sqrt(scene.mesh().area) / 4


# --- storing --------------------------------------------------------------------------------------


def read_best(tried: Tried) -> list[Node]:
    """Return the stored best settings of a scene.

    Raises
    ------
    InputError
        If there are none, or they belong to an earlier form of the scene.
    """
    found = _file().get(tried.name)
    if found is None or found["scene"] != fingerprint(tried):
        remedy = f"Run python -m studies.tune.grid --names {tried.name}"
        allowed = "is missing or belongs to another scene"
        raise InputError(f"the grid of {tried.name}", allowed, FILE.name, remedy)
    return [Node(Combination(*names), i, j) for names, i, j in found["best"]]


def _file() -> dict:
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def _stored(tried: Tried, done: list[Found]) -> Mapping:
    """Return the best settings, how many ran, and the CPU seconds of all."""
    spent = round(sum(one.seconds for one in done), 1)
    best = [astuple(node) for node in best_of(tried, done)]
    return {"scene": fingerprint(tried), "ran": len(done), "seconds": spent, "best": best}


def main() -> int:
    names = {"nargs": "*", "default": [], "metavar": "NAME", "help": "scenes; all by default"}
    longest = {"type": float, "default": LONGEST, "metavar": "SECONDS", "help": "of a run"}
    options = harness.parse_arguments(__doc__, names=names, longest=longest)
    runs = Runs(options.out, fresh=options.fresh, most_seconds=None)
    for tried in TWELVE:
        if not tried.has_limit or (options.names and tried.name not in options.names):
            continue
        done = search(tried, read(tried), runs, options.longest)
        known = _file() | {tried.name: _stored(tried, done)}
        lines = ",\n".join(f'"{name}": {json.dumps(one)}' for name, one in known.items())
        replace_file(FILE, ("{\n" + lines + "\n}\n").encode())
        print(f"{tried.name}: {known[tried.name]}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(harness.run_main(main))
