"""The result of `tune`: the tuned setting, its error, its cost, its proof, and all runs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fecloth import errors
from fecloth.study.figures import Figure
from fecloth.study.fronts.drawing import bound_of, draw_front
from fecloth.study.result import StudyResult, Table, in_percent


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(StudyResult):
    """What `tune` found.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        A row for each setting that ran, with its error and its uncertainty; see `Front`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    error
        Relative, the largest of all quantities with its uncertainty; 0.01 is 1 %.
    seconds
        Measured CPU time of the tuned setting [s].
    proved
        Whether the error, with its uncertainty, is as asked for, and with a budget the time.
    tolerance
        The largest relative error that the caller gave, or NaN.
    budget
        The CPU time that the caller gave [s], or NaN.
    quantities
        Texts of the quantities.
    parts
        The error by its cause, as far as it exists: "mesh, step and solver" is the distance to
        the limit, "limit" the uncertainty of the limit, "model" (changed terms) and "gap".
    settings
        The tuned setting in words: element, pattern, h [m], method, dt [s] or rtol [1/s].
    text
        The tuned scene as TOML; for a function a list of its terms and sizes.
    scene
        Path of tuned.toml in the folder that was given, or None.
    search_seconds
        CPU time of the search with its set-up [s].
    """

    error: float = math.nan
    seconds: float = math.nan
    proved: bool = False
    tolerance: float = math.nan
    budget: float = math.nan
    quantities: tuple[str, ...] = ()
    parts: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""
    scene: Path | None = None
    search_seconds: float = math.nan

    def notes(self) -> list[str]:
        """Return sentences on the parts of the error, on the CPU time, and the remarks."""
        lines = []
        if self.parts:
            parts = ", ".join(f"{name} {in_percent(size)}" for name, size in self.parts.items())
            lines.append(f"Estimated parts of the error: {parts}.")
        cost = f"CPU time: {self.seconds:.2g} s; the search took {self.search_seconds:.2g} s."
        return [*lines, cost, *self.remarks]

    def summary(self) -> str:
        """What the command prints: the verdict, the notes, and the settings that none beats."""
        rows = [row for row in self.table if row.get("on front")]
        if not rows:  # no setting has a known error
            return "\n".join(self.words())
        count = f"These are {len(rows)} of {len(self.table)} settings; the report has all."
        return "\n".join([*self.words(), "", str(Table(tuple(rows))), "", count])

    @property
    def scene_file(self) -> tuple[str, str]:
        """Name and text of the tuned scene; a function has none."""
        return "tuned.toml", self.text

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 if the setting is proved, else 1."""
        return 0 if self.proved else errors.MISSED

    def figure(self) -> Figure:
        """Return the errors of the runs over their CPU seconds, with a ring at the tuned run.

        A dashed line marks the tolerance or the budget.
        """
        drawing = draw_front(self.table, self.title, ", ".join(self.quantities), unit="")
        (ax,) = drawing.axes
        rows: Any = self.table
        tuned = [row for row in rows if row.get("tuned") and row.get("at most %")]
        for row in tuned:
            ax.plot(
                [row["seconds"]], [bound_of(row, " %")], "o", ms=18, mfc="none", mec="k", mew=1.6
            )
        if tuned and math.isfinite(self.tolerance):
            ax.axhline(100 * self.tolerance, color="k", ls="--", lw=1)
        if tuned and math.isfinite(self.budget):
            ax.axvline(self.budget, color="k", ls="--", lw=1)
        return drawing
