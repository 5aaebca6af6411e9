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
LEAST_CHANGE_SHOWN = 1e-5  # %, where the logarithmic axis of changes begins
COLOURS_OF_VERDICTS = {
    "needed": COLOURS[1],
    "by chance": COLOURS[1],
    "resolved": "0.6",
    "not resolved": "0.6",
}


@dataclass(frozen=True, eq=False, repr=False)
class Simplification(StudyResult):
    """What `simplify` found.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        A row for each variant, by its change; then the combinations and the reduced scene.
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
        """Return a bar chart: the change by each variant, and in words the seconds it saves.

        The axis of changes is logarithmic, and a dashed line marks the tolerance. Combinations
        are left out; the reduced scene is shown.
        """
        rows = [row for row in self.table if not str(row["verdict"]).startswith(COMBINED)]
        drawing, ax = new_figure(1, 1, (11.0, 2.0 + 0.36 * len(rows)))
        places = np.arange(len(rows))
        changes = np.array([row.get("change [%]") or 0.0 for row in rows], dtype=float)
        left = LEAST_CHANGE_SHOWN  # a logarithmic axis has no 0, where bars could begin
        colours = [COLOURS_OF_VERDICTS.get(str(row["verdict"]), COLOURS[0]) for row in rows]
        ax.barh(places, np.maximum(changes - left, 0.0), left=left, color=colours)
        ax.axvline(100 * self.tolerance, color="k", ls="--", label="tolerance")
        ax.set(xscale="log", ylim=(-0.6, len(rows) - 0.4))
        ax.set_xlim(left=left)
        ax.set(xlabel="change of the quantities of interest [%]")
        ax.set_yticks(places, [_label(row) for row in rows])
        ax.grid(False, axis="y")
        for i, row in enumerate(rows):
            ax.text(1.02, i, _seconds(row), va="center", transform=ax.get_yaxis_transform())
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))
        words = f"Blue can go at {in_percent(self.tolerance)}, orange is needed, grey are checks"
        drawing.suptitle(f"{self.title}\n{words} of the scene itself", fontsize=12)
        return drawing


def _label(row: Mapping) -> str:
    """Return the name of a bar."""
    return REDUCED if row["verdict"] == REDUCED else str(row["variant"])


def _seconds(row: Mapping) -> str:
    """Return in words what a row saves, or its status."""
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
    """Return a row for each variant, by its change; then combinations and the reduced scene.

    `attempts` are the combinations, and whether they were taken; `final` is the reduced scene.
    """
    rows = [_row(outcome, findings.judge(v, outcome)) for v, outcome in findings.ranked]
    for outcome, is_taken in attempts:
        if " + " in outcome.name:
            rows.append(_row(outcome, COMBINED if is_taken else f"{COMBINED}, not taken"))
    if final:
        rows.append(_row(final, REDUCED))
    return Table(tuple(rows))


def _row(outcome: Outcome, verdict: str) -> dict:
    """Return the row of a run: its name, verdict, changes, seconds, size and status.

    If the run failed, it has no numbers, but the first line of the cause.
    """
    is_ok = outcome.is_ok
    row: dict = {"variant": outcome.name, "verdict": verdict}
    row["change [%]"] = 100 * outcome.change if is_ok else None
    row |= {f"{name} [%]": 100 * change for name, change in outcome.changes.items()}
    if is_ok:
        row["seconds saved"] = outcome.whole - outcome.seconds
        row["saved [%]"] = 100 * outcome.saved
        row["cpu_seconds"] = outcome.seconds
        row["triangles"] = outcome.triangles
        row["steps"] = outcome.steps
    row["status"] = outcome.status
    if outcome.cause:
        row["cause"] = outcome.cause.splitlines()[0]
    return row


def make_verdict(
    findings: Findings, reduced: str, final: Outcome | None, file: str = "reduced.toml"
) -> str:
    """Return the answer in words, as lines.

    They say what is not resolved, what is needed and what is not, and last what the reduced
    scene changes and saves. `reduced` names the variants that the reduced scene has, `final` is
    its run (None if nothing simpler was found), and `file` is the name of its file.
    """
    lines = []
    for resolution in findings.resolutions:
        if resolution.failure:
            lines.append(f"not known whether it is resolved: {resolution}")
        elif not resolution.is_resolved:
            lines.append(f"not resolved to {in_percent(findings.tolerance)}: {resolution}")
    for heading, items in _groups_of_variants(findings):
        if items:
            lines.append(f"{heading}: {', '.join(items)}")
    if final is None:
        lines.append("nothing simpler was found")
    elif not final.is_ok:
        lines.append(f"{file} fails: {final.cause}")
    else:
        verb = "saves" if final.saved >= 0 else "adds"
        saving = f"{verb} {in_percent(abs(final.saved))}"
        change = f"{final.of} by {in_percent(final.change)}"
        lines.append(f"{file}: {reduced}; it changes {change} and {saving} of the seconds")
    return "\n".join(lines)


def _groups_of_variants(findings: Findings) -> list[tuple[str, list[str]]]:
    """Return the variants of the verdict in words, as pairs of a heading and its items.

    Refinements are left out. So are replacements that change little but save no time.
    """
    not_needed = list[str]()
    cheaper = list[str]()
    needed = list[str]()
    too_large = list[str]()
    for variant, outcome in findings.ranked:
        if variant.is_check:
            continue
        verdict = findings.judge(variant, outcome)
        is_kept = verdict in ("needed", "by chance")
        if variant.kind == "without":
            if is_kept:
                needed.append(str(variant.by))
            else:
                costs = f"costs {_describe_saving(outcome)} of the seconds"
                not_needed.append(f"{variant.by} ({_describe_change(outcome)}, {costs})")
        elif is_kept:
            too_large.append(f"{variant.name} ({_describe_change(outcome)})")
        elif verdict == "not needed" and outcome.saved > 0:
            saving = f"saves {_describe_saving(outcome)}"
            cheaper.append(f"{variant.name} ({_describe_change(outcome)}, {saving})")
    return [
        ("not needed", not_needed or ["none of the terms"]),
        ("can be cheaper", cheaper),
        ("needed", needed),
        ("changes too much", too_large),
    ]


def _describe_change(outcome: Outcome) -> str:
    """Return in words the largest change, or the status of a failure."""
    if outcome.is_ok:
        return f"changes {outcome.of} by {in_percent(outcome.change)}"
    return outcome.status


def _describe_saving(outcome: Outcome) -> str:
    """Return in words the part of the seconds that is saved."""
    return in_percent(outcome.saved) if outcome.saved > 0 else "none"


def describe_resolved(resolutions: Sequence[Resolution], has_h: bool) -> list[str]:
    """Return sentences on the errors of the scene itself that are within the tolerance.

    A scene without h (`has_h` is false) has no refined mesh, and a sentence says so.
    """
    sentences = []
    resolved = "; ".join(str(size) for size in resolutions if size.is_resolved)
    if resolved:
        sentences.append(f"Resolved: {resolved}.")
    if not has_h:
        unknown = "Whether the mesh is resolved is not known: the scene has no cloth.h."
        sentences.append(unknown)
    return sentences
