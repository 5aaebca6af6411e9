"""The result of `simplify`: what a scene does not need, and the reduced scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fecloth.output.atomic_files import replace_file
from fecloth.study.figures import COLOURS, new_figure
from fecloth.study.result import StudyResult
from fecloth.study.simplification.words import COMBINED, REDUCED
from fecloth.study.tables import Table
from fecloth.study.tolerance import in_percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAST, MOST = 1e-5, 300.0  # %, limits of the axis of changes
SHADES = {"needed": COLOURS[1], "by chance": COLOURS[1], "resolved": "0.6", "not resolved": "0.6"}


@dataclass(frozen=True, eq=False, repr=False)
class Simplification(StudyResult):
    """What `simplify` found: the table has a row for each variant, by its change.

    Attributes
    ----------
    tolerance
        Largest relative change of a quantity.
    quantities
        Texts of the quantities.
    resolved
        Whether the errors of the scene itself are within the tolerance, as far as known.
    scene
        Path of the reduced scene in the folder that was given, or None.
    reduced, file
        Its text, and the name of its file: reduced.toml; for a function reduced.txt, a list.
    change, saved
        Of the reduced scene: its largest change, and the part of the CPU seconds that it saves;
        0 if nothing can be simpler.
    numbers
        Dimensionless numbers of the scene, from which the predictions are.
    remarks
        Sentences on the errors of the scene, and on the validity of the predictions.
    """

    tolerance: float = 0.01
    quantities: tuple[str, ...] = ()
    resolved: bool = True
    scene: Path | None = None
    reduced: str = ""
    file: str = "reduced.toml"
    change: float = 0.0
    saved: float = 0.0
    numbers: Table = field(default_factory=lambda: Table(()))
    remarks: tuple[str, ...] = ()

    def notes(self) -> list[str]:
        """Sentences on the errors of the scene, the predictions and the numbers behind them."""
        values = [f"{row['number']} {row['formula']} = {row['value']:.2g}" for row in self.numbers]
        return [*self.remarks, *([f"Numbers: {'; '.join(values)}."] if values else [])]

    def report(self, folder: str | Path) -> Path:
        """Write the reduced scene, the page, results.csv and the figure; return the page's path."""
        Path(folder).mkdir(parents=True, exist_ok=True)
        replace_file(Path(folder) / self.file, self.reduced.encode())
        return super().report(folder)

    def figure(self) -> Figure:
        """Return bars of the changes against the tolerance, with the seconds that each saves."""
        rows = [row for row in self.table if not str(row["verdict"]).startswith(COMBINED)]
        drawing, ax = new_figure(1, 1, (11.0, 2.0 + 0.36 * len(rows)))
        at = np.arange(len(rows))
        shown = [min(max(_number(row, "change [%]"), LEAST), MOST) for row in rows]
        colours = [SHADES.get(str(row["verdict"]), COLOURS[0]) for row in rows]
        ax.barh(at, np.array(shown) - LEAST, left=LEAST, color=colours)
        known = [i for i, row in enumerate(rows) if "predicted [%]" in row]
        if known:
            predicted = [_number(rows[i], "predicted [%]") for i in known]
            x = np.clip(predicted, LEAST, MOST)
            ax.plot(x, known, "kD", ms=5, mfc="w", label="predicted")
        ax.axvline(100 * self.tolerance, color="k", ls="--", label="tolerance")
        ax.set(xscale="log", xlim=(LEAST, MOST), ylim=(-0.6, len(rows) - 0.4))
        ax.set(xlabel="change of the quantities of interest [%]")
        names = [REDUCED if row["verdict"] == REDUCED else str(row["variant"]) for row in rows]
        ax.set_yticks(at, names)
        ax.grid(False, axis="y")
        for i, row in enumerate(rows):
            ax.text(1.02, i, _seconds(row), va="center", transform=ax.get_yaxis_transform())
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        words = f"Blue can go at {in_percent(self.tolerance)}, orange is needed, grey are checks"
        drawing.suptitle(f"{self.title}\n{words} of the scene itself", fontsize=12)
        return drawing


def _number(row: Mapping, key: str) -> float:
    value = row.get(key)
    return 0.0 if value is None else float(value)


def _seconds(row: Mapping) -> str:
    """Return what a variant saves, in words."""
    if row.get("seconds saved") is None:
        return str(row["status"])
    seconds, part = row["seconds saved"], row["saved [%]"]
    if seconds >= 0:
        return f"saves {seconds:.2g} s ({part:.0f} %)"
    return f"takes {-seconds:.2g} s more"
