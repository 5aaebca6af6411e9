"""The result of `fit`: constants with intervals, the curves, and the fabric that carries them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fecloth import errors
from fecloth.output.atomic_files import replace_file
from fecloth.scene.toml_text import to_toml
from fecloth.study.figures import COLOURS, Figure, new_figure
from fecloth.study.reports import write_csv
from fecloth.study.result import StudyResult, Table

Interval = tuple[float, float]
EMPTY = Table(())
COLUMNS = 3  # of panels of the figure


@dataclass(frozen=True, eq=False, repr=False)
class Fit(StudyResult):
    """What `fit` found: the table has a row for each constant."""

    values: Mapping[str, float] = field(default_factory=dict)  # name → constant [SI]
    # name → ends of the 95 % interval; NaN where the data do not tell it or the law is wrong
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # of values, [SI²]
    identified: tuple[str, ...] = ()  # names of the constants that the data tell
    misfit: float = np.nan  # reduced χ²: 1 if the residuals are as large as the uncertainties
    # name → shift by h/2 and dt/2 [SI]; NaN where nothing can be refined
    numerical: Mapping[str, float] = field(default_factory=dict)
    law_fails: bool = False
    offsets: Mapping[str, float] = field(default_factory=dict)  # experiment → slack [SI]
    experiments: Table = EMPTY  # a row for each measured column
    points: Table = EMPTY  # a row for each measured point
    fabric: Mapping[str, Any] = field(default_factory=dict)  # the fitted table [fabric]
    remarks: tuple[str, ...] = ()

    @property
    def resolved(self) -> bool:
        """Whether mesh and step shift each constant by less than half of its interval."""
        return not any(
            abs(shift) > (self.intervals[name][1] - self.intervals[name][0]) / 2
            for name, shift in self.numerical.items()
        )

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 if all constants are told and the law can meet the data."""
        told = len(self.identified) == len(self.values)
        return 0 if told and self.resolved and not self.law_fails else errors.MISSED

    def notes(self) -> list[str]:
        return list(self.remarks)

    def summary(self) -> str:
        return "\n".join([super().summary(), str(self.experiments), ""])

    def figure(self) -> Figure:
        """Return a panel for each measured column: points, computed curve, and residuals below."""
        rows = list(self.experiments)
        columns = min(COLUMNS, len(rows))
        count = -(-len(rows) // columns)
        drawing, axes = new_figure(
            2 * count,
            columns,
            (4.2 * columns, 4.6 * count),
            squeeze=False,
            height_ratios=[3, 1] * count,
        )
        for i, row in enumerate(rows):
            above = axes[2 * (i // columns)][i % columns]
            below = axes[2 * (i // columns) + 1][i % columns]
            own = [
                p
                for p in self.points
                if p["experiment"] == row["experiment"] and p["column"] == row["column"]
            ]
            _draw(above, below, row, own)
        for i in range(len(rows), count * columns):
            for ax in (
                axes[2 * (i // columns)][i % columns],
                axes[2 * (i // columns) + 1][i % columns],
            ):
                ax.set_axis_off()
        return drawing

    def report(self, folder: str | Path) -> Path:
        """Write fitted.toml, points.csv, report.html, results.csv and the figure."""
        folder = Path(folder)
        replace_file(folder / "fitted.toml", self.to_toml().encode())
        write_csv(list(self.points), folder / "points.csv")
        return super().report(folder)

    def describe_files(self, folder: Path, page: Path) -> str:
        return f"wrote {page}, {folder / 'points.csv'} and {folder / 'fitted.toml'}"

    def to_toml(self) -> str:
        """The fitted fabric with its uncertainty, and the constants of terms, as TOML."""
        head = [f"# {line}" for line in self.words()]
        others = {k: v for k, v in self.values.items() if not k.startswith("fabric.")}
        tables: dict[str, Any] = {"parameters": others, "fabric": dict(self.fabric)}
        return "\n".join([*head, "", to_toml(tables)])


def _draw(above: Any, below: Any, row: Mapping, points: list) -> None:
    order = sorted(points, key=lambda p: p["along"])
    x = [p["along"] for p in order]
    bars = {"yerr": [p["sigma"] for p in order], "fmt": ".", "color": COLOURS[0], "elinewidth": 0.6}
    above.errorbar(x, [p["measured"] for p in order], label="measured", **bars)
    above.plot(x, [p["computed"] for p in order], color=COLOURS[1], label="computed")
    used = "" if row["fitted"] == "yes" else " (not fitted)"
    above.set(ylabel=f"{row['column']} [{row['unit']}]" if row["unit"] else row["column"])
    above.set_title(f"{row['experiment']}{used}", loc="left")
    above.legend()
    below.plot(x, [p["residual"] for p in order], ".", color=COLOURS[0])
    below.axhline(0.0, color="k", lw=0.8)
    below.set(xlabel=row["along"], ylabel="residual / σ")
