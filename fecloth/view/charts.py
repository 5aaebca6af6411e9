"""Charts of a run for HTML pages, as SVG that takes the width of its container.

The last lines of each run write some, and Matplotlib would take longer than a small run.
`observed_charts` lists the charts of observed.csv, and `result_figures` shows a result in a
notebook.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from fecloth.output.frame_reader import drawable
from fecloth.view.web_page import render

# Okabe and Ito (2008): colours that colour-blind readers can tell apart, without yellow, which
# is too light for a line on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
# Of columns of observed.csv, by how their names begin. Other vectors are positions.
UNITS = {"sag": "[m]", "area": "[m²]", "least_distance": "[m]", "reaction": "[N]"}
WIDTH = 366  # of the field of the curves, in units of the SVG; chart.html adds the margins
HEIGHT = 182
TICKS = 6  # of an axis, at most
LONGEST_LABEL = 7  # characters of a tick; where one needs more, all are differences


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
    return [_draw(chart, x) for chart in map(_drawable, charts) if chart.curves]


def _drawable(chart: Chart) -> Chart:
    """Return a chart with NaN for values without a place, and curves of two points or more.

    The values of a logarithmic chart become decimal logarithms.
    """
    curves = {}
    for name, values in chart.curves.items():
        y = np.asarray(values, float)
        y = np.where(drawable(y) & ((y > 0) | (not chart.log)), y, np.nan)
        if np.isfinite(y).sum() > 1:
            curves[name] = np.log10(y) if chart.log else y
    return chart._replace(curves=curves)


def _draw(chart: Chart, x: str) -> str:
    """Return the <figure> of a chart of `_drawable`."""
    across = _axis(chart.t, WIDTH)
    up = _axis(np.stack(list(chart.curves.values())), HEIGHT, chart.log, to_ticks=True)
    lines = [
        {"name": name, "colour": COLOURS[i % len(COLOURS)], "path": _path(across, up, chart.t, y)}
        for i, (name, y) in enumerate(chart.curves.items())
    ]
    values = {
        "title": chart.title,
        "lines": lines,
        "x": x + across.above,
        "y": chart.y + up.above,
        "width": WIDTH,
        "height": HEIGHT,
        "across": across.labels,
        "up": [(HEIGHT - at, label) for at, label in up.labels],
    }
    return render("chart.html", values)


def _path(across: "Axis", up: "Axis", t: np.ndarray, y: np.ndarray) -> str:
    """Return the path of a curve, with a line for each piece between gaps, which are NaN.

    Of a long curve it has the extremes of equal spans of the x axis, so that no peak is lost.
    """
    shown = np.arange(len(t))
    if len(t) > 2 * WIDTH:
        spans = np.array_split(shown, WIDTH)
        least = [span[np.argmin(np.nan_to_num(y[span], nan=np.inf))] for span in spans]
        most = [span[np.argmax(np.nan_to_num(y[span], nan=-np.inf))] for span in spans]
        shown = np.unique([0, *least, *most, len(t) - 1])
    points = np.column_stack([across.place(t[shown]), HEIGHT - up.place(y[shown])])
    path = ""
    command = "M"
    for at, height in points.tolist():
        if math.isnan(height):
            command = "M"
        else:
            path += f"{command}{at:.1f} {height:.1f}"
            command = "L"
    return path


class Axis(NamedTuple):
    """An axis of a chart.

    Attributes
    ----------
    low, high
        The values at its ends.
    length
        Its length in units of the SVG.
    labels
        Where there is a tick, and its label.
    above
        What the label of the axis adds if the labels of the ticks are differences.
    """

    low: float
    high: float
    length: int
    labels: list[tuple[float, str]]
    above: str = ""

    def place(self, values: np.ndarray) -> np.ndarray:
        """Return where values are, in units of the SVG from the end with the lower value."""
        return (values - self.low) / (self.high - self.low) * self.length


def _axis(values: np.ndarray, length: int, log: bool = False, to_ticks: bool = False) -> Axis:
    """Return an axis with round ticks that includes the values.

    With `log` the values are decimal logarithms, and the ticks whole ones. With `to_ticks` the
    axis begins and ends at a tick, else at the extremes of the values.
    """
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    if log:  # a curve at a power of ten, as a constant dt, is not on the border
        low = math.ceil(low) - 1
        high = math.floor(high) + 1
    elif high - low <= 1e-12 * max(abs(low), abs(high)):  # the same up to round-off
        low -= 0.5 * abs(low) or 0.5
        high += 0.5 * abs(high) or 0.5
    step = _round_step((high - low) / (TICKS - 1))
    if log:
        step = max(1.0, math.ceil(step))
    if to_ticks:
        low = step * math.floor(low / step)
        high = step * math.ceil(high / step)
    near = 1e-9  # of a step, so that round-off loses no tick at an end
    steps = np.arange(math.ceil(low / step - near), math.floor(high / step + near) + 1)
    ticks = step * steps
    labels = [_number(value) for value in (10.0**ticks if log else ticks)]
    above = ""
    if max(map(len, labels), default=0) > LONGEST_LABEL:
        above = f", above {_number(ticks[0])}"
        labels = [_number(value) for value in step * (steps - steps[0])]
    axis = Axis(low, high, length, [], above)
    return axis._replace(labels=list(zip(axis.place(ticks).tolist(), labels, strict=True)))


def _round_step(size: float) -> float:
    """Return the smallest of 1, 2, 2.5, 5 and 10 times a power of ten that is not below size."""
    power = 10.0 ** math.floor(math.log10(size))
    return next(power * k for k in (1, 2, 2.5, 5, 10) if power * k >= 0.999 * size)


def _number(value: float) -> str:
    """Return a number as text, with a power of ten where that is needed, and a minus sign."""
    text = f"{value:.12g}"
    if len(text) > LONGEST_LABEL:
        text = np.format_float_scientific(float(text), trim="-", exp_digits=1).replace("+", "")
    return text.replace("e-0", "e-").replace("-", "−")


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
