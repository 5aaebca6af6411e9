"""Is the estimated error in space the true one?

The estimate of `fc.space_error` over the true error, both in the norm of the energy, on problems
whose strain or curvature is known, on five patterns of meshes of 8 to 32 node spacings along the
side. It must lie between 0.5 and 2. Without an estimate the true error must be above a third. Only
an arc of constant curvature may be wrong, where the true error is below 3 %: it is as smooth as the
solution, so that the estimate misses it.

    python -m studies.convergence.space_error [--quick]
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import fecloth as fc
from studies import harness
from studies.convergence.space_error_cases import PROBLEMS
from studies.convergence.true_error import true_error

PATTERNS = ("right", "cross", "equilateral", "unstructured", "jittered")
ALLOWED = (0.5, 2.0)
COARSE = 1 / 3
UNSEEN = 0.03  # of constant stress: the error is small, and as smooth as the solution


def measure(problem: str, pattern: str, n: int, element: str) -> dict:
    """Return the true relative error and the effectivity; NaN without an estimate."""
    try:
        solved = PROBLEMS[problem](pattern, n, element)
    except fc.EquilibriumFailed:
        return {"true": math.nan, "effectivity": math.nan}
    system, state = solved.system, solved.state
    strained = [term for term in system.bound if term.recovers_strain]
    stored = sum(term.energy(state.x, state.t) for term in strained)
    true = math.sqrt(true_error(solved) / stored)
    return {"true": true, "effectivity": fc.space_error(system, state).relative / true}


def list_rows(sizes, patterns) -> Iterator[dict]:
    """Yield a row for each problem, element, pattern and number of node spacings."""
    for problem, element, pattern, n in product(PROBLEMS, ("P1", "P2"), patterns, sizes):
        if problem != "clamped_disc" or pattern == "unstructured":
            row = {"problem": problem, "element": element, "pattern": pattern, "n": n}
            yield row | measure(problem, pattern, n, element)


def is_met(row: dict) -> bool:
    """Return whether the estimate is near the true error, or is missing on a coarse mesh."""
    if row["problem"] == "arc" and row["true"] < UNSEEN:
        return True
    if math.isnan(row["effectivity"]):
        return not row["true"] < COARSE
    return ALLOWED[0] < row["effectivity"] < ALLOWED[1]


def summary(rows: list[dict], n: int) -> list[dict]:
    """Return the spread over the patterns: of the true error on one mesh, of all estimates."""
    lines = []
    for problem, element in dict.fromkeys((row["problem"], row["element"]) for row in rows):
        own = [row for row in rows if (row["problem"], row["element"]) == (problem, element)]
        true = [100 * row["true"] for row in own if row["n"] == n and not math.isnan(row["true"])]
        told = [row["effectivity"] for row in own if not math.isnan(row["effectivity"])]
        line = {"problem": problem, "element": element}
        line[f"true error %, n = {n}"] = f"{min(true):.2g} … {max(true):.2g}"
        lines.append(line | {"estimate / true error": f"{min(told):.2f} … {max(told):.2f}"})
    return lines


def main() -> int:
    options = harness.parse_arguments(__doc__)
    sizes, patterns = ((8,), ("unstructured",)) if options.quick else ((8, 16, 32), PATTERNS)
    rows = list(list_rows(sizes, patterns))
    counted = [row for row in rows if row["problem"] != "arc"]
    told = [row["effectivity"] for row in counted if not math.isnan(row["effectivity"])]
    missed = sum(not is_met(row) for row in rows)
    title, what = harness.about(__doc__)
    findings = [
        harness.Finding(f"of {len(counted)} errors, without the arc, estimated", len(told)),
        harness.Finding("least estimate over the true error", min(told)),
        harness.Finding("largest estimate over the true error", max(told)),
        harness.Finding(f"outside {ALLOWED[0]} … {ALLOWED[1]}", missed, high=0),
    ]
    return harness.write_report(
        options,
        title,
        rows,
        conclusion=what,
        findings=findings,
        tables={"Over all patterns": summary(rows, sizes[-1])},
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
