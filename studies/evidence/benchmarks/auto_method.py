"""CPU time of the method "auto" over the best of its candidates, on 100 to 3,000 triangles.

    python -m studies.evidence.benchmarks.auto_method [--only TEXT] [--quick]

Each candidate takes the whole run, with its record, at the default tolerance, on one thread; of two
repeats the faster one counts. A run that has taken `HOPELESS` times as long as the best one is
stopped. The time of "auto" is the time of the method that it chooses and of the choice. Beside the
seconds stand the errors in time that the runs state.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator

import fecloth as fc
from fecloth.simulation.resolve import resolve
from fecloth.study.result import markdown_table
from studies import harness
from studies.evidence.benchmarks.measure import square

MEAN, WORST = 1.25, 1.5  # limits of the ratio
HOPELESS = 4.0
T_END = 0.2


def system_of(kind: str, triangles: int) -> fc.System:
    """Return a sheet that is held at one edge and let go, horizontal or hanging."""
    stiffness = {"soft": 50.0, "stiff": 2e4}.get(kind, 1000.0)
    fabric = fc.Fabric(0.2, stiffness, 0.3, bending_rigidity=1e-4)
    terms: list = [fc.StVK(), fc.Gravity()]
    cloth = square(triangles)
    pins = ["left"]
    if kind == "hanging":
        terms[1] = fc.Gravity((0.0, -9.81, -1.0))
        pins = ["top"]
    if kind in ("plate", "damped plate"):
        terms.append(fc.PlateBending())
    if kind == "damped plate":
        terms.append(fc.StrainRateDamping(0.005))
    if kind == "P2":
        cloth = fc.Cloth.rectangle(1.0, 1.0, h=3.0 / math.sqrt(triangles), element="P2")
    return fc.System(cloth, fabric, terms, pins, "lumped")


def seconds_of(run: Callable[[Callable], fc.Result], most: float) -> tuple[float, float]:
    """Return the CPU seconds of a run and its error in time; infinite beyond `most` seconds."""
    begin = time.process_time()

    def watch(info: object) -> None:
        if time.process_time() - begin > most:
            raise TimeoutError

    try:
        result = run(watch)
    except TimeoutError:
        return math.inf, math.nan
    return time.process_time() - begin, result.time_error


def compare(kind: str, triangles: int, repeats: int) -> dict:
    """Return a row of the table."""
    system = system_of(kind, triangles)
    start = system.rest()
    best: dict[str, float] = {}
    errors: dict[str, float] = {}
    candidates = fc.Auto().candidates(system)
    for method in candidates:  # compiles
        fc.run(system, method, start, t_end=T_END / 200)
    choices = []
    for _ in range(repeats):
        for method in candidates:
            most = HOPELESS * min(best.values(), default=math.inf)
            name = type(method.method).__name__
            run = lambda report, m=method: fc.run(system, m, start, t_end=T_END, report=report)  # noqa: E731
            seconds, error = seconds_of(run, most)
            if seconds < best.get(name, math.inf):
                best[name], errors[name] = seconds, error
        begin = time.process_time()
        chosen, _, _ = resolve(system, fc.Auto(), start, T_END)
        choices.append(time.process_time() - begin)
    name = type(chosen.method).__name__
    taken = best.get(name, math.inf) + min(choices)
    return {
        "cloth": kind,
        "triangles": len(system.cloth.triangles),
        **{f"{key} [s]": value for key, value in best.items()},
        **{f"{key}, error": value for key, value in errors.items()},
        "choice [s]": min(choices),
        "chosen": name,
        "auto / best": taken / min(best.values()),
    }


def cases(quick: bool) -> Iterator[tuple[str, int]]:
    """Yield the kinds of cloth and the numbers of triangles."""
    if quick:
        yield "hanging", 100
        return
    for triangles in (100, 700, 3000):
        for kind in ("hanging", "falling", "soft", "stiff", "plate", "damped plate", "P2"):
            yield kind, triangles


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one short run, no limits")
    parser.add_argument("--only", default="", help="cloths whose names have this text")
    options = parser.parse_args()
    warnings.simplefilter("ignore", fc.FeclothWarning)
    rows = []
    for kind, triangles in cases(options.quick):
        if options.only in kind:
            rows.append(compare(kind, triangles, 1 if options.quick else 2))
            print(rows[-1], flush=True)
    print(markdown_table(rows), end="\n\n")
    ratios = [row["auto / best"] for row in rows]
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    findings = [
        harness.Finding("auto over the best, geometric mean", mean, high=MEAN),
        harness.Finding("auto over the best, the worst run", max(ratios), high=WORST),
    ]
    print(*findings, sep="\n")
    return 0 if options.quick or all(finding.is_met for finding in findings) else 1


if __name__ == "__main__":
    harness.run_main(main)
