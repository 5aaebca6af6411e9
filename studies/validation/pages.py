"""What the folders of `studies.validation` share: scenes with a fabric, curves, pages, figures."""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fecloth as fc
from fecloth.output.atomic_files import replace_file
from fecloth.scene.scene import Scene, load_scene, scene_of
from fecloth.study.figures import COLOURS, new_figure
from fecloth.study.result import Row, markdown_table
from studies import harness
from studies.validation.comparison import COVERS, Comparison, table, write_comparisons

DATA = Path(__file__).parent / "data"
ABOUT_TOTAL = """\
Predictions have their own uncertainty, differences the total, as [all pages of
validation](../README.md) say. `comparison.csv` has the parts, and what was fitted or only shown."""


def parse_arguments(about: str | None, folder: str) -> argparse.Namespace:
    """The options of `studies.harness`; by default the results go to out/validation/FOLDER."""
    options = harness.parse_arguments(about or "")
    if options.out == Path("out") / folder:
        options.out = Path("out") / "validation" / folder
    return options


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """The columns of a file of measurements by their names, in the units of the file."""
    with path.open(encoding="utf-8") as stream:
        rows = csv.reader(line for line in stream if not line.startswith("#"))
        names = next(rows)
        values = np.array([[float(cell) for cell in row] for row in rows])
    return dict(zip(names, values.T, strict=True))


def scene_with(path: Path, keys: Sequence[str] = (), **tables: Any) -> Scene:
    """The scene of a file with other keys, and whole tables replaced, as `fabric`."""
    return scene_of(load_scene(path, keys).to_tables() | tables)


def quietly(function: Any, *given: Any, **more: Any) -> Any:
    """Call a function of fecloth without its lines of progress."""
    with contextlib.redirect_stderr(io.StringIO()), warnings.catch_warnings(action="ignore"):
        return function(*given, **more)


def budget(scene: Scene, quantity: Any, measured: Mapping[str, tuple[float, float]]) -> fc.Budget:
    """`fc.budget` of the scene with the uncertainty that its fabric carries."""
    return quietly(fc.budget, scene, measured=measured, quantity=quantity)


@dataclass(frozen=True)
class Panel:
    """A panel of a figure: measured points with their scatter, and a predicted band."""

    title: str
    x: str  # labels
    y: str
    measured: Sequence[tuple[np.ndarray, np.ndarray, Any]]  # x, y, standard uncertainty or None
    at: np.ndarray | None = None  # places of the predicted curve
    value: np.ndarray | None = None
    u: np.ndarray | float | None = None  # its own standard uncertainty; None for no band
    words: str = "predicted ± 2 u"
    lines: Sequence[tuple[str, np.ndarray, np.ndarray]] = ()  # further curves


def draw(path: Path, panels: Sequence[Panel], columns: int = 2) -> None:
    """Write a PNG with a panel each."""
    count = -(-len(panels) // columns)
    drawing, axes = new_figure(count, columns, (4.6 * columns, 3.5 * count), squeeze=False)
    for ax, panel in zip(axes.flat, panels, strict=False):
        _draw(ax, panel)
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    drawing.savefig(path, dpi=90 if columns < 4 else 70)


def _draw(ax: Any, panel: Panel) -> None:
    for i, (x, y, u) in enumerate(panel.measured):
        look: dict[str, Any] = {"color": COLOURS[0], "ms": 3, "zorder": 2}
        label = "measured ± 2 u" if i == 0 else None
        if u is None:
            ax.plot(x, y, ".", label=label and "measured", **look)
        else:
            ax.errorbar(x, y, COVERS * u, fmt=".", elinewidth=0.5, label=label, **look)
    if panel.at is not None and panel.value is not None:
        ax.plot(panel.at, panel.value, color=COLOURS[1], label=panel.words, zorder=3)
        if panel.u is not None:
            half = COVERS * panel.u
            low, high = panel.value - half, panel.value + half
            ax.fill_between(panel.at, low, high, color=COLOURS[1], alpha=0.25, lw=0)
    for i, (words, x, y) in enumerate(panel.lines, 2):
        ax.plot(x, y, color=COLOURS[i], ls="--", label=words)
    ax.set(xlabel=panel.x, ylabel=panel.y)
    ax.set_title(panel.title, loc="left")
    ax.legend(fontsize=8)


def write_page(
    options: argparse.Namespace,
    about: str | None,
    findings: Sequence[harness.Finding],
    comparisons: Sequence[Comparison],
    *,
    sections: Sequence[str],
    tables: Mapping[str, Sequence[Row]] | None = None,
    figure: str = "",
) -> int:
    """Write README.md, comparison.csv and the report; return the exit status of the study.

    `about` is the docstring of the study: a question, what is done, and the command. The sections
    follow it, then the figure, the table of comparisons, and further tables.
    """
    question, _, rest = (about or "").strip().partition("\n")
    what, _, command = rest.strip().rpartition("\n\n")
    parts = [f"# {question}", what, f"`{command.strip()}`", *sections[:1]]
    parts += ["## Predicted and measured", f"![measured and predicted]({figure})" if figure else ""]
    parts += [ABOUT_TOTAL, markdown_table(table(comparisons)), *sections[1:]]
    for heading, rows in (tables or {}).items():
        parts += [f"## {heading}", markdown_table(rows)]
    parts += ["## Findings", "\n".join(f"- {each}" for each in findings)]
    replace_file(options.out / "README.md", ("\n\n".join(filter(None, parts)) + "\n").encode())
    write_comparisons(options.out, comparisons)
    rows = [each.row() for each in comparisons]
    return harness.write_report(options, question, rows, findings=findings)
