"""What was predicted of measured cloth: curves left out of fits, weaves in bias, and drapes.

Reads `specimens.csv`, whose rows are specimens that took no part in the fit that predicts them, and
the `comparison.csv` of each folder, and writes the page: the interval score beside a constant
guess, the coverage with its own uncertainty, by how much predictions differ, and what was assumed.

    python -m studies.validation [--quick] [--out DIR]
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fecloth.output.atomic_files import replace_file
from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.result import markdown_table
from studies import harness
from studies.validation.comparison import COVERS, Comparison, read_comparisons
from studies.validation.specimens import summaries

HERE = Path(__file__).parent
NUMBERS = "predicted", "measured", "score", "score of a constant"
FOLDERS = {  # with what each says of the law, in a sentence
    "bias": "A measured shear curve is met between its points, and is not known beyond its end.",
    "drape": "KES numbers tell the drape coefficient of an elastic cloth within 6 points.",
}
ASSUMED = """\
| assumed input | standard uncertainty | where from |
|---|---|---|
| angle of cut of a strip | 1° | no source; 1° moves the force of the nylon at 75° by 7 % |
| Poisson's ratio of the nylon | 0, exact | no source: forces tell 1/G − 2 ν/Y₁ alone |
| noise of a curve of the nylon | 2 % of its largest force | no source prints one |
| tension, shear of the draped fabrics | a factor 2 | four weaves of Wang et al. (2011) |
| B along the bias | a factor 1.68 about Huber's value | 618 fabrics of Feng et al. (2022) |
| B, 2HB of the draped fabrics | 10 %, 15 % | no source prints a repeatability |
| measured drape coefficient | 2.4 points | median scatter of drape tests of 25 fabrics |
"""
OTHERS = """\
- nylon: StVK, fitted to four angles, misses the fifth by 4 to 27 %; the part of the law covers it.
- [knits](knits.md): the constants of one stitch are called wrong for the other. Of garter no
  curve is told: its width hardly changes, and one spread of specimens serves forces and widths.
"""
ABOUT = """# Validation: predicted beside measured

See which measurements of real cloth fecloth predicts, how well, and which it
does not.

`python -m studies.validation` makes this page from the numbers of [specimens](specimens.md), which
has the method, and of the folders. [The data](data/README.md) are published measurements.
"""


def left_out() -> list[dict[str, Any]]:
    """The rows of `specimens.csv`, with numbers as numbers."""
    with (HERE / "specimens.csv").open(newline="", encoding="utf-8") as stream:
        rows: list[dict[str, Any]] = list(csv.DictReader(stream))
    for row in rows:
        for name in NUMBERS:
            row[name] = float(row[name])
    return rows


def predictions() -> list[Comparison]:
    """All comparisons of kind "predicted", in the order of `FOLDERS`."""
    every = [each for name in FOLDERS for each in read_comparisons(HERE / name / "comparison.csv")]
    return [each for each in every if each.agrees is not None and each.kind == "predicted"]


def describe_specimens(rows: Sequence[dict[str, Any]]) -> str:
    """The score, the coverage, and the curves that no interval covers."""
    lines = summaries(list(rows))
    total = lines[-1]
    missed = []
    for row in rows:
        if row["covered"] != "no":
            continue
        ratio = row["predicted"] / row["measured"]
        missed.append(
            f"- {row['fabric']}, {row['specimen']}, {row['quantity']}: "
            f"predicted {row['predicted']:.3g}, measured {row['measured']:.3g}; "
            f"differs by {100 * (ratio - 1):+.0f} %, "
            f"and would not with a standard uncertainty of {50 * abs(math.log(ratio)):.0f} %"
        )
    covered = f"{total['covered']} (Clopper–Pearson {total['Clopper-Pearson 95 %']})"
    return f"""\
Of {total["curves"]} curves that were left out of their fit, {total["told"]} are told by the others.
Their 95 % intervals cover {covered}, with a
mean interval score of {total["mean score"]:.2g} times the measured value; a constant guess from the
other specimens has {total["mean score of a constant"]:.2g} (less is better).

{markdown_table(lines)}

Not covered:

