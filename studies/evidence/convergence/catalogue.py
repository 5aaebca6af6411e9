"""Does the uncertainty of `fc.study.converge` cover the truth? Problems with known solutions.

Membranes, plates, drums, an elastica, pressure, pendulums and waves, with every mesh pattern,
element and method at least twice. Expected: in 95 % of the problems the exact value lies within
value ± uncertainty, and the median of uncertainty over true error is at most 5.

    python -m studies.evidence.convergence.catalogue [--quick] [--jobs N]
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness
from studies.evidence.convergence.known_problems import Known, motions, statics

QUICK = ("hanging strip, cross, P1", "square drum, right, P1", "pressure, right, P2")
QUICK += ("pendulum, bdf2", "wave, central_difference", "taut square, right, P2")
ROUND_OFF = 1e-10  # relative to the value: where both are less, the result is exact


def problems() -> dict[str, Known]:
    """Return all problems by name."""
    return {f"{one.name}: {one.quantity}": one for one in (*statics(), *motions())}


def solve(problem: str) -> dict:
    """Refine one problem; return its error, uncertainty and orders."""
    known = problems()[problem]
    with open(os.devnull, "w") as nothing, contextlib.redirect_stderr(nothing):
        found = fc.study.converge(known.function, known.quantity, **known.arguments)
    error = abs(found.value - known.exact)
    exact = ROUND_OFF * abs(known.exact)
    return {
        "value": found.value,
        "exact": known.exact,
        "error": error,
        "uncertainty": found.uncertainty,
        "ratio": found.uncertainty / error if error > exact else float("nan"),
        "covered": bool(error <= max(found.uncertainty, exact)),
        "order": found.order,
        "theory": found.theory,
        "verdict": found.verdict.splitlines()[0].split(" (")[0].split(":")[0],
    }


def main() -> int:
    options = harness.parse_arguments(__doc__)
    names = [name for name in problems() if not options.quick or name.startswith(QUICK)]
    cases = [{"problem": name} for name in names]
    rows = study.run_cases(cases, solve, **harness.run_options(options), time_limit=600)
    title, what = harness.about(__doc__)
    harness.require_results(options, title, rows)
    good = [row for row in rows if row["status"] == "ok"]
    ratios = np.array([row["ratio"] for row in good])
    findings = [
        harness.Finding(
            "share of problems that are covered", np.mean([r["covered"] for r in good]), 0.95
        ),
        harness.Finding("median of uncertainty / error", float(np.nanmedian(ratios)), 1.0, 5.0),
        harness.Finding("largest uncertainty / error", float(np.nanmax(ratios))),
        harness.Finding("problems", len(good)),
    ]
    verdicts = harness.count_by(good, "covered", "verdict")
    return harness.write_report(
        options,
        title,
        rows,
        conclusion=what,
        findings=findings,
        tables={"Verdicts": verdicts},
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
