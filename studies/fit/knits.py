"""Which constants have two knits, drawn along courses and wales, and can elasticity meet them?

The specimens of Singal et al. (2024), `studies/validation/data`: stockinette and garter of acrylic
yarn between rigid clamps, force and distance of two pins across over the distance of the clamps,
five repeats each, whose scatter is the uncertainty. The warp stands for the wales. A pin's place
across is measured from its mean start. Each knit is fitted to both directions at once: up to 10 %
of extension, up to 25 %, and to the whole curves of up to 70 %. In garter along the course the pins
are farther apart than the clamps are wide: the specimen is taken as wide as its pins there.

    python -m studies.fit.knits [--quick]
"""

from __future__ import annotations

import math
import re
import time
from functools import partial
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth.simulation.load_steps import LoadSteps
from studies import harness
from studies.fit.specimens import rectangle
from studies.validation.pages import DATA, quietly, read_columns

KNITS = "stockinette", "garter"
PARTS = 0.1, 0.25, math.inf  # of the clamps' first distance
START = {"wale": 100.0, "course": 100.0, "shear": 30.0, "poisson": 0.3}
CELLS, STEPS = 6, 6  # along a specimen, and of its pull
ALONG = {"wale": 0.0, "course": math.pi / 2}  # angle of the wales to the pull


def strip(
    h, length, width, reach, angle,
    wale=100.0, course=100.0, shear=30.0, poisson=0.3, steps=STEPS,
):  # fmt: skip
    """A specimen between rigid clamps, with Y = 0 in its middle; the wales are at `angle` [rad]."""
    cloth = rectangle(length, width, h * length, "right")
    fabric = fc.Fabric(0.3, (wale, course), poisson, shear)
    grips = ["left", fc.Pin("right", motion=lambda t: (reach * t, 0, 0))]
    system = fc.System(cloth, fabric, [fc.StVK()], grips, grain=angle)
    return cloth, system, LoadSteps(steps), system.state(system.rest().x - [0.0, width / 2, 0.0])


def read(
    knit: str, direction: str, part: float, yarn: str = "acrylic"
) -> tuple[dict[str, list[float]], float, float]:
    """The columns of a specimen in SI, its length, and its width at the clamps.

    The distance across is halved, and each repeat begins at the mean of all. Where the clamps are
    closer than at first by the scatter of a picture, a row is left out.
    """
    path = DATA / f"singal_2024_{yarn}_{knit}_{direction}.csv"
    text = path.read_text(encoding="utf-8")
    match = re.search(r"width at the clamp ([\d.]+) mm", text)
    assert match
    columns = np.array(list(read_columns(path).values()))
    table = (columns[[0, 1, 2, 4]] * [[1.0], [1.0], [1e-3], [5e-4]]).T
    groups = [table[table[:, 0] == number] for number in np.unique(table[:, 0])]
    length = float(np.mean([group[0, 2] for group in groups]))
    across = float(np.mean([group[0, 3] for group in groups]))
    kept = []
    for group in groups:
        moved = group - [0.0, 0.0, group[0, 2], group[0, 3] - across]
        kept.append(moved[(moved[:, 2] >= 0.0) & (moved[:, 2] <= part * length)])
    number, force, extension, half = np.concatenate(kept).T.tolist()
    data = {"repeat": number, "extension [m]": extension, "force [N]": force, "half [m]": half}
    return data, length, max(1e-3 * float(match[1]), 2 * across)


def experiment(knit: str, direction: str, part: float, cells: int, steps: int) -> fc.Experiment:
    data, length, width = read(knit, direction, part)
    across = data["half [m]"][0]
    return fc.Experiment(
        partial(
            strip, steps=steps, length=length, width=width, reach=max(data["extension [m]"]),
            angle=ALONG[direction],
        ),
        data,
        {"force": "reaction.right.x", "half": "pin.y"},
        {"extension": "grip.x"},
        sigma="repeats",
        name=f"{knit}, {direction}",
        h=1 / cells,
        t_end=1.0,
        probes=(
            fc.Probe("grip", "right"),
            fc.Probe("pin", point=(length / 2, width / 2 + min(across, 0.4999 * width))),
        ),
    )  # fmt: skip


def fit_knit(knit: str, part: float, cells: int, steps: int) -> tuple[dict, fc.Fit]:
    """Fit a part of both curves of a knit."""
    begin = time.process_time()
    experiments = [experiment(knit, direction, part, cells, steps) for direction in ALONG]
    answer = quietly(fc.fit, experiments, START, refined=steps == STEPS)
    row: dict = {"knit": knit, "up to": "the end" if math.isinf(part) else f"{100 * part:.0f} %"}
    for name, value in answer.values.items():
        half = (answer.intervals_of_data[name][1] - answer.intervals_of_data[name][0]) / 2
        row[name] = f"{value:.4g} ± {half:.2g}" if math.isfinite(half) else f"{value:.4g}"
    row["not told"] = ", ".join(sorted(set(answer.values) - set(answer.identified))) or "-"
    for line in answer.experiments:
        words = f"{line['experiment'].split(', ')[1]}, {line['column']}: rms %"
        row[words] = f"{line['rms %']:.2g}"
    row |= {"misfit": answer.misfit, "law": "wrong" if answer.law_fails else "not refuted"}
    return row | {"CPU s": round(time.process_time() - begin, 1)}, answer


def main() -> int:
    options = harness.parse_arguments(__doc__ or "")
    knits, parts, cells, steps = KNITS, PARTS, CELLS, STEPS
    if options.quick:
        knits, parts, cells, steps = ("stockinette",), (math.inf,), 3, 3
    rows = []
    for knit in knits:
        for part in parts:
            row, answer = fit_knit(knit, part, cells, steps)
            rows.append(row)
            answer.report(options.out / f"{knit}_{row['up to'].split()[0]}")
    whole = [row for row in rows if row["up to"] == "the end"]
    findings = [
        harness.Finding(
            "knits whose whole curves say that the law is wrong",
            sum(row["law"] == "wrong" for row in whole),
            len(whole),
        )
    ]
    return harness.conclude(
        options, __doc__, Path(__file__).with_suffix(""), rows, findings, {"Fits": rows}
    )


if __name__ == "__main__":
    harness.run_main(main)
