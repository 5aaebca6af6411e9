"""Do the intervals of a fit hold for the next strip? Twins whose strips differ from each other.

Strips of 1200 and 800 N/m along warp and weft are drawn to 5 %. The force per width is
s Y λ (λ² − 1)/2, with a factor s of the strip (ln s: 0 ± 5 %) and noise of 2 % at 36 points. The
interval should cover the stiffness of one more strip. "This strip" is by the noise of points. Of
three strips the two half widths have the ratio 1.32 in the mean of many such studies, ± 0.11 for
60 trials: 2.57 √(4/3) times the pooled deviation of six, over 4.30 √(1/3) times the one of three.

    python -m studies.fit.strips [--quick] [--count 60]
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import fecloth as fc
from fecloth.simulation.load_steps import LoadSteps
from studies import harness
from studies.validation.pages import quietly

TRUE = {"warp": 1200.0, "weft": 800.0}
START = {"warp": 1000.0, "weft": 1000.0}
ANGLES = {"warp": 0.0, "weft": math.pi / 2}
WIDTH, LENGTH, DRAWN = 0.025, 0.1, 0.05  # [m], [m], largest extension over the length
NOISE, SPREAD, POINTS = 0.02, 0.05, 36
LEAST, WIDER = 54, 1.3  # covered of 60 trials; half widths over those of today
CASES: dict[str, dict[str, Any]] = {
    "all strips the same, one a direction": {"spread": 0.0, "strips": 1},
    "one strip a direction": {"spread": SPREAD, "strips": 1},
    "one strip a direction, specimens = 5 %": {"spread": SPREAD, "strips": 1, "stated": "5 %"},
    "three strips a direction": {"spread": SPREAD, "strips": 3},
}


def strip(h, angle, warp=1000.0, weft=1000.0):
    """A strip whose ends slide across: its stress is the same everywhere."""
    cloth = fc.Cloth.rectangle(LENGTH, WIDTH, h, pattern="right")
    fabric = fc.Fabric(0.2, (warp, weft), 0.25, 300.0)
    grip = fc.Slide(
        "right", motion=lambda t: (DRAWN * LENGTH * t, 0, 0), direction=(0, 1, 0), name="grip"
    )
    corner = fc.Pin(lambda X: np.hypot(X[:, 0], X[:, 1]) < 1e-9)
    left = fc.Slide("left", direction=(0, 1, 0), without=lambda X: X[:, 1] < 1e-9)
    system = fc.System(cloth, fabric, [fc.StVK()], [corner, left, grip], grain=angle)
    return cloth, system, LoadSteps(4), system.rest()


def force(stiffness: float, extension: np.ndarray) -> np.ndarray:
    stretch = 1 + extension / LENGTH
    return stiffness * WIDTH * stretch * (stretch**2 - 1) / 2


def measure(name: str, strips: int, spread: float, rng: np.random.Generator) -> fc.Experiment:
    """Strips of one direction, pulled and measured with noise."""
    extension = np.linspace(0, DRAWN * LENGTH, POINTS + 1)[1:]
    exact = force(TRUE[name], extension)
    sigma = NOISE * exact.max()
    curves = [
        exact * math.exp(spread * rng.normal()) + sigma * rng.normal(size=POINTS)
        for _ in range(strips)
    ]
    data = {
        "repeat": np.repeat(np.arange(strips), POINTS),
        "extension [m]": np.tile(extension, strips),
        "force [N]": np.concatenate(curves),
    }
    return fc.Experiment(
        partial(strip, angle=ANGLES[name]),
        data,
        {"force": "reaction.grip.x"},
        {"extension": "grip.x"},
        sigma="repeats" if strips > 1 else sigma,
        name=name,
        h=WIDTH,
        t_end=1.0,
        probes=(fc.Probe("grip", "right"),),
    )


def trial(number: int, spread: float, strips: int, stated: str | None = None) -> dict[str, Any]:
    """Fit one twin; say which intervals cover the stiffness of one more strip."""
    rng = np.random.default_rng([54, number])
    tests = [measure(name, strips, spread, rng) for name in TRUE]
    answer = quietly(fc.fit, tests, START, refined=False, specimens=stated)
    row: dict[str, Any] = {"trial": number, "misfit": answer.misfit, "spread": answer.specimens}
    for name, stiffness in TRUE.items():
        new = stiffness * math.exp(spread * rng.normal())
        for words, intervals in ("", answer.intervals), (" (data)", answer.intervals_of_data):
            low, high = intervals[name]
            row[f"{name}: half %{words}"] = 50 * (high - low) / stiffness
            row[f"{name}: covered{words}"] = bool(low <= new <= high)
            row[f"{name}: mean covered{words}"] = bool(low <= stiffness <= high)
    return row


def summary(words: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """A line for the trials of a case."""
    line: dict[str, Any] = {"strips": words, "trials": len(rows)}
    for name in TRUE:
        for kind in "", " (data)":
            of = "new" if not kind else "this"
            line[f"{name}: {of} strip, covered"] = sum(
                row[f"{name}: covered{kind}"] for row in rows
            )
            halves = [row[f"{name}: half %{kind}"] for row in rows]
            line[f"{name}: {of} strip, median half %"] = float(np.median(halves))
    return line


def find(lines: dict[str, dict[str, Any]], count: int) -> list[harness.Finding]:
    """What is expected of the trials."""
    same, single, stated, three = lines.values()
    least = LEAST * count / 60
    rows = []
    for name in TRUE:
        covered, half = f"{name}: new strip, covered", f"{name}: new strip, median half %"
        of_data, half_of_data = covered.replace("new", "this"), half.replace("new", "this")
        rows += [
            harness.Finding(f"{name}: strips that are the same, covered", same[of_data], least),
            harness.Finding(f"{name}: three strips, covered", three[covered], least),
            harness.Finding(
                f"{name}: one strip and specimens = 5 %, covered", stated[covered], least
            ),
            harness.Finding(
                f"{name}: one strip, intervals of a new one",
                count * math.isfinite(single[half]),
                high=0,
            ),
            harness.Finding(
                f"{name}: three strips, half width over that of the data",
                three[half] / three[half_of_data],
                high=WIDER,
            ),
        ]
    return rows


def main() -> int:
    count = {"type": int, "default": 60, "help": "trials of a case (60)"}
    options = harness.parse_arguments(__doc__ or "", count=count)
    trials = 2 if options.quick else options.count
    rows, lines = [], {}
    for words, case in CASES.items():
        of_case = [trial(number, **case) for number in range(trials)]
        lines[words] = summary(words, of_case)
        rows += [{"strips": words, **row} for row in of_case]
    findings = [] if options.quick else find(lines, trials)
    tables = {"Trials": list(lines.values())}
    return harness.conclude(
        options, __doc__, Path(__file__).with_suffix(""), rows, findings, tables
    )


if __name__ == "__main__":
    harness.run_main(main)
