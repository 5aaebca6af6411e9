"""Does `fc.budget` say how far a prediction may be from what is measured?

First order: the uncertainty by the numbers of six smooth cloths, beside 2,000 samples. Rough: a
strip that buckles and a strip that folds over have no first order; two probing samples must show
that. Experiments: constants are drawn, and measured with a relative uncertainty of 2 to 5 %; what
they are gives the truth, on other meshes of P2, which is measured with 1 to 3 %; what was measured
of them gives the prediction. The truth must agree with it. A wrong law is the same, with a second
membrane or a pressure that the model lacks, so large that it moves the truth by 4 × total: then
the prediction must be called wrong.

    python -m studies.budget [--quick] [--seed 2]
"""

from __future__ import annotations

import contextlib
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

import fecloth as fc
from fecloth.study.budgeting.work import Work
from studies import harness
from studies.budget.specimens import ROUGH, SMOOTH, Specimen

SAMPLES, EXPERIMENTS = 2000, 100
CLOSE, COVERED = 0.05, 0.92  # of the samples; of the experiments
WRONG = 4.0  # times the total: the error of a wrong law
QUICK = [(replace(ROUGH[0][0], h=0.5), ROUGH[0][1])]
TRUE = {"element": "P2", "pattern": "cross"}


def first_order(specimen: Specimen, samples: int) -> dict[str, Any]:
    """The uncertainty of 5 and 10 % of two numbers, by first order and by samples."""
    a, b = specimen.numbers
    given = {a: "10 %", b: "5 %"}
    first = fc.budget(specimen.open(), given, None, specimen.quantity)
    drawn = fc.budget(specimen.open(), given, None, specimen.quantity, samples=samples)
    return {
        "cloth": specimen.name, "quantity": first.quantities[0], "value": first.value,
        "input": first.input, "by samples": drawn.input, "first order": bool(first.shares.size),
        "difference %": 100 * (first.input / drawn.input - 1),
    }  # fmt: skip


def rough(specimen: Specimen, given: dict[str, Any]) -> dict[str, Any]:
    answer = fc.budget(specimen.open(), given, None, specimen.quantity)
    return {
        "cloth": specimen.name, "quantity": answer.quantities[0], "value": answer.value,
        "input": answer.input, "sampled": bool(answer.remarks) and not answer.shares.size,
    }  # fmt: skip


def truth(specimen: Specimen, numbers: dict[str, float], extra: float = 0.0) -> float:
    """The quantity on another mesh and element."""
    opened = specimen.open(**numbers, **TRUE, extra=extra)
    chosen = opened.problem.choose_quantities([specimen.quantity])
    values, lost = Work(opened, chosen).run([("truth", {})])
    assert not lost, lost
    return float(values[0, 0])


def experiment(specimen: Specimen, draw: np.random.Generator) -> dict[str, Any]:
    """Whether a prediction agrees with a true law, and is called wrong beside a wrong law."""
    names, count = list(specimen.numbers), len(specimen.numbers)
    u = dict(zip(names, draw.uniform(0.02, 0.05, count), strict=True))
    real = {n: x * draw.uniform(0.7, 1.4) for n, x in specimen.numbers.items()}
    known = {n: x * math.exp(u[n] * draw.normal()) for n, x in real.items()}
    given = {n: f"{100 * part:.12f} %" for n, part in u.items()}
    right, part = truth(specimen, real), draw.uniform(0.01, 0.03)
    noise, of = part * abs(right) * draw.normal(size=2), part * abs(right)
    name = getattr(specimen.quantity, "__name__", specimen.quantity)
    opened, asked = specimen.open(**known), specimen.quantity
    answer = fc.budget(opened, given, {name: (right + noise[0], of)}, asked)
    wrong = wrong_truth(specimen, real, right, WRONG * answer.total)
    other = fc.budget(opened, given, {name: (wrong + noise[1], of)}, asked)
    return {
        "cloth": specimen.name, "quantity": answer.quantities[0], "value": answer.value,
        "mesh": answer.space, "time": answer.time, "input": answer.input, "data": of,
        "total": answer.total, "truth": right, "agrees": bool(answer.agrees),
        "off": answer.difference / answer.total, "wrong truth": wrong,
        "called wrong": not other.agrees, "off by wrong law": other.difference / answer.total,
    }  # fmt: skip


def wrong_truth(specimen: Specimen, real: dict[str, float], right: float, shift: float) -> float:
    """The truth of a law with so much `extra` that it is off by the shift."""

    def left(extra: float) -> float:
        return abs(truth(specimen, real, extra) - right) - shift

    high = specimen.extra
    while left(high) < 0:
        high *= 2
    return truth(specimen, real, brentq(left, 0.0, high, rtol=1e-3, xtol=1e-3 * high))


def main() -> int:
    options = harness.parse_arguments(
        __doc__ or "", seed={"type": int, "default": 2, "help": "of the experiments (2)"}
    )
    quick, draw = options.quick, np.random.default_rng(options.seed)
    samples, count = (32, 1) if quick else (SAMPLES, EXPERIMENTS)
    with contextlib.redirect_stderr(io.StringIO()):  # of thousands of cases
        smooth = [first_order(each, samples) for each in SMOOTH[: 1 if quick else None]]
        sharp = [rough(*each) for each in (QUICK if quick else ROUGH)]
        trials = [experiment(SMOOTH[i % len(SMOOTH)], draw) for i in range(count)]
    furthest = max(abs(row["difference %"]) for row in smooth)
    agreed = sum(row["agrees"] for row in trials) / count
    caught = sum(row["called wrong"] for row in trials) / count
    findings = [
        harness.Finding(
            f"largest difference of the first order from {samples:,} samples, %", furthest,
            high=100 * CLOSE * (4 if quick else 1),
        ),
        harness.Finding(
            f"of {len(smooth)} smooth cloths, first order",
            sum(row["first order"] for row in smooth), len(smooth),
        ),
        harness.Finding(
            f"of {len(sharp)} cloths that buckle or fold, sampled",
            sum(row["sampled"] for row in sharp), len(sharp),
        ),
        harness.Finding(f"of {count} experiments, share that agrees", agreed, COVERED),
        harness.Finding(f"of {count} wrong laws, share that is called wrong", caught, COVERED),
    ]  # fmt: skip
    tables = {"First order": smooth, "Rough": sharp}
    page = Path(__file__).with_name("budget")
    return harness.conclude(options, __doc__, page, trials, findings, tables)


if __name__ == "__main__":
    harness.run_main(main)
