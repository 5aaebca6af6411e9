"""The result of `tune`: the tuned setting, its error, its cost, and whether these are proved."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fecloth.output.atomic_files import replace_file
from fecloth.study.figures import COLOURS, MARKERS, new_figure, use_plain_ticks
from fecloth.study.result import StudyResult
from fecloth.study.tolerance import in_percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OTHER_TERMS = "other terms"  # runs of another model, which the figure leaves out


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(StudyResult):
    """What `tune` found: the table has a row for each run, with its estimated error.

    Attributes
    ----------
    error
        Estimated relative error of the tuned setting, the largest of all quantities; 0.01 is 1 %.
    seconds, predicted
        Its measured and its predicted CPU time [s].
    proved
        Whether a run with a finer mesh or shorter steps shows that the error, or with a budget
        the time, is as asked for.
    tolerance, budget
        The largest relative error, or the CPU seconds [s], that the caller gave; the other is NaN.
    quantities
        Texts of the quantities.
    parts
        The error by its cause: "space", "time", "solver" and "model", as far as they exist.
    settings
        The tuned setting in words: element, pattern, h [m], method, dt [s] or rtol [1/s], linear.
    text
        The tuned scene as TOML; "" of a function's problem.
    scene
        Path of tuned.toml in the folder that was given, or None.
    search_seconds
        CPU time of all runs but the one that verified the tuned setting [s].
    """

    error: float = math.nan
    seconds: float = math.nan
    predicted: float = math.nan
    proved: bool = False
    tolerance: float = math.nan
    budget: float = math.nan
    quantities: tuple[str, ...] = ()
    parts: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""
    scene: Path | None = None
    search_seconds: float = math.nan
    remarks: tuple[str, ...] = ()

    def notes(self) -> list[str]:
        """Sentences on the parts of the error, the cost and what was noticed."""
        parts = ", ".join(f"{name} {in_percent(size)}" for name, size in self.parts.items())
        lines = [f"Estimated parts of the error: {parts}."] if parts else []
        known = math.isfinite(self.predicted)
        predicted = f", predicted {self.predicted:.2g} s" if known else ""
        took = f"; the search took {self.search_seconds:.2g} s"
        took = took if math.isfinite(self.search_seconds) else ""
        lines.append(f"CPU time: {self.seconds:.2g} s{predicted}{took}.")
        return [*lines, *self.remarks]

    def report(self, folder: str | Path) -> Path:
        """Write tuned.toml, report.html, results.csv and the figure; return the page's path."""
        if self.text:
            Path(folder).mkdir(parents=True, exist_ok=True)
            replace_file(Path(folder) / "tuned.toml", self.text.encode())
        return super().report(folder)

    def figure(self) -> Figure:
        """Return the estimated errors of all runs over their CPU seconds."""
        drawing, ax = new_figure(size=(10.0, 6.0))
        rows = [row for row in self.table if _is_shown(row)]
        if not rows:
            ax.text(0.5, 0.5, "The error of no run is known.", ha="center", transform=ax.transAxes)
            ax.set_axis_off()
            return drawing
        names = list(dict.fromkeys(map(_series, rows)))
        for i, name in enumerate(names):
            own = [row for row in rows if _series(row) == name]
            x, y = [row["CPU s"] for row in own], [row["error %"] for row in own]
            look = {"marker": MARKERS[i % len(MARKERS)], "color": COLOURS[i % len(COLOURS)]}
            ax.plot(x, y, ls="", label=name, alpha=0.8, **look)
        for row in rows:
            if row["run"] == "tuned":
                ring = {"marker": "o", "ms": 18, "mfc": "none", "mec": "k", "mew": 1.6, "ls": ""}
                ax.plot(row["CPU s"], row["error %"], label="tuned", **ring)
        if math.isfinite(self.tolerance):
            ax.axhline(100 * self.tolerance, color="k", ls="--", label="tolerance")
        if math.isfinite(self.budget):
            ax.axvline(self.budget, color="k", ls="--", label="budget")
        ax.set(xscale="log", yscale="log", xlabel="CPU time [s]")
        ax.set_ylabel(f"error, at most, of {', '.join(self.quantities)} [%]")
        ax.set_title(self.title, loc="left")
        use_plain_ticks(ax)
        ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
        return drawing


def _is_shown(row: Mapping[str, Any]) -> bool:
    """Whether a run has the tuned terms, and an error and seconds above 0 for logarithmic axes."""
    values = [row.get(name) or 0.0 for name in ("error %", "CPU s")]
    return row["run"] != OTHER_TERMS and all(0 < value < math.inf for value in values)


def _series(row: Mapping[str, Any]) -> str:
    """Return method and element, by which the runs differ in the figure."""
    return f"{row.get('method') or ''} {row.get('element') or ''}".strip() or "runs"
