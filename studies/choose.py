"""Which model, method and solver when, drawn from the tables that the other studies have written.

Every statement is some numbers of these tables and the ranges in which it holds. One whose number
has left its range is told and not printed, and so is one whose table is not there, with the
command that makes it. The exit code is 1 where a statement is no longer supported. With `--quick`
the tables of quick forms will do, which are too small to deny one, and no chart is drawn.

    python studies/choose.py [--quick] [--tables out] [--out out/choose]
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import choose_methods
import choose_models
import harness
from choose_rule import Rule
from choose_tables import Missing, Tables, explicit, first_order, second_order, still
from speed_grid import MODEL

from fecloth.disk import replace_file

HEAD = """What the studies say of a scene before it runs, in their numbers. The next section lists
methods, the one after it draws all runs; `python studies/needs.py --scene my.toml` runs yours.
`fecloth info my.toml` prints its ρ g L³/B, weight over bending stiffness: L is how far the cloth
reaches from its pins, twice that if they surround its middle, B the least of its rigidities."""
FOOT = """`python studies/choose.py` draws table and chart from what those studies have written into
`out/`; what their numbers no longer support it tells and leaves out. CPU seconds of one thread."""
OPEN = """No study measures: `NeoHookean` against collapse, beyond one scene of
`studies/scenes/failures/`; `TensionField` against wrinkles that a mesh resolves; `HingeBending`
against `QuadraticBending` in sharp folds; ρ g L³/B between 100 and 10⁴; which damping; gas; more
than 32,000 triangles."""
RULES = choose_models.RULES + choose_methods.RULES
TITLE = "## Which model, method and solver when"
LEVELS = (0.01, 0.001)
RAISED = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
TITLES = {"trampoline": "trampoline: a disk falls", "wave": "wave: a small one along a strip"}
TITLES |= {"swing": "swing: a sheet of paper falls", "stretch": "stretch: a strip is drawn out"}
FAMILIES: dict[str, Callable] = {  # rows of the chart
    "explicit": explicit,
    "implicit, 2nd order": second_order,
    "implicit, 1st order": first_order,
    "Auto": lambda row: row["method"] == "Auto",
    "P2, marched": lambda row: row["element"] == "P2" and not still(row),
    "equilibrium": still,
}


def short(value: float) -> str:
    """Two digits, three of what begins with a 1.

    Examples
    --------
    >>> [short(v) for v in (0.01049, 8.665, 1.434, 196.19, 19620.0, 3.1e-7)]
    ['0.0105', '8.7', '1.43', '196', '1.96 · 10⁴', '3.1 · 10⁻⁷']
    """
    text = f"{value:.{3 if f'{value:e}'[0] == '1' else 2}g}"
    mantissa, _, power = text.partition("e")
    if not power or 100 <= value < 1e4:
        return f"{float(text):g}"
    return f"{mantissa} · 10{str(int(power)).translate(str.maketrans('-0123456789', RAISED))}"


@dataclass(frozen=True)
class Verdict:
    """The row of a rule in the table; or why there is none: no table, or a number denies it."""

    row: str = ""
    missing: str = ""
    denied: str = ""


def judged(rule: Rule, tables: Tables) -> Verdict:
    """Whether the studies' numbers support a rule."""
    try:
        numbers = rule.numbers(tables)
    except Missing as cause:
        return Verdict(missing=str(cause))
    wrong = [f for f in (harness.Finding(n, *v) for n, v in numbers.items()) if not f.met]
    if wrong:
        return Verdict(denied="; ".join(map(str, wrong)))
    said = {name: short(value) for name, (value, *_) in numbers.items()}
    have, take, because = (part.format(**said) for part in (rule.have, rule.take, rule.because))
    return Verdict(f"| {have} | {take} | {because} ({rule.studies}) |")