{chr(10).join(missed) or "none"}"""


def describe_drapes(chosen: Sequence[Comparison]) -> str:
    """Each drape once: from shaken to laid."""
    own = [each for each in chosen if each.folder == "drape"]
    rows: list[dict[str, Any]] = []
    for fabric in dict.fromkeys(each.specimen for each in own):
        of = {each.quantity.split(", ")[1]: each for each in own if each.specimen == fabric}
        ends = of["shaken"].predicted, of["laid"].predicted
        measured = of["laid"].measured
        off = max(ends[0] - measured, measured - ends[1], 0.0)
        rows.append(
            {
                "fabric": fabric,
                "shaken to laid [%]": f"{ends[0]:.0f} to {ends[1]:.0f}",
                "elastic [%]": f"{of['elastic'].predicted:.0f} ± {of['elastic'].own:.0f}",
                "measured [%]": f"{measured:.1f} ± {of['laid'].scatter:.1f}",
                "outside the range by": f"{off:.1f}",
            }
        )
    return markdown_table(rows)


def describe_bias(chosen: Sequence[Comparison]) -> str:
    """Each prediction of the bias extension with what it differs by."""
    rows = [
        {
            "specimen": each.specimen,
            "quantity": f"{each.quantity} [{each.unit}]",
            "predicted": f"{each.predicted:.3g} ± {each.own:.2g}",
            "measured": f"{each.measured:.3g} ± {each.scatter:.2g}",
            "differs by": f"{each.difference:+.2g} ({each.percent:+.0f} %)",
        }
        for each in chosen
        if each.folder == "bias"
    ]
    return markdown_table(rows)


def draw(chosen: Sequence[Comparison]) -> Figure:
    """Predicted over measured, both relative to the measured number, with 2 uncertainties."""
    figure, ax = new_figure(1, 1, (8.0, 0.5 + 0.2 * len(chosen)))
    colours = dict(zip(FOLDERS, COLOURS, strict=False))
    for place, each in enumerate(chosen):
        size = abs(each.measured)
        colour = colours[each.folder]
        bar = {"fmt": "o" if each.agrees else "X", "color": colour, "ms": 5, "lw": 1.5}
        ax.errorbar(each.predicted / size, place, xerr=COVERS * each.own / size, **bar)
        scatter = COVERS * each.scatter / size
        ax.fill_betweenx([place - 0.35, place + 0.35], 1 - scatter, 1 + scatter, color="0.85")
    ax.axvline(1.0, color="0.3", lw=0.8)
    labels = [f"{each.specimen}, {each.quantity}" for each in chosen]
    ax.set_yticks(range(len(chosen)), labels, fontsize=7)
    ax.set(xlabel="predicted over measured; grey: 2 u of the measurement; X: does not agree")
    ax.set_xscale("symlog", linthresh=2.0)
    ax.set_xticks([0, 0.5, 1, 1.5, 2, 4, 8], ["0", "0.5", "1", "1.5", "2", "4", "8"])
    ax.set_xlim(-0.5, 12)
    ax.invert_yaxis()
    for name, colour in colours.items():
        ax.plot([], [], "o", color=colour, label=name)
    ax.legend(loc="lower right", fontsize=8)
    return figure


def write_page(rows: Sequence[dict[str, Any]], chosen: Sequence[Comparison]) -> str:
    folders = "\n".join(f"- [{name}]({name}/README.md): {words}" for name, words in FOLDERS.items())
    parts = [
        ABOUT.strip(),
        "## Specimens left out",
        describe_specimens(rows),
        "## Drape coefficients",
        describe_drapes(chosen),
        "## Bias extension of a weave",
        describe_bias(chosen),
        "![Predicted over measured, with 2 standard uncertainties of both](chart.png)",
        "## What was assumed",
        ASSUMED.strip(),
        "## By folder",
        OTHERS + folders,
    ]
    return "\n\n".join(parts) + "\n"


def main() -> int:
    options, chosen = harness.parse_arguments(__doc__ or ""), predictions()
    replace_file(options.out / "README.md", write_page(left_out(), chosen).encode())
    draw(chosen).savefig(options.out / "chart.png", dpi=110, bbox_inches="tight")
    print(f"{len(chosen)} predictions\nwrote {options.out / 'README.md'}")
    return 0


if __name__ == "__main__":
    harness.run_main(main)
