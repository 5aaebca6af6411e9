"""Does a fit that begins ten times off end at the same place?

Ten fabrics with the data of `studies.fit.twins`, each fitted from the true constants, from ten
times and from a tenth of them, all constants together (Poisson's ratio from 0). The same place:
each constant within 2 % of the end of the first fit (Poisson's ratio within 0.01), or within a
tenth of half its interval, since a weak pull towards the start holds what the data do not tell.

    python -m studies.evidence.fit.starts [--quick] [--seed 5] [--jobs N]
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.errors import FeclothError
from studies import harness
from studies.fit import draws
from studies.fit.twins import NOISE, QUICK_CONSTANTS, QUICK_TESTS, fit_quietly

FABRICS, FACTOR = 10, 10.0
SAME, SAME_RATIO, OF_INTERVAL = 0.02, 0.01, 0.1
ENOUGH = 0.9


def solve(seed: int, number: int, tests: list[str], constants: list[str]) -> dict:
    """Fit one fabric from three starts and compare the ends."""
    rng = np.random.default_rng([seed, number])
    truth, noise = draws.draw_truth(rng), draws.between(rng, *NOISE)
    known = draws.make_tests(truth, swapped=False)
    experiments = [known[name].experiment(truth, constants, noise, rng) for name in tests]
    row: dict = {"noise": noise}
    ends = {}
    for name, factor in (("true", 1.0), ("up", FACTOR), ("down", 1 / FACTOR)):
        start = {key: truth[key] * factor for key in constants}
        if "poisson" in start and factor != 1.0:
            start["poisson"] = 0.0
        try:
            ends[name] = fit_quietly(experiments, start, refined=False)
        except FeclothError as error:
            row[f"{name}: cause"] = str(error).splitlines()[0]
    for name in ("up", "down"):
        apart = _apart(ends["true"], ends[name]) if name in ends else np.inf
        row |= {f"{name}: apart": apart, f"{name}: same": bool(apart < 1)}
    return row


def _apart(first: fc.Fit, other: fc.Fit) -> float:
    """The largest distance of two ends, over what is the same place."""
    distances = []
    for name, value in first.values.items():
        same = SAME_RATIO if name == "poisson" else SAME * value
        half = (first.intervals[name][1] - first.intervals[name][0]) / 2
        distances.append(abs(other.values[name] - value) / np.fmax(same, OF_INTERVAL * half))
    return float(max(distances))


def main() -> int:
    options = harness.parse_arguments(__doc__ or "", seed={"type": int, "default": 5})
    tests, constants, count = list(draws.TESTS), list(draws.CONSTANTS), FABRICS
    if options.quick:
        tests, constants, count = list(QUICK_TESTS), list(QUICK_CONSTANTS), 1
    each = {"seed": options.seed, "tests": tests, "constants": constants}
    cases = [each | {"number": number} for number in range(count)]
    rows = study.run_cases(cases, solve, **harness.run_options(options), time_limit=600)
    title, what = harness.about(__doc__)
    harness.require_results(options, title, rows)
    ended = [row for row in rows if row["status"] == "ok"]
    findings = [
        harness.Finding(
            f"share of {len(ended)} fits from {words} that end at the same place",
            sum(row[f"{name}: same"] for row in ended) / len(ended),
            ENOUGH,
        )
        for name, words in (("up", "ten times the truth"), ("down", "a tenth of it"))
    ]
    page = Path(__file__).with_suffix("")
    return harness.write_report(options, title, rows, conclusion=what, findings=findings, page=page)


if __name__ == "__main__":
    harness.run_main(main)
