"""Do the 95 % intervals of a fit cover the truth? Synthetic tests whose constants are known.

Each twin is a fabric that a seed draws: tensile stiffness of warp and weft, shear stiffness,
Poisson's ratio, bending rigidity, damping and drag. Three strips in tension at 0, 45 and 90°, a
strip that hangs, one that swings in its plane and one that swings in air are computed on another
mesh and element than the fit's, in motions with a sixth of its dt. Gaussian noise of 1 to 5 % of
the largest change is added, and one fit seeks all constants, from starts off by up to 3. Drag acts
on P1 only: there only the mesh and the step differ.

    python -m studies.fit.twins [--quick] [--count 100] [--seed 1] [--jobs N]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness
from studies.fit import draws
from studies.validation.pages import quietly

COVERED = 0.9  # of the twins, for each constant by itself
NOISE = 0.01, 0.05
QUICK_TESTS = "hang", "pull 0"
QUICK_CONSTANTS = "warp", "bending"
KEYS = "truth", "half", "covered", "off", "shift"  # of a constant, for its line


def solve(seed: int, number: int, tests: list[str], constants: list[str]) -> dict[str, Any]:
    """Draw a twin, fit it, and say of each constant whether its interval covers the truth."""
    rng = np.random.default_rng([seed, number])
    truth = draws.draw_truth(rng)
    start, noise = draws.draw_start(rng, truth), draws.between(rng, *NOISE)
    known = draws.make_tests(truth, swapped=bool(number % 2))
    experiments = [known[name].experiment(truth, constants, noise, rng) for name in tests]
    begin = time.process_time()
    answer = quietly(fc.fit, experiments, {name: start[name] for name in constants})
    row = {"noise": noise, "misfit": answer.misfit, "law fails": answer.law_fails}
    row |= {"resolved": answer.resolved, "cpu": time.process_time() - begin}
    for name in constants:
        row |= _compare(name, truth[name], start[name], answer)
    return row


def _compare(name: str, truth: float, start: float, answer) -> dict[str, Any]:
    low, high = answer.intervals_of_data[name]
    half = (high - low) / 2
    return {
        f"{name}: truth": truth,
        f"{name}: start": start,
        f"{name}: value": answer.values[name],
        f"{name}: half": half,
        f"{name}: covered": bool(low <= truth <= high),
        f"{name}: off": (answer.values[name] - truth) / half,
        f"{name}: shift": answer.numerical[name] / half,
    }


def summarise(name: str, rows: list[dict]) -> dict[str, Any]:
    """The line of a constant: how often it is covered, and how wide its intervals are."""
    column = {key: np.array([row[f"{name}: {key}"] for row in rows]) for key in KEYS}
    told = np.isfinite(column["half"])
    width = np.abs(column["half"] / column["truth"])
    return {
        "constant": name,
        "twins": len(rows),
        "told": int(told.sum()),
        "covered": int(column["covered"].sum()),
        "median half interval %": 100 * float(np.nanmedian(width)),
        "median shift by mesh and step / half interval": float(
            np.nanmedian(np.abs(column["shift"]))
        ),
        "largest distance / half interval": float(np.nanmax(np.abs(column["off"]))),
    }


def main() -> int:
    more = {"count": {"type": int, "default": 100}, "seed": {"type": int, "default": 1}}
    options = harness.parse_arguments(__doc__ or "", **more)
    tests, constants = list(draws.TESTS), list(draws.CONSTANTS)
    if options.quick:
        tests, constants, options.count = list(QUICK_TESTS), list(QUICK_CONSTANTS), 2
    each = {"seed": options.seed, "tests": tests, "constants": constants}
    cases = [each | {"number": number} for number in range(options.count)]
    rows = study.run_cases(cases, solve, **harness.run_options(options), time_limit=300)
    return conclude(options, rows, constants)


def conclude(options: argparse.Namespace, rows: list[dict], constants: Sequence[str]) -> int:
    """Write the page and the report of some twins; return the exit status."""
    harness.require_results(options, harness.about(__doc__)[0], rows)
    ended = [row for row in rows if row["status"] == "ok"]
    table = [summarise(name, ended) for name in constants]
    findings = [
        harness.Finding(
            f"{line['constant']}: share of {line['twins']} twins whose interval covers the truth",
            line["covered"] / line["twins"],
            COVERED,
        )
        for line in table
    ]
    seconds = [row["cpu"] for row in ended]
    findings += [
        harness.Finding("twins whose law fails by chance", sum(row["law fails"] for row in ended)),
        harness.Finding("twins that are not resolved", sum(not row["resolved"] for row in ended)),
        harness.Finding("median CPU seconds of a fit", float(np.median(seconds))),
        harness.Finding("CPU minutes of all fits", math.fsum(seconds) / 60),
    ]
    page = Path(__file__).with_suffix("")
    return harness.conclude(options, __doc__, page, rows, findings, {"Constants": table})


if __name__ == "__main__":
    harness.run_main(main)
