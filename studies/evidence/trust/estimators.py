"""Which estimate of the error in time? Candidates beside the truth, and what they cost.

A set-up of `drawn.py` runs once, and again with halved steps until two successive refinements
agree within 2 %. Each candidate estimates the largest rms error of x over the run, from the same
run:

- field: the drift of the method, carried along with the motion by the linear equations about it
  (`SampledError`);
- sum: the same drift in each step, in its absolute value, added up without being carried;
- double: a second run with double steps (explicit methods: half steps), `Companion`;
- half: a second run with half steps.

An estimate is multiplied by a factor of safety. Two shares are counted: the share of set-ups in
which the product is at least the true error, and the share in which it is at most 5 times the true
error. The factor is chosen on one seed so that the smaller of both shares is largest, and judged
on another seed. The cost is the CPU time that is added
to the run, over that of the run, in the median: these set-ups are tiny, and large runs add less.

    python -m studies.evidence.trust.estimators
        [--quick] [--seed 11] [--judge 12] [--count 60] [--jobs N] [--out DIR]
"""

from __future__ import annotations

import math
import time
import warnings
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.errors import FeclothError
from fecloth.integrators.protocol import drift_of
from fecloth.linalg.reductions import rms
from fecloth.simulation.rigid_motion import derivative
from fecloth.simulation.time_error import TimeError
from studies import harness
from studies.evidence.trust.cases import AGREE, frame_times, march_through
from studies.evidence.trust.drawn import draw
from studies.evidence.trust.random_setups import JUDGED, errors_of, refined
from studies.evidence.trust.setups import Run

CANDIDATES = ("field", "sum", "double", "half")
FACTOR = 5.0
SAFETIES = np.arange(1.0, 8.0, 0.05)
MOST, QUICK_MOST = 800, 300
QUICK_COUNT = 2


def judge(seed: int, number: int, most: int) -> dict:
    """Return the true error in time of a drawn set-up, and the estimates, all in metres."""
    drawn = draw(seed, number)
    run = drawn.build()
    times = frame_times(run)
    result, x = march_through(run, times)
    row = {"setup": drawn.words, "method": drawn.method, "counts": False}
    if result is None:
        return row
    reference, apart = refined(drawn, times, most)
    if not apart < AGREE:
        return row
    error, moved = errors_of(run, x, reference)
    is_judged = JUDGED[0] < error / moved < JUDGED[1] and apart < error / moved
    row |= {"error": error, "moved": moved, "counts": is_judged}
    if not is_judged:
        return row
    _, alone, states = march_alone(run, "none")
    field, with_field, _ = march_alone(run, "sampled")
    double, with_double, _ = march_alone(run, "companion")
    row |= {"field": field if field < moved else math.nan, "sum": summed(run, states)}
    row |= {"double": double, "half": halved(run, states)}
    row |= {"cost of field": with_field / alone - 1, "cost of double": with_double / alone - 1}
    return row


def march_alone(run: Run, how: str) -> tuple[float, float, list]:
    """Return an estimate [m], the CPU seconds of the run, and the times and places of its steps."""
    states = [(run.state.t, run.state.x)]

    def keep(info) -> None:
        study.check_time_limit()
        states.append((info.t, info.result.state.x))

    begin = time.process_time()
    with warnings.catch_warnings(action="ignore", category=fc.FeclothWarning):
        result = fc.run(
            run.system, run.method, run.state, run.dt, run.t_end, report=keep, time_error=how
        )
    seconds = time.process_time() - begin
    estimate = result.accounts[TimeError].estimate
    return (estimate.whole if estimate else math.nan), seconds, states


def summed(run: Run, states: list) -> float:
    """Return Σ κ dt^(q + 1) |d^(q + 1) x / dt^(q + 1)| over the steps, as an rms [m]."""
    drift = drift_of(run.method.traits)
    if drift is None:
        return math.nan
    q, constant = drift
    total = 0.0
    for end in range(q + 2, len(states) + 1):
        times, places = zip(*states[end - q - 2 : end], strict=True)
        dt = times[-1] - times[-2]
        total += constant * dt ** (q + 1) * rms(run.system.diagonal_mass, derivative(times, places))
    return total


def halved(run: Run, states: list) -> float:
    """Return the largest distance from a run with half steps [m], NaN if it fails."""
    finer = Run(run.system, run.method, run.state, run.dt / 2, run.t_end)
    try:
        _, _, halves = march_alone(finer, "none")
    except FeclothError:
        return math.nan
    places = {round(t / finer.dt): x for t, x in halves}
    pairs = [(x, places.get(round(t / finer.dt))) for t, x in states]
    mass = run.system.diagonal_mass
    return max((rms(mass, x - y) for x, y in pairs if y is not None), default=math.nan)


def shares_of(ratios: np.ndarray, safety: float) -> tuple[float, float]:
    """Return the shares of the stated errors that are at least true, and at most 5 times that."""
    if not len(ratios):
        return math.nan, math.nan
    stated = safety * ratios
    return float((stated >= 1).mean()), float((stated <= FACTOR).mean())


def ratios_of(rows: list[dict], candidate: str) -> np.ndarray:
    """Return the estimates of a candidate over the true errors."""
    ratios = np.array([row[candidate] / row["error"] for row in rows if row.get("counts")])
    return ratios[np.isfinite(ratios)]


def compare(chosen: list[dict], judged: list[dict]) -> list[dict]:
    """Return a row for each candidate: its factor, from `chosen`, and its shares in `judged`."""
    table = []
    for name in CANDIDATES:
        ratios = ratios_of(chosen, name)
        shares = [min(shares_of(ratios, safety)) for safety in SAFETIES]
        safety = SAFETIES[int(np.argmax(shares))]
        others = ratios_of(judged, name)
        least, most = shares_of(others, safety)
        costs = [row[f"cost of {name}"] for row in judged if f"cost of {name}" in row]
        table.append(
            {
                "candidate": name,
                "factor of safety": float(safety),
                "at least the true": least,
                "at most 5 times": most,
                "with a number": len(others) / max(1, sum(bool(r.get("counts")) for r in judged)),
                "cost": float(np.median(costs)) if costs else math.nan,
            }
        )
    return table


def main(argv: list[str] | None = None) -> int:
    """Run the set-ups of both seeds, write the table and the report, return the exit status."""
    more = {
        "seed": {"type": int, "default": 11},
        "judge": {"type": int, "default": 12},
        "count": {"type": int, "default": 60},
    }
    options = harness.parse_arguments(__doc__ or "", argv, **more)
    count = QUICK_COUNT if options.quick else options.count
    most = QUICK_MOST if options.quick else MOST
    seeds = options.seed, options.judge
    cases = [{"seed": seed, "number": n, "most": most} for seed in seeds for n in range(count)]
    rows = study.run_cases(cases, judge, **harness.run_options(options), time_limit=120.0)
    rows = [row for row in rows if row["status"] == "ok"]
    parts = [[row for row in rows if row["seed"] == seed] for seed in seeds]
    title, what = harness.about(__doc__)
    table = compare(*parts)
    compared = sum(bool(row["counts"]) for row in rows)
    enough = 0 if options.quick else 1
    return harness.write_report(
        options,
        title,
        rows,
        conclusion=what,
        tables={"Candidates": table},
        findings=[harness.Finding("true errors to compare with", compared, enough)],
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
