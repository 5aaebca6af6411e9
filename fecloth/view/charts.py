"""Charts of a run for HTML pages, drawn by Matplotlib as SVG in the style of all figures.

`observed_charts` lists the charts of observed.csv, and `result_figures` shows a result in a
notebook.
"""

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fecloth.output.frame_reader import drawable
from fecloth.view.web_page import render

STYLE = Path(__file__).with_name("figures.mplstyle")
# Okabe and Ito (2008): colours that colour-blind readers can tell apart, without yellow, which
# is too light for a line on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLE_IN_PAGES: dict[Any, Any] = {
    "font.size": 10,
    "font.sans-serif": ["DejaVu Sans"],
    "svg.fonttype": "none",  # text stays text, which takes less room and can be searched
    "axes.xmargin": 0,
    "axes.formatter.limits": (-3, 4),  # powers of ten outside: shorter labels
    "axes.formatter.offset_threshold": 5,  # 1.0002 and not 2, with 1e−4+1 above the axis
    "xtick.major.size": 0,
    "ytick.major.size": 0,
}
# Of columns of observed.csv, by how their names begin. Other vectors are positions.
UNITS = {"sag": "[m]", "area": "[m²]", "least_distance": "[m]", "reaction": "[N]"}
SIZE = (4.6, 2.5)  # of a chart [inches]
AXES = (0.19, 0.17, 0.78, 0.74)  # left, bottom, width and height of its axes, over its size
NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))  # the same run, the same file


class Chart(NamedTuple):
    """Curves over the time of a run.

    Attributes
    ----------
    title
        The title.
    y
        Label of the y axis, with its unit.
    t
        (k,) the times [s], or the parts of the loads.
    curves
        Name of each curve to its values (k,).
    log
        Whether the y axis is logarithmic.
    """

    title: str
    y: str
    t: np.ndarray
    curves: Mapping[str, np.ndarray]
    log: bool = False


def draw(charts: Iterable[Chart], x: str = "t [s]") -> list[str]:
    """Return a <figure> of HTML for each chart that has a curve with two points.

    `x` is the label of the x axis. A curve has a gap where a value is not finite or far too
    large, and on a logarithmic axis where it is not positive.
    """
    from matplotlib import rc_context  # here, as its import is slow
    from matplotlib.figure import Figure

    shown = [_drawable(chart) for chart in charts]
    with rc_context(STYLE_IN_PAGES, STYLE):
        ax = Figure(figsize=SIZE).add_axes(AXES)  # for all charts: new ones take twice the time
        ax.xaxis.set_label_coords(0.5, -0.13)  # else they are placed by the ticks: slower
        ax.yaxis.set_label_coords(-0.2, 0.5)
        return [_draw_on(ax, chart, x) for chart in shown if chart.curves]


def _drawable(chart: Chart) -> Chart:
    """Return a chart with NaN for values without a place, and curves of two points or more."""
    curves = {}
    for name, values in chart.curves.items():
        y = np.asarray(values, float)
        y = np.where(drawable(y) & ((y > 0) | (not chart.log)), y, np.nan)
        if np.isfinite(y).sum() > 1:
            curves[name] = y
    return chart._replace(curves=curves)


def _draw_on(ax, chart: Chart, x: str) -> str:
    """Draw a chart on these axes, and return its <figure>; its curves are removed again."""
    lines = [
        ax.plot(chart.t, y, color=COLOURS[i % len(COLOURS)], label=name)[0]
        for i, (name, y) in enumerate(chart.curves.items())
    ]
    ax.set(xlabel=x, ylabel=chart.y)
    _scale(ax, list(chart.curves.values()), chart.log)
    svg = io.StringIO()
    ax.figure.savefig(svg, format="svg", metadata=NO_METADATA)
    for line in lines:
        line.remove()
    picture = svg.getvalue()
    values = {"title": chart.title, "lines": lines, "svg": picture[picture.index("<svg") :]}
    return render("chart.html", values)


def _scale(ax, curves: list[np.ndarray], log: bool) -> None:
    """Fit the axes to the curves; a logarithmic y axis begins and ends at a power of ten."""
    ax.set_yscale("log" if log else "linear")
    ax.locator_params(axis="x", nbins=6)
    ax.relim()
    ax.autoscale()
    if not log:
        ax.locator_params(axis="y", nbins=6)
        return
    exponents = np.log10(np.concatenate(curves))
    # A curve at a power of ten, as a constant dt, is not drawn on the border.
    ends = np.ceil(np.nanmin(exponents)) - 1, np.floor(np.nanmax(exponents)) + 1
    ax.set_ylim(*np.power(10.0, ends))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()


def observed_charts(table: Mapping[str, np.ndarray]) -> list[Chart]:
    """List a chart of each vector and of each number in observed.csv, with its name as title.

    `table` has the columns of the file; without rows there is no chart.
    """
    curves: dict[str, dict[str, np.ndarray]] = {}
    for column, values in table.items():
        name = column
        if column.endswith((".x", ".y", ".z")):
            name = column[:-2]
        curves.setdefault(name, {})[column] = values
    charts = []
    for name, of_name in curves.items():
        unit = UNITS.get(name.partition(":")[0], "[m]" if f"{name}.x" in table else "")
        if name != "t":
            charts.append(Chart(name, unit, table["t"], of_name))
    return charts


def result_figures(
    title: str,
    times: np.ndarray,
    energies: Mapping[str, np.ndarray],
    observed: Mapping[str, np.ndarray],
) -> str:
    """Return HTML with a chart of the energies [J], and one of the heights of probes [m].

    Energies that are zero throughout are left out. Of `observed`, the columns of observed.csv,
    the sag and the z of each probe are drawn. `times` [s] are the times of all values.
    """
    moving = {name: values for name, values in energies.items() if np.any(values)}
    heights = {
        name: values
        for name, values in observed.items()
        if name == "sag" or (name.endswith(".z") and not name.startswith("reaction:"))
    }
    charts = [
        Chart("Energies", "energy [J]", times, moving),
        Chart("Probes", "z, sag [m]", times, heights),
    ]
    return render("notebook.html", {"title": title, "figures": draw(charts)})