def page(verdicts: list[Verdict]) -> str:
    """The section."""
    rows = [verdict.row for verdict in verdicts if verdict.row]
    table = "\n".join(["| you have | take | because |", "|---|---|---|", *rows])
    return "\n\n".join([TITLE, HEAD, table, f"*{FOOT}*", OPEN]) + "\n"


def left_out(rules: list[Rule], verdicts: list[Verdict], quick: bool = False) -> list[str]:
    """What is denied, by which number; and for each table that is not there what hangs on it."""
    lines, wanting = [], {}
    words = "not shown by the quick forms of" if quick else "no longer supported by"
    for rule, verdict in zip(rules, verdicts, strict=True):
        what = re.sub("{.*?}", "…", f"“{rule.have}”: {rule.take}")
        if verdict.denied:
            lines.append(f"{words} {rule.studies}: {what}\n    {verdict.denied}")
        if verdict.missing:
            wanting.setdefault(verdict.missing, []).append(f"\n    {what}")
    return lines + [f"{cause}\n  Not told without it:{''.join(w)}" for cause, w in wanting.items()]


# --- chart ----------------------------------------------------------------------------------------


def draw(out: Path, tables: Tables) -> None:
    """CPU seconds of each family's cheapest run to 1 % and to 0.1 %, a panel for each scene."""
    size = {"panels": (2, 2), "size": (8.0, 5.6), "log": False, "sharey": True}
    with harness.figure(out, "choose", **size) as (figure, axes):
        figure.suptitle("CPU time to an error of 1 % of the mean (●) and of 0.1 % (◆)", fontsize=12)
        figure.supxlabel("CPU time [s]", fontsize=12)
        axes[0, 0].set_yticks(range(len(FAMILIES)), list(FAMILIES))
        axes[0, 0].set_ylim(len(FAMILIES) - 0.4, -0.6)
        for ax, scene in zip(axes.ravel(), MODEL, strict=True):
            ax.set(xscale="log", xlim=(1e-3, 30), title=TITLES[scene])
            ax.grid(visible=False, axis="y")
            for i, among in enumerate(FAMILIES.values()):
                dot(ax, i, *(tables.cheapest(scene, level, among) for level in (*LEVELS, math.inf)))


def dot(ax, i: int, one: float, tenth: float, ever: float) -> None:
    """A family's seconds as a mark for each error, on a logarithmic axis, and in numbers."""
    place = {"va": "center", "fontsize": 9}
    if math.isinf(one):
        said = "not run" if math.isinf(ever) else "at no setting tried"
        ax.text(1.2e-3, i, said, color="0.4", **place)
        return
    ax.plot(one, i, "o", ms=9, color=harness.COLOURS[0])
    text, last = f"{short(one)} s", one
    if not math.isinf(tenth):
        ax.plot([one, tenth], [i, i], color="0.6", lw=1, zorder=1)
        ax.plot(tenth, i, "D", ms=8, color=harness.COLOURS[1])
        text, last = f"{text}, {short(tenth)} s", tenth
    ax.text(1.5 * last, i, text, **place)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--tables", type=Path, default=Path("out"), metavar="DIR", help="what studies have written")
    add("--out", type=Path, default=Path("out/choose"), metavar="DIR", help="results go here")
    add("--quick", action="store_true", help="take tables of quick forms, draw nothing")
    options = parser.parse_args()
    tables = Tables(options.tables, options.quick)
    verdicts = [judged(rule, tables) for rule in RULES]
    text = page(verdicts)
    options.out.mkdir(parents=True, exist_ok=True)
    replace_file(options.out / "choose.md", text.encode())
    if not options.quick and (options.tables / "speed_accuracy/results.csv").is_file():
        draw(options.out, tables)
    told = left_out(RULES, verdicts, options.quick)
    print("\n".join([text, *told, f"wrote {options.out / 'choose.md'}"]))
    return int(not options.quick and any(verdict.denied for verdict in verdicts))


if __name__ == "__main__":
    raise SystemExit(main())
