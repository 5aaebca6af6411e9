"""The figure of a stability map: a panel for each method, runs over key and step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fecloth.study.figures import new_figure
from fecloth.study.stability_words import JUDGED, WRONG
from fecloth.study.status import FAILED, OK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PANELS = 8
LOOKS: dict[str, dict[str, Any]] = {
    OK: {"marker": "o", "color": "#0072B2"},
    WRONG: {"marker": "^", "color": "#E69F00"},
    FAILED: {"marker": "X", "color": "#D55E00"},
    "stopped": {"marker": "s", "color": "0.6", "mfc": "none"},
}
LIMIT: dict[str, Any] = {"color": "black", "lw": 2}
COLUMNS = 4


def draw_map(found: Any) -> Figure:
    """Draw the runs of a `StabilityMap`; the line is the predicted limit of explicit methods."""
    methods = found.methods[:MOST_PANELS]
    columns = min(COLUMNS, len(methods))
    rows = math.ceil(len(methods) / columns)
    drawing, axes = new_figure(rows, columns, (max(2.9 * columns, 6.0), 3.1 * rows + 1.1))
    panels = np.atleast_1d(axes).ravel()
    places = _places(found)
    steps = [cell["dt"] for cell in found.cells]
    for i, (ax, method) in enumerate(zip(panels, methods, strict=False)):
        own = [cell for cell in found.cells if cell["method"] == method]
        _draw_runs(ax, own, [_place(cell, found.keys, places) for cell in own])
        ax.set_title(method.replace("_", " "), fontsize=11)
        ax.set(yscale="log", ylim=(min(steps) / 1.5, max(steps) * 1.5))
        _set_places(ax, found.keys, places, labelled=i + columns >= len(methods))
        if i % columns:
            ax.set_yticklabels([])
    for ax in panels[len(methods) :]:
        ax.set_axis_off()
    drawing.supylabel("time step [s]")
    if found.keys:
        drawing.supxlabel(", ".join(found.keys))
    _draw_legend(drawing, [cell for cell in found.cells if cell["method"] in methods])
    return drawing


def _places(found: Any) -> list:
    """Return the values of the only key if they are numbers above 0, else the combinations."""
    values: list = []
    for cell in found.cells:
        one = tuple(cell[key] for key in found.keys)
        values += [] if one in values else [one]
    numbers = len(found.keys) == 1 and all(
        isinstance(one, int | float) and one > 0 for (one,) in values
    )
    return sorted(one for (one,) in values) if numbers else values


def _place(cell: Mapping, keys: Sequence[str], places: list) -> float:
    """Return where a run stands: at the value of the key, or at the number of its combination."""
    values = tuple(cell[key] for key in keys)
    return places.index(values) if values in places else float(values[0])


def _draw_runs(ax, cells: Sequence[Mapping], x: Sequence[float]) -> None:
    """Draw a marker for each run, and the predicted limit over the values."""
    for state, look in LOOKS.items():
        at = [
            (place, cell["dt"])
            for place, cell in zip(x, cells, strict=True)
            if (cell["status"] if cell["status"] in JUDGED else "stopped") == state
        ]
        ax.plot(*zip(*at, strict=True) if at else ((), ()), ls="", ms=7, **look)
    limits = {
        place: cell["predicted"]
        for place, cell in zip(x, cells, strict=True)
        if cell["predicted"] and math.isfinite(cell["predicted"])
    }
    if len(limits) == 1:
        ax.axhline(next(iter(limits.values())), **LIMIT)
    elif limits:
        ax.plot(sorted(limits), [limits[place] for place in sorted(limits)], **LIMIT)


def _set_places(ax, keys: Sequence[str], places: list, labelled: bool) -> None:
    """Set the axis of the values: logarithmic over a factor of ten, or named combinations."""
    if places and not isinstance(places[0], tuple):
        if places[-1] >= 10 * places[0]:
            ax.set(xscale="log", xlim=(places[0] / 1.5, places[-1] * 1.5))
        if not labelled:
            ax.set_xticklabels([])
        return
    names = [", ".join(str(one) for one in values) for values in places]
    turned = {"rotation": 30, "ha": "right"} if max(map(len, names), default=0) > 6 else {}
    ax.set_xticks(range(len(places)), names if labelled and keys else [""] * len(places), **turned)
    ax.set_xlim(-0.6, len(places) - 0.4)


def _draw_legend(drawing, cells: Sequence[Mapping]) -> None:
    """Draw the legend of what occurs above the panels."""
    from matplotlib.lines import Line2D

    states = {cell["status"] if cell["status"] in JUDGED else "stopped" for cell in cells}
    looks = [{"label": s, "ls": "", "ms": 7, **look} for s, look in LOOKS.items() if s in states]
    if any(cell["predicted"] and math.isfinite(cell["predicted"]) for cell in cells):
        looks.append({"label": "predicted limit", **LIMIT})
    lines = [Line2D([], [], **look) for look in looks]
    drawing.legend(handles=lines, loc="outside upper center", ncols=len(lines), frameon=False)
