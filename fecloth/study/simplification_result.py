"""The result of `simplify`: what a problem does not need, in words, as a table and as a figure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.result import Row, StudyResult, in_percent
from fecloth.study.status import OK
from fecloth.study.term_variants import Variant
from fecloth.system.system import System
from fecloth.terms import BendingFriction
from fecloth.terms.traits import traits_of

# Friction may be left out where the curvature that it holds, HB/B, is below this part of the
# curvature of the cloth.
WEAK_FRICTION = 0.1
NOISE = 0.05  # differences of seconds below this part of them are noise
SIZES = {"h": ("mesh", "m"), "dt": ("time step", "s"), "rtol": ("tolerance of the steps", "1/s")}
KEPT = ("needed", "by chance")  # verdicts on what the problem keeps
LEAST_CHANGE_SHOWN = 1e-5  # %, where the logarithmic axis of changes begins


@dataclass(frozen=True)
class Trial:
    """The run of a variant beside the run of the problem itself.

    Attributes
    ----------
    variant
        The variant, or several of them joined.
    changes
        Relative change of each quantity, by its text; none if the run failed.
    row
        Its cells in the table, beside name and verdict.
    verdict
        What the table says of it.
    """

    variant: Variant
    changes: Mapping[str, float]
    row: Row
    verdict: str = ""

    @property
    def change(self) -> float:
        """The largest change; infinite for a failure."""
        return max(self.changes.values(), default=math.inf)

    @property
    def saved(self) -> float:
        """The part of the seconds that it saves; 0 for a failure."""
        return self.row.get("saved [%]", 0.0) / 100

    @property
    def saving_per_change(self) -> float:
        """The part of the seconds that it saves, over the change."""
        return self.saved / max(self.change, np.finfo(float).eps)

    def cells(self) -> Row:
        """Return its row of the table."""
        return {"variant": self.variant.name, "verdict": self.verdict, **self.row}

    def is_worth(self, variant: Variant, tolerance: float, seconds: float) -> bool:
        """Whether a variant may be taken, by this run with it; without it the run takes `seconds`.

        All changes have to be within the tolerance. To leave out a term may save nothing; any
        other variant has to save seconds.
        """
        most = seconds * (1 + NOISE if variant.kind == "without" else 1 - NOISE)
        return self.change <= tolerance and self.row["cpu_seconds"] <= most

    def __str__(self) -> str:
        """Say which quantity changes most, and by how much; of a failure, its status."""
        if not self.changes:
            return self.row["status"]
        quantity = max(self.changes, key=lambda text: self.changes[text])
        return f"changes {quantity} by {in_percent(self.change)}"


@dataclass(frozen=True)
class Resolution:
    """Whether a problem is resolved in a size.

    Attributes
    ----------
    kind
        The size: "h", "dt" or "rtol".
    is_resolved
        Whether its error is known and within the tolerance.
    words
        How large the error is, and which size would do.
    """

    kind: str
    is_resolved: bool
    words: str


def resolution_of(
    check: Trial, size: float, orders: Mapping[str, float], tolerance: float
) -> Resolution:
    """Return whether a problem is resolved in a size, by the run in which it is refined.

    A refinement by r that changes a quantity by c shows the error c/(1 − r^−p) for the order p
    (Richardson 1911); the size for the tolerance t is the present size times (t/error)^(1/p).
    The quantity that needs the smallest size counts. `orders` are the orders of the quantities.
    """
    kind = check.variant.kind
    what, unit = SIZES[kind]
    if not check.changes:
        words = f"whether the {what} is resolved is not known: {check.variant.name}: "
        return Resolution(kind, is_resolved=False, words=words + check.row["cause"])
    errors = {}  # error by the size that would do
    for quantity, change in check.changes.items():
        order = orders[quantity]
        error = change / (1 - check.variant.by**order)  # the size was multiplied by `by` = 1/r
        needed = size * (tolerance / error) ** (1 / order) if error else math.inf
        errors[needed] = f"the error of the {what} is about {in_percent(error)} ({quantity})"
    needed = min(errors)
    if needed >= size:
        return Resolution(kind, is_resolved=True, words=errors[needed])
    would_do = f"{kind} of about {needed:.2g} {unit} in place of {size:g} {unit} would do"
    words = f"not resolved to {in_percent(tolerance)}: {errors[needed]}; {would_do}"
    return Resolution(kind, is_resolved=False, words=words)


def judge(
    trials: Sequence[Trial], resolutions: Sequence[Resolution], tolerance: float
) -> list[Trial]:
    """Return the trials with their verdicts, the smallest change first.

    A refinement says whether its size is resolved. Another variant is "needed" if the problem
    needs what it changes: it fails, or changes a quantity by more than the tolerance. A small
    change by a larger size is "by chance" where the problem itself is not resolved, or where a
    smaller factor changes more than the tolerance.
    """
    unresolved = [resolution.kind for resolution in resolutions if not resolution.is_resolved]

    def verdict_on(trial: Trial) -> str:
        kind, by = trial.variant.kind, trial.variant.by
        if trial.variant.is_check:
            return "not resolved" if kind in unresolved else "resolved"
        if trial.change > tolerance:
            return "needed"
        if kind in SIZES:
            smaller = [t for t in trials if t.variant.kind == kind and t.variant.by < by]
            if kind in unresolved or any(t.change > tolerance for t in smaller):
                return "by chance"
        seconds_as_is = trial.row["cpu_seconds"] + trial.row["seconds saved"]
        if trial.is_worth(trial.variant, tolerance, seconds_as_is):
            return "not needed"
        return "not needed, saves nothing"

    judged = [replace(trial, verdict=verdict_on(trial)) for trial in trials]
    return sorted(judged, key=attrgetter("change"))


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
        rows = [row for row in self.table if not str(row["verdict"]).startswith("combined")]
        drawing, ax = new_figure(1, 1, (11.0, 2.0 + 0.36 * len(rows)))
        left = LEAST_CHANGE_SHOWN  # a logarithmic axis has no 0, where bars could begin
        colours = {"resolved": "0.6", "not resolved": "0.6", **dict.fromkeys(KEPT, COLOURS[1])}
        for i, row in enumerate(rows):
            change: Any = row.get("change [%]") or 0.0
            colour = colours.get(str(row["verdict"]), COLOURS[0])
            ax.barh(i, max(change - left, 0.0), left=left, color=colour)
            words = row["status"]
            if words == OK:
                words = f"saves {row['seconds saved']:.2g} s ({row['saved [%]']:.0f} %)"
            ax.text(1.02, i, words, va="center", transform=ax.get_yaxis_transform())
        ax.axvline(100 * self.tolerance, color="k", ls="--", label="tolerance")
        ax.set(xscale="log", ylim=(-0.6, len(rows) - 0.4))
        ax.set_xlim(left=left)
        ax.set(xlabel="change of the quantities of interest [%]")
        ax.set_yticks(range(len(rows)), [str(row["variant"]) for row in rows])
        ax.grid(False, axis="y")
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))
        words = f"Blue can go at {in_percent(self.tolerance)}, orange is needed, grey are checks"
        drawing.suptitle(f"{self.title}\n{words} of the scene itself", fontsize=12)
        return drawing


def describe_trials(trials: Sequence[Trial]) -> list[str]:
    """Say in lines which terms are needed, and what can be cheaper, by the verdicts."""
    groups: dict[str, list[str]] = {
        "not needed": [],
        "can be cheaper": [],
        "needed": [],
        "changes too much": [],
    }
    for trial in trials:
        variant = trial.variant
        is_kept = trial.verdict in KEPT
        part = in_percent(max(trial.saved, 0.0))
        if variant.kind == "without" and is_kept:
            groups["needed"].append(variant.by)
        elif variant.kind == "without":
            words = f"{variant.by} ({trial}, costs {part} of the seconds)"
            groups["not needed"].append(words)
        elif is_kept:
            groups["changes too much"].append(f"{variant.name} ({trial})")
        elif trial.verdict == "not needed":
            groups["can be cheaper"].append(f"{variant.name} ({trial}, saves {part})")
    groups["not needed"] = groups["not needed"] or ["none of the terms"]
    return [f"{heading}: {', '.join(items)}" for heading, items in groups.items() if items]


def describe_reduced(final: Trial | None, parts: str, file: str) -> str:
    """Say what the reduced problem changes and saves.

    `final` is its run, None if nothing simpler was found; `parts` are the names of its variants,
    and `file` is the name of its file.
    """
    if final is None:
        return "nothing simpler was found"
    if not final.changes:
        return f"{file} fails: {final.row['cause']}"
    verb = "saves" if final.saved >= 0 else "adds"
    return f"{file}: {parts}; it {final} and {verb} {in_percent(abs(final.saved))} of the seconds"


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
