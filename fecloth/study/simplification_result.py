"""The result of `simplify`: what a problem does not need, in words, as a table and as a figure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.result import StudyResult, in_percent
from fecloth.study.runs import Row
from fecloth.study.term_variants import Variant
from fecloth.system.system import System
from fecloth.terms import BendingFriction
from fecloth.terms.traits import traits_of

# Friction may be left out where the curvature that it holds, HB/B, is below this part of the
# curvature of the cloth.
WEAK_FRICTION = 0.1
LEAST_CHANGE_SHOWN = 1e-5  # %, where the logarithmic axis begins
KEPT = ("needed", "by chance")  # verdicts on what the problem keeps
# Verdicts, and the headings of terms that are left out and of other variants with them.
HEADINGS = (
    (("not needed",), "not needed", "can be cheaper"),
    (KEPT, "needed", "changes too much"),
)


@dataclass(frozen=True)
class Trial:
    """The run of a variant beside the run of the problem itself.

    Attributes
    ----------
    variant
        The variant, or several of them joined.
    changes
        Relative change of each quantity, by its text; none if the run failed.
    cells
        Its cells in the table, beside name and verdict.
    words
        What it changes and saves, or the cause of its failure.
    verdict
        What the table says of it.
    """

    variant: Variant
    changes: Mapping[str, float]
    cells: Row
    words: str
    verdict: str = ""

    @property
    def change(self) -> float:
        """The largest change; infinite for a failure."""
        return max(self.changes.values(), default=math.inf)

    @property
    def saved(self) -> float:
        """The part of the seconds that it saves; 0 for a failure."""
        return self.cells.get("saved [%]", 0.0) / 100

    @property
    def saving_per_change(self) -> float:
        """The part of the seconds that it saves, over the change."""
        return self.saved / max(self.change, np.finfo(float).eps)

    @property
    def row(self) -> Row:
        """Its row of the table."""
        row: dict = {"variant": self.variant.name, "verdict": self.verdict}
        if self.changes:
            row["change [%]"] = 100 * self.change
        return row | self.cells


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
        """Return a bar chart of the change by each variant.

        The axis of changes is logarithmic, and a dashed line marks the tolerance. Combinations
        are left out; the reduced scene is shown.
        """
        rows = [row for row in self.table if not str(row["verdict"]).startswith("combined")]
        drawing, ax = new_figure(1, 1, (11.0, 2.0 + 0.36 * len(rows)))
        colours = {"resolved": "0.6", "not resolved": "0.6", **dict.fromkeys(KEPT, COLOURS[1])}
        changes: list[Any] = [row.get("change [%]") or 0.0 for row in rows]
        ax.barh(
            range(len(rows)),
            changes,
            color=[colours.get(str(row["verdict"]), COLOURS[0]) for row in rows],
            tick_label=[str(row["variant"]) for row in rows],
        )
        ax.axvline(100 * self.tolerance, color="k", ls="--", label="tolerance")
        ax.set(xscale="log", xlabel="change of the quantities of interest [%]")
        ax.set_xlim(left=LEAST_CHANGE_SHOWN)
        ax.grid(False, axis="y")
        ax.legend()
        words = "Blue can go, orange is needed, grey are checks of the scene itself"
        ax.set_title(f"{self.title}\n{words}")
        return drawing


def describe_trials(trials: Sequence[Trial], tolerance: float) -> list[str]:
    """Say in lines what is not resolved, which terms are needed, and what can be cheaper."""
    lines = [
        f"not resolved to {in_percent(tolerance)}: {trial.words}"
        for trial in trials
        if trial.verdict == "not resolved"
    ]
    for verdicts, of_terms, of_others in HEADINGS:
        judged = [trial for trial in trials if trial.verdict in verdicts]
        terms = [t for t in judged if t.variant.kind == "without"]
        others = [t for t in judged if t.variant.kind != "without"]
        if terms:
            names = [f"{t.variant.by} ({t.words})" for t in terms]
            lines.append(f"{of_terms}: {', '.join(names)}")
        if others:
            names = [f"{t.variant.name} ({t.words})" for t in others]
            lines.append(f"{of_others}: {', '.join(names)}")
    return lines


def describe_weak_friction(system: System, ends: Mapping[str, Sequence[float]]) -> str:
    """Return the sentence that friction inside the fabric may be left out; "" if it may not.

    It may if the curvature that it holds, HB/B, is below a tenth of the mean curvature of the
    cloth at the end of a run. HB/B is the largest of all fabrics, along warp or weft. `ends` are
    the first and last values of the columns of the run, by name.
    """
    if not any(isinstance(term, BendingFriction) for term in system.terms):
        return ""
    held_curvature = 0.0
    for fabric in system.panel.fabrics:
        pairs = zip(fabric.hysteresis or (), fabric.bending or (), strict=False)
        # HB is half of the hysteresis, the distance of both branches of the bending moment
        held_curvature = max([held_curvature, *(h / (2 * rigidity) for h, rigidity in pairs)])
    terms = zip(system.names, system.terms, strict=True)
    energy = sum(ends[name][-1] for name, term in terms if traits_of(term).kind == "bending")
    rigidity = system.panel.each(lambda fabric: np.mean(fabric.bending or 0.0))[:, 0]
    total = float(rigidity @ system.cloth.weights.sum(axis=1))  # ∫ B dA
    curvature = math.sqrt(2 * energy / total) if total else 0.0  # by W = ½ B κ² per area
    if held_curvature >= WEAK_FRICTION * curvature:
        return ""
    return (
        f"BendingFriction may be left out: HB/B = {held_curvature:.3g}/m is below a tenth "
        f"of the curvature, {curvature:.3g}/m"
    )
