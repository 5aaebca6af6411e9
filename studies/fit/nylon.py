"""Which constants has a bonded nylon textile, drawn at five angles, and can elasticity meet it?

The strips of Farrell et al. (2025), `studies/validation/data`: forces at 0, 30, 45, 75 and 90° to
the grain, between clamps that hold them along the pull only, each with the extension at which it is
slack. Expected: StVK with warp, weft and shear stiffness meets 0, 45 and 90° within 2 % of the
largest force (rms) in 120 CPU seconds; Poisson's ratio beside them is named as not told, since
force at any angle tells only 1/G − 2 ν/Y₁; and of all five angles together the fit says that the
law is wrong: orthotropic elasticity has three numbers for five stiffnesses.

    python -m studies.fit.nylon [--quick]
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import fecloth as fc
from fecloth.simulation.load_steps import LoadSteps
from studies import harness
from studies.fit.specimens import rectangle
from studies.fit.twins import fit_quietly
from studies.validation.pages import DATA

GAUGE, WIDTH, REACH = 0.097, 0.027, 6e-3  # [m]
ANGLES, FITTED = (0, 30, 45, 75, 90), (0, 45, 90)
START = {"warp": 1000.0, "weft": 1000.0, "shear": 100.0}
LARGEST_RMS = 2.0  # % of the largest force
CPU = 120.0  # s


def strip(h, angle, warp=1000.0, weft=1000.0, shear=100.0, poisson=0.0, steps=12):
    """A strip whose clamps hold it along the pull; the warp is at `angle` [degrees]."""
    cloth = rectangle(GAUGE, WIDTH, h, "right")
    fabric = fc.Fabric(0.2, (warp, weft), poisson, shear)
    pins = [
        fc.Pin(lambda X: X.sum(axis=1) < 1e-9, name="corner"),
        fc.Slide(lambda X: (X[:, 0] < 1e-9) & (X[:, 1] > 1e-9), direction=(0, 1, 0), name="held"),
        fc.Slide("right", motion=lambda t: (REACH * t, 0, 0), direction=(0, 1, 0)),
    ]
    system = fc.System(cloth, fabric, [fc.StVK()], pins, grain=math.radians(angle))
    return cloth, system, LoadSteps(steps), system.rest()


def experiment(angle: int, fitted: bool = True, steps: int = 12) -> fc.Experiment:
    return fc.Experiment(
        partial(strip, angle=angle, steps=steps),
        DATA / f"farrell_2025_tension_{angle:02d}.csv",
        {"force": "reaction.right.x"},
        {"extension": "grip.x"},
        offset=True,
        fitted=fitted,
        name=f"{angle}°",
        h=WIDTH,  # the strain is uniform
        t_end=1.0,
        probes=(fc.Probe("grip", "right"),),
    )


def fit_to(fitted: Sequence[int], start: dict[str, float], shown: Sequence[int], steps: int):
    """Fit to some angles, and compare with the others that are shown."""
    experiments = [experiment(angle, angle in fitted, steps) for angle in shown]
    return fit_quietly(experiments, start, refined=False)


def line(words: str, answer) -> dict[str, object]:
    """The line of a fit: its constants, and how far each curve is off."""
    rms = {row["experiment"]: f"{row['rms %']:.2f}" for row in answer.experiments}
    constants = {}
    for name, value in answer.values.items():
        half = (answer.intervals[name][1] - answer.intervals[name][0]) / 2
        constants[name] = f"{value:.4g}" + (f" ± {half:.2g}" if math.isfinite(half) else "")
    verdict = "the law is wrong" if answer.law_fails else ""
    untold = ", ".join(sorted(set(answer.values) - set(answer.identified))) or "-"
    return {
        "fit": words, **{key: constants.get(key, "0") for key in (*START, "poisson")},
        **{f"rms {angle}° %": rms.get(f"{angle}°", "") for angle in ANGLES},
        "misfit": answer.misfit, "not told": untold, "law": verdict,
    }  # fmt: skip


def main() -> int:
    options = harness.parse_arguments(__doc__ or "")
    steps, shown = (6, FITTED) if options.quick else (12, ANGLES)
    begin = time.process_time()
    three = fit_to(FITTED, START, FITTED, steps)
    seconds = time.process_time() - begin
    rms = [row["rms %"] for row in three.experiments]
    findings = [
        harness.Finding(
            "0, 45 and 90°: largest rms, % of the largest force", max(rms), high=LARGEST_RMS
        ),
        harness.Finding("CPU seconds of this fit", seconds, high=CPU),
    ]
    table = [line("0, 45 and 90°", three)]
    if not options.quick:
        begins = {name: round(value, 1) for name, value in three.values.items()}
        predicted = fit_to(FITTED, begins, shown, steps)
        loose = fit_to(FITTED, begins | {"poisson": 0.2}, FITTED, steps)
        five = fit_to(ANGLES, begins, shown, steps)
        table = [
            line("0, 45 and 90°, others predicted", predicted),
            line("0, 45 and 90° with Poisson's ratio", loose),
            line("all five", five),
        ]
        untold = {"shear", "poisson"} - set(loose.identified)
        says = five.law_fails and "the law is wrong" in five.verdict
        without = sum(math.isnan(interval[0]) for interval in five.intervals.values())
        findings += [
            harness.Finding("of shear and poisson together, not told", len(untold), 2),
            harness.Finding("all five: the law is wrong (1: said)", int(says), 1),
            harness.Finding("all five: constants without an interval", without, 3),
        ]
        five.report(options.out / "five")
        three.report(options.out / "three")
    title, what = harness.about(__doc__)
    return harness.write_report(
        options,
        title,
        table,
        conclusion=what,
        findings=findings,
        tables={"Fits": table},
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
