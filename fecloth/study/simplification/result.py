"""The result of `simplify`: what a scene does not need, in words, as a table and as a figure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.result import StudyResult, Table, in_percent
from fecloth.study.simplification.outcome import Findings, Outcome, Resolution

COMBINED = "combined"
REDUCED = "reduced scene"
LEAST, MOST = 1e-5, 300.0  # %, limits of the axis of changes
SHADES = {"needed": COLOURS[1], "by chance": COLOURS[1], "resolved": "0.6", "not resolved": "0.6"}


@dataclass(frozen=True, eq=False, repr=False)
class Simplification(StudyResult):
    """What `simplify` found: the table has a row for each variant, by its change.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        One row for each run or level; see `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    tolerance
        Largest relative change of a quantity.
    quantities
        Texts of the quantities.
    resolved
        Whether the scene's own known errors are within the tolerance.
    scene
        Path of the reduced scene in the folder that was given, or None.
    reduced
        The text of the reduced scene.
    file
        The name of its file; for a function reduced.txt, a list.
    change
        Largest change of the reduced scene.
    saved
        Part of the CPU seconds that it saves; 0 if nothing can be simpler.
    """

    tolerance: float = 0.01
    quantities: tuple[str, ...] = ()
    resolved: bool = True
    scene: Path | None = None
    reduced: str = ""
    file: str = "reduced.toml"
    change: float = 0.0
    saved: float = 0.0

    @property
    def scene_file(self) -> tuple[str, str]:
        """Name and text of the reduced scene."""
        return self.file, self.reduced

    @property
    def exit_status(self) -> int:
        """Exit status of the command: a variant that fails is an answer, too."""
        return 0

    def figure(self) -> Figure:
        """Return bars of the changes against the tolerance, with the seconds that each saves."""
        rows = [row for row in self.table if not str(row["verdict"]).startswith(COMBINED)]
        drawing, ax = new_figure(1, 1, (11.0, 2.0 + 0.36 * len(rows)))
        at = np.arange(len(rows))
        changes = [row.get("change [%]") or 0.0 for row in rows]
        shown = np.clip(np.array(changes, dtype=float), LEAST, MOST)
        colours = [SHADES.get(str(row["verdict"]), COLOURS[0]) for row in rows]
        ax.barh(at, shown - LEAST, left=LEAST, color=colours)
        ax.axvline(100 * self.tolerance, color="k", ls="--", label="tolerance")
        ax.set(xscale="log", xlim=(LEAST, MOST), ylim=(-0.6, len(rows) - 0.4))
        ax.set(xlabel="change of the quantities of interest [%]")
        names = [REDUCED if row["verdict"] == REDUCED else str(row["variant"]) for row in rows]
        ax.set_yticks(at, names)
        ax.grid(False, axis="y")
        for i, row in enumerate(rows):
            ax.text(1.02, i, _seconds(row), va="center", transform=ax.get_yaxis_transform())
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))
        words = f"Blue can go at {in_percent(self.tolerance)}, orange is needed, grey are checks"
        drawing.suptitle(f"{self.title}\n{words} of the scene itself", fontsize=12)
        return drawing


def _seconds(row: Mapping) -> str:
    if row.get("seconds saved") is None:
        return str(row["status"])
    seconds = row["seconds saved"]
    part = row["saved [%]"]
    if seconds >= 0:
        return f"saves {seconds:.2g} s ({part:.0f} %)"
    return f"takes {-seconds:.2g} s more"


def make_table(
    findings: Findings, attempts: Sequence[tuple[Outcome, bool]], final: Outcome | None
) -> Table:
    """Return a row for each variant, by its change; then the combinations and the reduced scene."""
    rows = [_row(outcome, findings.judge(v, outcome)) for v, outcome in findings.ranked]
    joint = [(outcome, fits) for outcome, fits in attempts if " + " in outcome.name]
    rows += [_row(outcome, f"{COMBINED}{'' if fits else ', not taken'}") for outcome, fits in joint]
    return Table((*rows, *([_row(final, REDUCED)] if final else [])))


def _row(outcome: Outcome, verdict: str) -> dict:
    is_ok = outcome.is_ok
    seconds = outcome.seconds
    line: dict = {"variant": outcome.name, "verdict": verdict}
    line["change [%]"] = 100 * outcome.change if is_ok else None
    line |= {f"{name} [%]": 100 * change for name, change in outcome.changes.items()}
    if is_ok:
        line |= {"seconds saved": outcome.whole - seconds, "saved [%]": 100 * outcome.saved}
        line |= {"cpu_seconds": seconds, "triangles": outcome.triangles, "steps": outcome.steps}
    line["status"] = outcome.status
    return line | ({"cause": outcome.cause.splitlines()[0]} if outcome.cause else {})


def make_verdict(
    findings: Findings, reduced: str, final: Outcome | None, file: str = "reduced.toml"
) -> str:
    """Return the answer in words: first what is not resolved, then what is not needed."""
    heads = f"not resolved to {in_percent(findings.tolerance)}", "not known whether it is resolved"
    unresolved = [each for each in findings.resolutions if not each.is_resolved]
    lines = [f"{heads[bool(each.failure)]}: {each}" for each in unresolved]
    lines += [f"{head}: {', '.join(items)}" for head, items in _groups(findings) if items]
    if final is None:
        lines.append("nothing simpler was found")
    elif not final.is_ok:
        lines.append(f"{file} fails: {final.cause}")
    else:
        saves = f"{'saves' if final.saved >= 0 else 'adds'} {in_percent(abs(final.saved))}"
        change = f"{final.of} by {in_percent(final.change)}"
        lines.append(f"{file}: {reduced}; it changes {change} and {saves} of the seconds")
    return "\n".join(lines)


def _groups(findings: Findings) -> list[tuple[str, list[str]]]:
    """Return the items of the verdict by their heading."""
    gone, cheaper, needed, larger = (list[str]() for _ in range(4))
    for variant, outcome in findings.ranked:
        if variant.is_check:
            continue
        verdict = findings.judge(variant, outcome)
        change = outcome.status
        saved = "none"
        if outcome.is_ok:
            change = f"changes {outcome.of} by {in_percent(outcome.change)}"
        if outcome.saved > 0:
            saved = in_percent(outcome.saved)
        is_kept = verdict in ("needed", "by chance")
        left_out = variant.kind == "without"
        if left_out and is_kept:
            needed.append(str(variant.by))
        elif left_out:
            gone.append(f"{variant.by} ({change}, costs {saved} of the seconds)")
        elif is_kept:
            larger.append(f"{variant.name} ({change})")
        elif verdict == "not needed" and outcome.saved > 0:
            cheaper.append(f"{variant.name} ({change}, saves {saved})")
    heads = "not needed", "can be cheaper", "needed", "changes too much"
    groups = gone or ["none of the terms"], cheaper, needed, larger
    return list(zip(heads, groups, strict=True))


def describe_resolved(resolutions: Sequence[Resolution], has_h: bool) -> list[str]:
    """Return sentences on the errors of the scene itself that are within the tolerance."""
    resolved = "; ".join(str(each) for each in resolutions if each.is_resolved)
    unknown = "Whether the mesh is resolved is not known: the scene has no cloth.h."
    return [*([f"Resolved: {resolved}."] if resolved else []), *([] if has_h else [unknown])]
