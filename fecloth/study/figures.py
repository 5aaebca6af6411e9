"""One style for all figures: legible at 800 pixels, lines differ in colour and marker."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fecloth.view.charts import COLOURS

if TYPE_CHECKING:
    import matplotlib.figure

Figure: TypeAlias = "matplotlib.figure.Figure"  # imported when a figure is drawn: it takes 0.5 s

STYLE = Path(__file__).with_name("figures.mplstyle")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "h")
DASHES = ("-", "--", "-.", ":")
LABEL_DISTANCE = 0.062  # of two labels, over the height of the axes: a line of text
COLUMNS = 3  # panels side by side that are legible at 800 pixels
MOST_GROUPS = 8  # methods or settings that a reader can tell apart in a figure


def new_figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (8.0, 5.0), **subplots: Any
) -> tuple:
    """Return a figure and its axes in this style, without pyplot: the user's backend stays."""
    from matplotlib import figure, rc_context

    with rc_context(fname=STYLE):
        drawing = figure.Figure(figsize=size, layout="constrained")
        return drawing, drawing.subplots(rows, columns, **subplots)


def use_plain_ticks(ax) -> None:
    """Label each logarithmic axis of less than two decades with plain numbers, such as 0.3.

    An axis of another kind, or a longer one, keeps its labels.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        if axis.get_scale() != "log" or high / low >= 100:
            continue
        digits: list[float]  # of the labels, times powers of ten: fewer on a longer axis
        if high / low > 15:
            digits = [1, 3]
        elif high / low > 3:
            digits = [1, 2, 5]
        else:
            digits = [1, 1.5, 2, 2.5, 3, 4, 5, 7]
        axis.set_major_locator(LogLocator(subs=digits))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def labelled(name: str, unit: str) -> str:
    """Return the label of an axis, with the unit if there is one."""
    return f"{name} [{unit}]" if unit else name


def line_style(i: int) -> dict[str, object]:
    """Return colour, marker and dashes of line `i`; the first 77 lines all differ."""
    dash = DASHES[i // len(COLOURS) % len(DASHES)]
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "ls": dash}


def mark_failures(ax, rows: Sequence[Mapping], x: str, colour: str = "black") -> None:
    """Draw a cross with the status at the upper border for each row that failed.

    `x` is the column that has the place of the cross; rows without it are left out.
    """
    for row in rows:
        if row["status"] == "ok" or x not in row:
            continue
        at_border = {"transform": ax.get_xaxis_transform(), "clip_on": False}
        ax.plot([row[x]], [0.985], "x", color=colour, ms=8, mew=2, **at_border)
        text = {"rotation": 90, "ha": "center", "va": "top", "fontsize": 8, "color": colour}
        ax.text(row[x], 0.955, row["status"], **text, **at_border)


def label_ends(ax, ends: Sequence[tuple]) -> None:
    """Label lines in the right margin, each with a thin line from the label to the line's end.

    Labels that would overlap are moved apart. `ends` are the name, the colour, x and y of the
    end of each line.
    """
    to_axes = ax.transAxes.inverted().transform
    # from the units of the data, over pixels, to parts of the height of the axes
    heights = [to_axes(ax.transData.transform((x, y)))[1] for _, _, x, y in ends]
    heights = spread(heights, LABEL_DISTANCE)
    for (name, colour, x, y), height in zip(ends, heights, strict=True):
        arrow = {"arrowstyle": "-", "color": colour, "lw": 0.7, "alpha": 0.6, "relpos": (0, 0.5)}
        ax.annotate(
            name,
            xy=(x, y),
            xytext=(1.02, height),
            textcoords="axes fraction",
            va="center",
            color=colour,
            fontsize=10,
            arrowprops=arrow,
            annotation_clip=False,
        )


def remove_overlaps(texts: Sequence[Any]) -> None:
    """Remove the texts of a figure that would cover an earlier one of them."""
    boxes: list[Any] = []
    if texts:
        texts[0].figure.draw_without_rendering()  # which places all that the figure has
    for text in texts:
        box = text.get_window_extent()
        if any(box.overlaps(other) for other in boxes):
            text.remove()
        else:
            boxes.append(box)


def spread(heights: Sequence[float], gap: float) -> list[float]:
    """Return heights in [0, 1] near the given ones, in the same order, at least `gap` apart.

    If too many do not fit, the lowest ones are below 0.
    """
    order = np.argsort(heights, kind="stable")
    y = np.clip(np.array(heights, dtype=float)[order], 0.0, 1.0)
    for i in range(1, len(y)):  # from the lowest one up: push the next one up
        y[i] = max(y[i], y[i - 1] + gap)
    y[-1] = min(y[-1], 1.0)
    for i in range(len(y) - 1, 0, -1):  # and back, so that the highest one is at most 1
        y[i - 1] = min(y[i - 1], y[i] - gap)
    heights_apart = np.empty_like(y)
    heights_apart[order] = y
    return heights_apart.tolist()
