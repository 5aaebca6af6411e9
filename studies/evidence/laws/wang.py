"""What all rows of Wang, O'Brien and Ramamoorthi (2011) say, beside the constants of their presets.

The constants are the row of zero strain. Each panel of wang.png has the force of strips with free
sides by all rows and by the constants; wang.md has by how much the constants are off at 5 and 20 %.

    python -m studies.evidence.laws.wang [--quick] [--out DIR]
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fecloth.fabric import presets, strips
from fecloth.study.figures import COLOURS
from fecloth.study.result import markdown_table
from studies import harness
from studies.laws.figures import picture

STRAINS = np.linspace(0.0025, 0.25, 100)
AT = (0.05, 0.2)  # the strains of the table
HELD = 0.1  # the constants hold as long as the force differs by less
NAMES = [name for name in presets.names() if presets.rows(name)]
STRIPS = [(name, along) for name in NAMES for along in strips.ALONG]
HEAD = f"""# Fabrics of Wang et al. at larger strains

Written by `python -m studies.evidence.laws.wang`, from the numbers in
`fecloth/fabric/fabrics.toml`, whose head says what they are and where they come from. The constants
of these presets were taken at zero strain. The table has the force per unstretched width of strips
with free sides by all rows, by how much the force of the constants (the law `StVK`) differs from
it, and at which strain it first differs by {100 * HELD:.0f} %. The rows are at strains of 0 and
{100 * strips.END:.1f} %; beyond, they are held constant.

![Force over strain of nine fabrics](wang.png)

*Dotted: where the rows end. Numbers: by how many per cent the constants are off at strains of 5 and
20 %.*

"""

Curves = dict[tuple[str, str], np.ndarray]


def curve(name: str, along: str, strains) -> np.ndarray:
    """Return (n, 2): the force [N/m] by all rows, and how far the constants are off."""
    rows = presets.rows(name)["stretching"]
    return np.array([strips.compare(rows, strain, along) for strain in strains])


def table_row(name: str, along: str, at: np.ndarray, strains, whole: np.ndarray) -> dict[str, str]:
    """Return a row of the table, from the curve at the strains `AT` and at all `strains`."""
    row = {"fabric": name, "strip": along}
    for strain, (force, off) in zip(AT, at, strict=True):
        row[f"force at {100 * strain:.0f} % [N/m]"] = f"{force:.1f}"
        row[f"constants at {100 * strain:.0f} %"] = f"{100 * off:+.0f} %"
    beyond = np.abs(whole[:, 1]) > HELD
    first = f"{100 * strains[np.argmax(beyond)]:.2g} %"
    row[f"{100 * HELD:.0f} % off at"] = first if beyond.any() else "over 25 %"
    return row


def draw(out: Path, strains, curves: Curves, at: Curves) -> None:
    """Write wang.png into the folder `out`: a panel for each fabric."""
    with picture(out / "wang.png", 3, (9.0, 8.7), rows=3) as (figure, axes):
        for name, ax in zip(NAMES, axes.flat, strict=True):
            for i, along in enumerate(strips.ALONG):
                force, off = curves[name, along].T
                ax.plot(100 * strains, force, color=COLOURS[i], lw=2)
                ax.plot(100 * strains, force * (1 + off), color=COLOURS[i], lw=1.4, ls="--")
                five, twenty = 100 * at[name, along][:, 1]
                words = f"{along}: {five:+.0f}, {twenty:+.0f} %"
                place = {"transform": ax.transAxes, "va": "top", "fontsize": 11}
                ax.text(0.04, 0.97 - 0.1 * i, words, color=COLOURS[i], **place)
            ax.axvline(100 * strips.END, color="0.4", lw=1, ls=":")
            ax.set(title=name, xlim=(0, 25), ylim=(0, None))
        figure.supxlabel("strain [%]; solid: all rows, dashed: the constants", fontsize=13)
        figure.supylabel("force per unstretched width [N/m]", fontsize=13)


def main() -> None:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few points, into out/laws")
    parser.add_argument("--out", type=Path, help="folder of wang.md")
    options = parser.parse_args()
    out = options.out or (Path("out/laws") if options.quick else Path(__file__).parent)
    strains = STRAINS[::20] if options.quick else STRAINS
    out.mkdir(parents=True, exist_ok=True)
    curves, at = ({strip: curve(*strip, e) for strip in STRIPS} for e in (strains, AT))
    rows = [table_row(*strip, at[strip], strains, curves[strip]) for strip in STRIPS]
    (out / "wang.md").write_text(HEAD + markdown_table(rows) + "\n", encoding="utf-8")
    draw(out, strains, curves, at)
    print(f"wrote {out}/wang.md and wang.png: {len(rows)} strips of {len(NAMES)} fabrics")


if __name__ == "__main__":
    harness.run_main(main)
