"""The figure of a stability map: the runs of each method over the varied key and the step."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from fecloth.study.figures import COLUMNS, MOST_GROUPS, Figure, new_figure
from fecloth.study.stability_runs import JUDGED, WRONG
from fecloth.study.status import FAILED, OK

LOOKS: dict[str, dict[str, Any]] = {
    OK: {"marker": "o", "color": "#0072B2"},
    WRONG: {"marker": "^", "color": "#E69F00"},
    FAILED: {"marker": "X", "color": "#D55E00"},
    "stopped": {"marker": "s", "color": "0.6", "mfc": "none"},
}
LIMIT: dict[str, Any] = {"color": "black", "lw": 2, "marker": "_", "label": "predicted limit"}


def draw_map(
    all_cells: Sequence[Mapping[str, Any]], all_methods: Sequence[str], keys: Sequence[str]
) -> Figure:
    """Draw the runs of a map: dt of each run over the values of the varied keys.

    There is a panel for each of the first eight methods. Marks show how a run ended; the line
    is the predicted limit of explicit methods.
    """
    methods = all_methods[:MOST_GROUPS]
    columns = min(COLUMNS, len(methods))
    rows = math.ceil(len(methods) / columns)
    size = max(2.9 * columns, 6.0), 3.1 * rows + 1.1
    drawing, axes = new_figure(rows, columns, size, squeeze=False, sharex=True, sharey=True)
    cells = [row for row in all_cells if row["dt"]]
    values = [tuple(row[key] for key in keys) for row in cells]
    lines: dict[str, Any] = {}  # a line of any panel, by its label
    for ax, method in zip(axes.ravel(), methods, strict=False):  # more panels may be left over
        runs = [
            (_place(v), row)
            for v, row in zip(values, cells, strict=True)
            if row["method"] == method
        ]
        lines |= _draw_runs(ax, runs)
        ax.set_title(method.replace("_", " "), fontsize=11)
    for ax in axes.ravel()[len(methods) :]:
        ax.set_axis_off()
    first_panel = axes[0, 0]  # all panels share its axes
    first_panel.set(yscale="log")
    if isinstance(_place(values[0]), float):
        first_panel.set(xscale="log")
    drawing.supylabel("time step [s]")
    drawing.supxlabel(", ".join(keys))
    drawing.legend(lines.values(), lines, loc="outside upper center", ncols=5, frameon=False)
    return drawing


def _place(values: tuple) -> float | str:
    """Return the place of a combination of values on the axis.

    It is the value of the only key, if that is a number above 0, else a text.
    """
    if len(values) == 1 and isinstance(values[0], int | float) and values[0] > 0:
        return float(values[0])
    return ", ".join(map(str, values))


def _draw_runs(ax, runs: Sequence[tuple[float | str, Mapping]]) -> dict[str, Any]:
    """Draw the runs of a method at their places, and the predicted limit.

    A limit that is not known, 0 or infinite is not drawn. Return the lines by their labels.
    """
    points = defaultdict(list)
    limits = {}
    for place, row in runs:
        label = row["status"] if row["status"] in JUDGED else "stopped"
        points[label].append((place, row["dt"]))
        if row["predicted"] and math.isfinite(row["predicted"]):
            limits[place] = row["predicted"]
    lines: dict[str, Any] = {}
    for label, look in LOOKS.items():
        if points[label]:
            (lines[label],) = ax.plot(*zip(*points[label], strict=True), ls="", ms=7, **look)
    if limits:
        (line,) = ax.plot(*zip(*limits.items(), strict=True), **LIMIT)
        lines[line.get_label()] = line
    return lines
