"""One style for all figures: legible at 800 pixels, lines differ in colour and marker."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    import matplotlib.figure

Figure: TypeAlias = "matplotlib.figure.Figure"  # imported when a figure is drawn: it takes 0.5 s

# Okabe and Ito (2008): colours that colour-blind readers can tell apart, without yellow, which
# is too light for a line on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "h")
DASHES = ("-", "--", "-.", ":")
GAP = 0.062  # between two labels, as a fraction of the axes
STYLE = Path(__file__).with_name("figures.mplstyle")


def new_figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (8.0, 5.0), **subplots: Any
) -> tuple:
    """Return a figure and its axes in this style, without pyplot: the user's backend stays."""
    from matplotlib import figure, rc_context

    with rc_context(fname=STYLE):
        drawing = figure.Figure(figsize=size, layout="constrained")
        return drawing, drawing.subplots(rows, columns, **subplots)


def use_plain_ticks(ax) -> None:
    """Label a logarithmic axis of less than two decades with plain numbers, which fit."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        if axis.get_scale() != "log" or high / low >= 100:
            continue
        few = (1, 2, 5)
        many = (1, 1.5, 2, 2.5, 3, 4, 5, 7)
        subs = (1, 3) if high / low > 15 else few if high / low > 3 else many
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def line_style(i: int) -> dict[str, object]:
    """Return colour, marker and dashes of line `i`; the first 77 lines all differ."""
    dash = DASHES[i // len(COLOURS) % len(DASHES)]
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "ls": dash}


def mark_failures(ax, rows: Sequence[Mapping], x: str, colour: str = "black") -> None:
    """Draw a cross with the status at the upper border for each row that failed."""
    for row in rows:
        if row["status"] == "ok" or x not in row:
            continue
        at = {"transform": ax.get_xaxis_transform(), "clip_on": False}
        ax.plot([row[x]], [0.985], "x", color=colour, ms=8, mew=2, **at)
        text = {"rotation": 90, "ha": "center", "va": "top", "fontsize": 8, "color": colour}
        ax.text(row[x], 0.955, row["status"], **text, **at)


def label_ends(ax, ends: Sequence[tuple]) -> None:
    """Label the lines in the right margin, apart from each other, each with a leader."""
    to_axes = ax.transAxes.inverted().transform
    heights = [to_axes(ax.transData.transform((x, y)))[1] for _, _, x, y in ends]
    for (name, colour, x, y), height in zip(ends, spread(heights, GAP), strict=True):
        arrow = {"arrowstyle": "-", "color": colour, "lw": 0.7, "alpha": 0.6, "relpos": (0, 0.5)}
        ax.annotate(
            name,
            (x, y),
            (1.02, height),
            textcoords="axes fraction",
            va="center",
            color=colour,
            fontsize=10,
            arrowprops=arrow,
            annotation_clip=False,
        )


def spread(heights: Sequence[float], gap: float) -> list[float]:
    """Return heights in [0, 1] in the same order that differ by at least `gap`, near the given."""
    order = np.argsort(heights, kind="stable")
    y = np.clip(np.array(heights, dtype=float)[order], 0.0, 1.0)
    for i in range(1, len(y)):  # from below
        y[i] = max(y[i], y[i - 1] + gap)
    y[-1] = min(y[-1], 1.0)
    for i in range(len(y) - 1, 0, -1):  # and from above
        y[i - 1] = min(y[i - 1], y[i] - gap)
    spread = np.empty_like(y)
    spread[order] = y
    return spread.tolist()
