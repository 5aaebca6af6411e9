"""Does a fit name what its data do not tell? Twenty tests that leave a constant open.

Ten kinds of tests, each with two drawn fabrics: tension leaves the bending rigidity open, a strip
at rest the damping and the drag, force at several angles without a width the shear stiffness apart
from Poisson's ratio, one direction the other one, motions and shapes under weight the density apart
from what resists it. The data come from another mesh with 1 to 5 % of noise. Expected of each: what
is left open is not in `identified`, has no interval and is named in the verdict, and all other
constants are told; their intervals cover the truth as in `studies.fit.twins`.

    python -m studies.evidence.fit.untold [--quick] [--seed 3] [--jobs N]
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fecloth import study
from studies import harness
from studies.fit import draws
from studies.fit.measuring import Test
from studies.fit.specimens import DENSITY, hang_with_more, pull_with_more
from studies.fit.twins import COVERED, NOISE, fit_quietly

DRAWS = 2  # fabrics of each kind
QUICK = "a strip at rest tells no drag"


@dataclass(frozen=True)
class Kind:
    """Tests, the constants that a fit seeks in them, and the constants that they do not tell."""

    tests: Callable[[dict[str, float]], list[Test]]
    told: tuple[str, ...]
    untold: tuple[str, ...]


def sliding(angle: int, width: bool = False, *more: str) -> Test:
    """A strip whose clamps hold it along its pull only, so that force tells nothing of width."""
    test = draws.pull(angle, swapped=False)
    columns = test.columns if width else {"reaction.right.x": "reaction:right.x"}
    constants = (*test.constants, *more)
    return replace(test, specimen=pull_with_more, columns=columns, constants=constants)


def at_rest(truth: dict[str, float], *more: str) -> Test:
    """A strip that hangs, with other constants."""
    test = draws.hang(truth, swapped=False)
    mesh = {"h": 1 / 12, "pattern": "right"} | draws.P1  # drag acts on P1 only
    fit_mesh = mesh if "drag" in more else test.fit_mesh
    constants = ("bending", *more)
    return replace(test, specimen=hang_with_more, constants=constants, fit_mesh=fit_mesh)


def moving(truth: dict[str, float], *more: str) -> Test:
    test = draws.bounce(truth)
    return replace(test, constants=(*test.constants, *more))


KINDS = {
    "tension tells no bending": Kind(
        lambda truth: [sliding(0, True, "bending")], ("warp", "poisson"), ("bending",)
    ),
    "tension at three angles without width": Kind(
        lambda truth: [sliding(angle) for angle in draws.ANGLES],
        ("warp", "weft"),
        ("shear", "poisson"),
    ),
    "a strip at rest tells no damping": Kind(
        lambda truth: [sliding(0, False, "damping")], ("warp",), ("damping",)
    ),
    "warp only": Kind(lambda truth: [sliding(0)], ("warp",), ("weft",)),
    "warp and its width only": Kind(
        lambda truth: [sliding(0, True)], ("warp", "poisson"), ("shear",)
    ),
    QUICK: Kind(lambda truth: [at_rest(truth, "drag")], ("bending",), ("drag",)),
    "weight and bending": Kind(
        lambda truth: [at_rest(truth, "density")], (), ("bending", "density")
    ),
    "a strip along the warp tells no bending of the weft": Kind(
        lambda truth: [at_rest(truth, "across")], ("bending",), ("across",)
    ),
    "a motion tells stiffness over density": Kind(
        lambda truth: [moving(truth, "density")], ("damping",), ("warp", "density")
    ),
    "45° only": Kind(lambda truth: [sliding(45)], (), ("warp", "weft", "shear", "poisson")),
}


def solve(seed: int, kind: str, number: int) -> dict:
    """Draw a fabric, fit it, and say what the fit says of what is left open."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), number])
    truth = draws.draw_truth(rng) | {"density": DENSITY}
    truth |= {"across": truth["bending"]}
    start, noise = draws.draw_start(rng, truth), draws.between(rng, *NOISE)
    names = (*KINDS[kind].told, *KINDS[kind].untold)
    experiments = [test.experiment(truth, names, noise, rng) for test in KINDS[kind].tests(truth)]
    answer = fit_quietly(experiments, {name: start[name] for name in names})
    missed, verdict = KINDS[kind].untold, answer.verdict
    sentence = " ".join(line for line in verdict.splitlines() if "do not tell" in line)
    named = all(
        name not in answer.identified and math.isnan(answer.intervals[name][0]) and name in sentence
        for name in missed
    )
    covered = [
        bool(answer.intervals[name][0] <= truth[name] <= answer.intervals[name][1])
        for name in KINDS[kind].told
    ]
    told = [name in answer.identified for name in KINDS[kind].told]
    return {
        "noise": noise,
        "left open": ", ".join(missed),
        "named, without interval": named,
        "told": f"{sum(told)} of {len(told)}",
        "covered": f"{sum(covered)} of {len(covered)}",
        "verdict": sentence,
        "counts": [sum(told), sum(covered), len(covered)],
    }


def main() -> int:
    options = harness.parse_arguments(__doc__ or "", seed={"type": int, "default": 3})
    kinds, count = ([QUICK], 1) if options.quick else (list(KINDS), DRAWS)
    cases = [
        {"seed": options.seed, "kind": kind, "number": i} for kind in kinds for i in range(count)
    ]
    rows = study.run_cases(cases, solve, **harness.run_options(options), time_limit=300)
    title, what = harness.about(__doc__)
    harness.require_results(options, title, rows)
    ended = [row for row in rows if row["status"] == "ok"]
    told, covered, all_told = np.sum([row["counts"] for row in ended], axis=0)
    findings = [
        harness.Finding(
            f"of {len(rows)} cases, what is left open is named and has no interval",
            sum(row["named, without interval"] for row in ended),
            len(rows),
        ),
        harness.Finding(f"of {all_told} other constants, told", int(told), all_told),
        harness.Finding("share of these whose interval covers the truth", covered / told, COVERED),
    ]
    page = Path(__file__).with_suffix("")
    return harness.write_report(options, title, rows, conclusion=what, findings=findings, page=page)


if __name__ == "__main__":
    harness.run_main(main)
