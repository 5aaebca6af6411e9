"""One style for all figures: legible at 800 pixels, told apart by colour and marker."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fecloth.errors import InputError

# Okabe and Ito (2008), the eight colours that survive colour blindness; yellow is left out, which
# is too light for a line on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "h")
DASHES = ("-", "--", "-.", ":")
STYLE = {
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "font.size": 12,
    "axes.titlesize": 12,
    "legend.fontsize": 10,
    "legend.framealpha": 0.9,
    "lines.linewidth": 1.6,
    "lines.markersize": 6,
    "axes.grid": True,
    "grid.color": "0.88",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "fecloth",  # the same figure is the same file
}


def pyplot():
    """Matplotlib without a display."""
    try:
        import matplotlib
    except ImportError as error:
        remedy = "pip install 'fecloth[studies]'."
        raise InputError("the figures", "need matplotlib", "studies", remedy) from error
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


@contextmanager
def figure(
    out: str | Path,
    name: str,
    xlabel: str = "",
    ylabel: str = "",
    title: str = "",
    log: bool = True,
    panels: tuple[int, int] = (1, 1),
    size: tuple[float, float] | None = None,
    **subplots: object,
) -> Iterator[tuple]:
    """A figure and its axes to draw on; OUT/NAME.png and .svg are written at the end of the block.

    Parameters
    ----------
    xlabel, ylabel, title
        For every panel, with the unit: "time step [s]".
    log
        Whether both axes are logarithmic.
    panels
        Rows and columns; with more than one the axes come as an array.
    size
        Inches, by default 8 × 5 for one panel.
    """
    plt = pyplot()
    with plt.rc_context(STYLE):
        size = size or (8.0, 5.0 if panels[0] == 1 else 3.6 * panels[0])
        drawing, axes = plt.subplots(*panels, figsize=size, layout="constrained", **subplots)
        for ax in np.ravel(axes):
            ax.set(xlabel=xlabel, ylabel=ylabel, title=title)
            if log:
                ax.set(xscale="log", yscale="log")
        yield drawing, axes
        for ax in np.ravel(axes):
            plain_ticks(ax)
        Path(out).mkdir(parents=True, exist_ok=True)
        for kind in ("png", "svg"):
            drawing.savefig(Path(out) / f"{name}.{kind}")
        plt.close(drawing)


def plain_ticks(ax) -> None:
    """Label a logarithmic axis of less than two decades with plain numbers, so that they fit."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        if axis.get_scale() != "log" or high / low >= 100:
            continue
        subs = (1, 2, 5) if high / low > 6 else (1, 1.5, 2, 3, 4, 5, 7)
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def style(i: int) -> dict[str, object]:
    """Colour, marker and dashes of the i-th line: different for the first 77."""
    dash = DASHES[i // len(COLOURS) % len(DASHES)]
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "ls": dash}


def lines(
    ax,
    rows: Sequence[Mapping],
    x: str,
    y: str,
    by: str,
    legend: bool = True,
    names: Sequence = (),
) -> None:
    """A line for each value of the column `by`; crosses at the upper border for what failed.

    `names` are all those values, in the order of their colours, where several panels share them.
    """
    names = names or list(dict.fromkeys(row[by] for row in rows))
    for i, name in enumerate(names):
        own = [row for row in rows if row[by] == name]
        good = sorted((row[x], row[y]) for row in own if row["status"] == "ok")
        ax.plot(*zip(*good, strict=True) if good else ((), ()), label=str(name), **style(i))
        mark_failures(ax, own, x, COLOURS[i % len(COLOURS)])
    if legend:
        ax.legend()


def mark_failures(ax, rows: Sequence[Mapping], x: str, colour: str = "black") -> None:
    """A cross at the upper border over each row that failed, with its status."""
    for row in rows:
        if row["status"] == "ok" or x not in row:
            continue
        at = {"transform": ax.get_xaxis_transform(), "clip_on": False}
        ax.plot([row[x]], [0.985], "x", color=colour, ms=8, mew=2, **at)
        text = {"rotation": 90, "ha": "center", "va": "top", "fontsize": 8, "color": colour}
        ax.text(row[x], 0.955, row["status"], **text, **at)


def slope_triangle(
    ax, order: float, at: tuple[float, float] = (0.75, 0.12), width: float = 0.15
) -> None:
    """A right triangle with the slope `order` on logarithmic axes, labelled with it.

    Drawn last, when the limits of the axes are settled: they are not changed by it.

    Parameters
    ----------
    at
        Its right lower corner in parts of the axes.
    width
        Of its base, in parts of the axes; less where it would be too high.
    """
    (x0, x1), (y0, y1) = np.log10(ax.get_xlim()), np.log10(ax.get_ylim())
    right, bottom = x0 + at[0] * (x1 - x0), y0 + at[1] * (y1 - y0)
    base = min(width * (x1 - x0), 0.25 * (y1 - y0) / abs(order))
    left, top = right - base, bottom + order * base
    corners = 10.0 ** np.array([(left, bottom), (right, bottom), (right, top)])
    limits = ax.get_xlim(), ax.get_ylim()
    ax.fill(*corners.T, facecolor="0.93", edgecolor="0.35", lw=1)
    middle = 10 ** (0.5 * (bottom + top))
    ax.annotate(
        f"{order:g}", (corners[1, 0], middle), (4, 0), textcoords="offset points", va="center"
    )
    ax.set(xlim=limits[0], ylim=limits[1])
