"""Do the stated 95 % hold for specimens, angles and quantities that were left out of the fit?

Each row is a curve that took no part in its fit: an angle of the nylon, a repeat of a knit, a force
or width of a knit; and cotton with the constants of acrylic, shown without a limit. Constants,
spread of specimens and error of the law come from the other curves alone
(`fecloth/study/fitting/discrepancy.py`). Compared is the end of the curve, as all points give it.

Fixed before the first comparison: nylon begins at 20, 40, 2 kN/m (warp, weft, shear), Poisson's
ratio 0, σ 2 %, h 2.25 mm; knits at 100, 100, 30 N/m, 0.3, up to 25 %, h 1/6 of the length. A curve
has no interval where the constants from the others leave it uncertain by a factor above 1.65, the
limit for a constant, or no other curve tests the law. It never counts as covered.

The interval score (Gneiting and Raftery 2007, equation 43), over the measured value, is the length
plus 40 times the miss. The constant guess is mean ± t sd √(1 + 1/n) of the other specimens.

    python -m studies.validation.specimens [--quick]
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit

import fecloth as fc
from studies import harness
from studies.fit import knits
from studies.validation import nylon
from studies.validation.pages import quietly

YARNS = "acrylic", "cotton"
PART = 0.25  # of the extension of a knit
COLUMNS = {"force": "reaction.right.x", "half": "pin.y"}  # half of the width
NOISE = 0.01  # of a curve that is compared only, over its change
MISS = 40.0  # 2/α of the score, with α = 5 %
LEAST_COVERED = 0.9
Rows = list[dict[str, Any]]


def nylon_rows(angles: Sequence[int], steps: int) -> Rows:
    """Each angle left out: the force at its end, of twelve strips."""
    ends = {angle: float(nylon.Strip.read(angle).force.max()) for angle in nylon.ANGLES}
    rows = []
    for left_out in angles:
        tests = [
            nylon.Strip.read(angle).experiment(steps, fitted=angle != left_out)
            for angle in nylon.ANGLES
        ]
        answer = quietly(fc.fit, tests, nylon.START, refined=False)
        (line,) = answer.predictions
        others = [ends[angle] for angle in nylon.ANGLES if angle != left_out]
        rows.append(row_of("nylon", f"{left_out}°", "angle", line, answer, others))
    return rows


def knit_test(
    yarn: str, knit: str, direction: str, columns: Sequence[str], kept: Sequence[int], fitted: bool
) -> fc.Experiment:
    """Columns of some repeats; the specimen is the same whichever repeats are kept."""
    data, length, width = knits.read(knit, direction, PART, yarn)
    across, reach = data["half [m]"][0], max(data["extension [m]"])
    table = np.array(list(data.values()))
    table = table[:, np.isin(table[0], list(kept))]
    some = dict(zip(data, table.tolist(), strict=True))
    sizes = {name: NOISE * float(np.ptp(table[list(COLUMNS).index(name) + 2])) for name in columns}
    return fc.Experiment(
        partial(
            knits.strip, steps=knits.STEPS, length=length, width=width, reach=reach,
            angle=knits.ALONG[direction],
        ),
        some,
        {name: COLUMNS[name] for name in columns},
        {"extension": "grip.x"},
        sigma="repeats" if fitted else sizes,
        fitted=fitted,
        name=f"{knit}, {direction}" if fitted else f"{knit}, {direction}, left out",
        h=1 / knits.CELLS,
        t_end=1.0,
        probes=(
            fc.Probe("grip", "right"),
            fc.Probe("pin", point=(length / 2, width / 2 + min(across, 0.4999 * width))),
        ),
    )  # fmt: skip


def changes_at_end(yarn: str, knit: str, name: str) -> dict[tuple[str, int], float]:
    """The measured change at the end of each repeat of both directions."""
    changes = {}
    for direction in knits.ALONG:
        data, _, _ = knits.read(knit, direction, PART, yarn)
        table = np.array(list(data.values()))
        for number in np.unique(table[0]):
            column = table[:, table[0] == number][list(data).index(f"{name} [{UNITS[name]}]")]
            changes[direction, int(number)] = float(column[-1] - column[0])
    return changes


UNITS = {"force": "N", "half": "m"}


def knit_rows(yarn: str, knit: str) -> Rows:
    """Each repeat left out of both directions, then each force and width."""
    every = range(1, 6)
    rows = []
    start = knits.START
    for left_out in every:
        kept = [number for number in every if number != left_out]
        tests = [
            knit_test(yarn, knit, d, list(COLUMNS), numbers, fitted)
            for d in knits.ALONG
            for numbers, fitted in ((kept, True), ([left_out], False))
        ]
        answer = quietly(fc.fit, tests, start, refined=False)
        for line in answer.predictions:
            direction = line["experiment"].split(", ")[1]
            known = changes_at_end(yarn, knit, line["column"])
            others = [x for key, x in known.items() if key != (direction, left_out)]
            words = f"{direction}, repeat {left_out}"
            rows.append(row_of(f"{yarn} {knit}", words, "repeat", line, answer, others))
    for left_out_direction in knits.ALONG:
        for name in COLUMNS:
            tests = []
            for d in knits.ALONG:
                fitted = [c for c in COLUMNS if (d, c) != (left_out_direction, name)]
                tests.append(knit_test(yarn, knit, d, fitted, every, True))
            tests.append(knit_test(yarn, knit, left_out_direction, [name], every, False))
            answer = quietly(fc.fit, tests, start, refined=False)
            known = changes_at_end(yarn, knit, name)
            others = [x for (d, _), x in known.items() if d != left_out_direction]
            (line,) = answer.predictions
            fabric = f"{yarn} {knit}"
            rows.append(row_of(fabric, left_out_direction, "quantity", line, answer, others))
    return rows


def other_yarn_rows(knit: str) -> Rows:
    """Cotton with what a fit to acrylic says."""
    every = range(1, 6)
    names = list(COLUMNS)
    tests = [knit_test("acrylic", knit, d, names, every, True) for d in knits.ALONG]
    tests += [knit_test("cotton", knit, d, names, every, False) for d in knits.ALONG]
    answer = quietly(fc.fit, tests, knits.START, refined=False)
    rows = []
    for line in answer.predictions:
        direction = line["experiment"].split(", ")[1]
        others = list(changes_at_end("acrylic", knit, line["column"]).values())
        rows.append(row_of(f"cotton {knit}", direction, "yarn", line, answer, others))
    return rows


def row_of(
    fabric: str,
    specimen: str,
    kind: str,
    line: Mapping[str, Any],
    answer: fc.Fit,
    others: Sequence[float],
) -> dict[str, Any]:
    """A left-out curve: changes from the start, its interval, and the constant guess."""
    start = line["start"]
    low, high, predicted, measured = (
        line[key] - start for key in ("from", "to", "predicted", "measured")
    )
    mean, n = float(np.mean(others)), len(others)
    half = float(stdtrit(n - 1, 0.975) * np.std(others, ddof=1) * math.sqrt(1 + 1 / n))
    told = math.isfinite(low)
    return {
        "fabric": fabric,
        "left out": kind,
        "specimen": specimen,
        "quantity": f"{line['column']} [{line['unit']}]",
        "predicted": predicted,
        "from": low,
        "to": high,
        "measured": measured,
        "covered": ("yes" if low <= measured <= high else "no") if told else "not told",
        "score": score(low, high, measured),
        "score of a constant": score(mean - half, mean + half, measured),
        "specimens": answer.specimens,
        "law": answer.law,
        "both": answer.specimens_and_law,
    }


def score(low: float, high: float, measured: float) -> float:
    """The interval score, relative to what was measured; NaN without an interval."""
    missed = max(low - measured, measured - high, 0.0)
    return (high - low + MISS * missed) / abs(measured)


def summaries(rows: Rows) -> Rows:
    """A line for each kind of rows, and one for all but other yarns."""
    kinds = list(dict.fromkeys(row["left out"] for row in rows))
    lines = []
    for words in [*kinds, "all but yarn"]:
        own = [row for row in rows if row["left out"] == words]
        if words == "all but yarn":
            own = [row for row in rows if row["left out"] != "yarn"]
        told = [row for row in own if row["covered"] != "not told"]
        covered = sum(row["covered"] == "yes" for row in told)
        line: dict[str, Any] = {"left out": words, "curves": len(own), "told": len(told)}
        line["covered"] = covered
        if told:
            from scipy import stats  # takes half a second

            low, high = stats.binomtest(covered, len(told)).proportion_ci(0.95, "exact")
            line["Clopper-Pearson 95 %"] = f"{low:.2f} to {high:.2f}"
            for name in "score", "score of a constant":
                line[f"mean {name}"] = float(np.mean([row[name] for row in told]))
        lines.append(line)
    return lines


def main() -> int:
    options = harness.parse_arguments(__doc__ or "")
    if options.quick:
        return write(options, nylon_rows((45,), nylon.FEW))
    rows = nylon_rows(nylon.ANGLES, nylon.STEPS)
    for yarn, knit in product(YARNS, knits.KNITS):
        rows += knit_rows(yarn, knit)
    for knit in knits.KNITS:
        rows += other_yarn_rows(knit)
    return write(options, rows)


def write(options: Any, rows: Rows) -> int:
    """Write the page: the summary, and all rows but those of the repeats."""
    lines = summaries(rows)
    total = lines[-1]
    findings = []
    if not options.quick:
        findings = [
            harness.Finding(
                "share of told curves that their interval covers",
                total["covered"] / total["told"],
                LEAST_COVERED,
            ),
            harness.Finding(
                "mean interval score over that of a constant guess",
                total["mean score"] / total["mean score of a constant"],
                high=1.0,
            ),
        ]
    hidden = "specimens", "law", "both"
    shown = [
        {
            key: None if isinstance(cell, float) and math.isnan(cell) else cell
            for key, cell in row.items()
            if key not in hidden
        }
        for row in rows
    ]
    apart = [row for row in shown if row["left out"] != "repeat"]
    tables = {"Summary": lines, "Angles, quantities and yarns": apart}
    page = Path(__file__).with_suffix("")
    return harness.conclude(options, __doc__, page, rows, findings, tables)


if __name__ == "__main__":
    harness.run_main(main)
