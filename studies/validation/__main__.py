"""What was predicted of measured cloth, over all folders of `studies.validation`.

Reads the `comparison.csv` of each folder, counts the predictions that agree, and draws one chart of
all of them beside their measurements. Numbers that were fitted, or shown without a verdict, are not
counted.

    python -m studies.validation [--quick] [--out DIR]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fecloth.output.atomic_files import replace_file
from fecloth.study.figures import COLOURS, Figure, new_figure
from studies import harness
from studies.validation.comparison import COVERS, Comparison, read_comparisons

HERE = Path(__file__).parent
FOLDERS = {  # with what each says of the law, in a sentence
    "nylon": "StVK, fitted at 0, 45 and 90° to the grain, does not predict 30 and 75°: "
    "three constants cannot meet five stiffnesses.",
    "knits": "Forces of a knit do not tell its width, and constants of one knit are wrong by "
    "2 to 9 times for another.",
    "bias": "A measured shear curve is met between its points, and is not known beyond its end.",
    "drape": "KES numbers tell the drape coefficient of an elastic cloth within 6 points, which is "
    "about the uncertainty by the constants that were not measured; with the friction of a cloth "
    "that is laid, one of two fabrics is 13 points too stiff.",
}
ABOUT = f"""# Validation: predicted beside measured

See which measurements of real cloth fecloth predicts, how well, and which it
does not.

`python -m studies.validation` makes this page from the numbers of the folders, and
`python -m studies.validation.FOLDER` makes these.

The measured number took no part in what was fitted. The standard uncertainty of a prediction is the
root of the sum of squares of mesh, step, solver, constants and start, as of `fc.budget`; with the
scatter of the measurement it is the total. Both agree where the difference is at most {COVERS:g}
totals (ASME V&V 20-2009). [The data](data/README.md) are published measurements. A wide total makes
agreement easy: read it beside the difference.

![Predicted over measured, with {COVERS:g} standard uncertainties of both](chart.png)
"""


def predictions() -> list[Comparison]:
    """All comparisons of kind "predicted", in the order of `FOLDERS`."""
    every = [each for name in FOLDERS for each in read_comparisons(HERE / name / "comparison.csv")]
    return [each for each in every if each.agrees is not None and each.kind == "predicted"]


def count_words(chosen: Sequence[Comparison]) -> str:
    """How many predictions agree, by folder, with the sentence on each."""
    lines = []
    for name, words in FOLDERS.items():
        own = [each for each in chosen if each.folder == name]
        agreed = sum(bool(each.agrees) for each in own)
        lines.append(f"- [{name}]({name}/README.md): {agreed} of {len(own)} agree. {words}")
    return "\n".join(lines)


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


def write_page(chosen: Sequence[Comparison]) -> str:
    agreed = sum(bool(each.agrees) for each in chosen)
    total = f"{agreed} of {len(chosen)} predictions agree with what was measured."
    return f"{ABOUT}\n{total}\n\n{count_words(chosen)}\n"


def main() -> int:
    options, chosen = harness.parse_arguments(__doc__ or ""), predictions()
    replace_file(options.out / "README.md", write_page(chosen).encode())
    draw(chosen).savefig(options.out / "chart.png", dpi=110, bbox_inches="tight")
    print(f"{len(chosen)} predictions\nwrote {options.out / 'README.md'}")
    return 0


if __name__ == "__main__":
    harness.run_main(main)
