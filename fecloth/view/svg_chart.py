"""Line charts as inline SVG, with a title, two axes with round numbers, and a legend.

A chart takes the width of its container. Of a long curve it draws the extremes of equal spans,
one for each unit of the width, so that no peak is lost.

`observed_charts` draws the columns of observed.csv, `result_figures` a result in a notebook.
"""

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fecloth.output.frame_reader import drawable
from fecloth.view.web_page import render

WIDTH = 366  # of the field of the curves, in units of the SVG; chart.html adds the margins
HEIGHT = 182
NEAR = 0.05  # part of a tick step or of the axis by which a curve may lie outside the grid
COLOURS = (
    "#1f5fa8",
    "#d1495b",
    "#2f8f6b",
    "#b7791f",
    "#6b4fa0",
    "#3a9db0",
    "#8a5a44",
    "#5c6773",
)

Curve = tuple[np.ndarray, np.ndarray]


def chart(title: str, curves: Mapping[str, Curve], x: str, y: str, log: bool = False) -> str:
    """Return a <figure> of curves as HTML, or "" if no curve has two points.

    Parameters
    ----------
    title
        The title.
    curves
        Name of each curve to its x and y, two arrays (k,).
    x, y
        Labels of the axes, with units.
    log
        Whether the y axis is logarithmic; then values ≤ 0 are gaps in the curve.
    """
    # px and py are the points of a curve, x and y the labels of the axes.
    drawn = {name: _points_to_draw(px, py, log) for name, (px, py) in curves.items()}
    drawn = {name: (px, py) for name, (px, py) in drawn.items() if np.isfinite(py).sum() > 1}
    if not drawn:
        return ""
    # The pixels of an SVG count downwards, so the y axis begins at HEIGHT.
    across = _axis(np.concatenate([px for px, _ in drawn.values()]), (0, WIDTH), tight=True)
    up = _axis(np.concatenate([py for _, py in drawn.values()]), (HEIGHT, 0), log)
    paths = [
        {"name": name, "colour": colour, "path": _path(across.place(px), up.place(py))}
        for (name, (px, py)), colour in zip(drawn.items(), itertools.cycle(COLOURS), strict=False)
    ]
    values = {
        "title": title,
        "curves": paths,
        "x": x,
        "y": y,
        "width": WIDTH,
        "height": HEIGHT,
        "across": across.labels(),
        "up": up.labels(),
    }
    return render("chart.html", values)


def _points_to_draw(x, y, log):
    """Return x and y of the points to draw: y as its decimal logarithm if `log`, NaN in gaps.

    Gaps are values that are not finite or far too large, and with `log` values ≤ 0. Of many
    points, the least and the largest of each of `WIDTH` spans are drawn, and both ends.
    """
    x = np.asarray(x, float)
    y = np.asarray(y, float)
    y = np.where(drawable(y) & ((y > 0) | (not log)), y, np.nan)
    if log:
        y = np.log10(y)
    if len(x) <= 2 * WIDTH:  # no more than the spans would leave
        return x, y
    spans = np.array_split(np.arange(len(x)), WIDTH)
    # The least and the largest value of each span; any index where all are gaps.
    least = [s[np.argmin(np.nan_to_num(y[s], nan=np.inf))] for s in spans]
    most = [s[np.argmax(np.nan_to_num(y[s], nan=-np.inf))] for s in spans]
    shown = np.unique([0, *least, *most, len(x) - 1])
    return x[shown], y[shown]


def _path(px, py):
    """Return an SVG path with a line for each piece between gaps; a single point is a dot.

    `px` and `py` (k,) are pixel coordinates; a NaN in `py` is a gap.
    """
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(px, py, strict=True)]
    is_drawn = np.isfinite(py)
    pieces = np.split(np.arange(len(points)), np.flatnonzero(np.diff(is_drawn)) + 1)
    path = ""
    for piece in pieces:
        if is_drawn[piece[0]]:  # a piece is a line as a whole, or a gap
            line = [points[i] for i in piece]
            if len(line) == 1:
                line *= 2  # a line from the point to itself, which round ends make a dot
            path += "M" + "L".join(line)
    return path


class Axis(NamedTuple):
    """An axis of a chart.

    Attributes
    ----------
    low, high
        The values at its ends; on a logarithmic axis, their decimal logarithms.
    pixels
        The coordinates of its ends in the SVG.
    ticks
        The values at its ticks.
    log
        Whether it is logarithmic.
    """

    low: float
    high: float
    pixels: tuple[float, float]
    ticks: np.ndarray
    log: bool = False

    def place(self, values: np.ndarray) -> np.ndarray:
        """Return the pixel coordinates of values."""
        begin, end = self.pixels
        return begin + (values - self.low) / (self.high - self.low) * (end - begin)

    def labels(self) -> list[dict[str, str]]:
        """Return for each tick its position "at", its "label", and "text_at", where this is.

        Positions are pixel coordinates along the axis, as text.
        """
        digits = 4
        if len(self.ticks) > 1 and not self.log:
            largest = np.abs(self.ticks).max()
            step = self.ticks[1] - self.ticks[0]
            # More digits where neighbours, as 1.00001 and 1.00002, would look the same.
            digits = max(digits, math.ceil(math.log10(largest / step)) + 2)
        values = 10.0**self.ticks if self.log else self.ticks
        return [
            {"at": f"{at:.1f}", "text_at": f"{at + 4:.1f}", "label": _number(value, digits)}
            for at, value in zip(self.place(self.ticks), values, strict=True)
        ]


def _axis(values: np.ndarray, pixels: tuple[float, float], log=False, tight=False) -> Axis:
    """Return an axis of about five round ticks that includes the values.

    It begins and ends at a tick, but a curve may lie outside by the part `NEAR` of a tick step. A
    `tight` axis begins and ends at the values instead, or begins at a tick that is a little
    below them. `pixels` are the coordinates of its two ends. With `log` the values are decimal
    logarithms.
    """
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        # All values are the same up to round-off: half of it below and above, or 0.5 for 0.
        low = low - (0.5 * abs(low) or 0.5)
        high = high + (0.5 * abs(high) or 0.5)
        tight = False
    rough_step = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(rough_step))
    # The smallest round step that is not smaller; 0.999 spares one that only round-off makes so.
    step = next(power * k for k in (1, 2, 2.5, 5, 10) if power * k >= 0.999 * rough_step)
    if log:
        step = max(1.0, math.ceil(step))  # whole powers of ten
    first_tick = math.floor(low / step + NEAR)  # in steps from 0
    last_tick = math.ceil(high / step - NEAR)
    ticks = step * np.arange(first_tick, last_tick + 1)
    if not tight:
        return Axis(ticks[0], ticks[-1], pixels, ticks, log)
    low = min([low, *ticks[(ticks <= low) & (ticks >= low - NEAR * (high - low))]])
    slack = 1e-9 * (high - low)  # so that round-off loses no tick at an end
    return Axis(low, high, pixels, ticks[(ticks >= low - slack) & (ticks <= high + slack)])


def _number(value: float, digits: int) -> str:
    """Return a number as text with a minus sign; one that is zero up to round-off as 0."""
    if abs(value) < 1e-15:
        value = 0.0
    text = f"{value:.{digits}g}"
    mantissa, _, exponent = text.partition("e")
    if exponent:
        return f"{mantissa}e{int(exponent)}".replace("-", "−")
    return text.replace("-", "−")


REACTION = "reaction:"


def observed_charts(table: Mapping[str, np.ndarray]) -> list[str]:
    """Return figures of each probe, of sag and area, and of the force of each pin and obstacle.

    For an obstacle there is also a figure of its least distance. The `table` has the columns of
    observed.csv; without rows there is no figure. A figure without curves is "".
    """
    if not table:
        return []

    def draw(title: str, columns: Mapping[str, np.ndarray], unit: str) -> str:
        curves = {name: (table["t"], values) for name, values in columns.items()}
        return chart(title, curves, "t [s]", unit)

    def components(name: str) -> dict[str, np.ndarray]:
        return {component: table[f"{name}.{component}"] for component in "xyz"}

    vectors = [name.removesuffix(".x") for name in table if name.endswith(".x")]
    # The columns of a vector are NAME.x, NAME.y and NAME.z.
    reactions = [name for name in vectors if name.startswith(REACTION)]
    probes = [name for name in vectors if name not in reactions]
    figures = [draw(_probe_title(name), components(name), "[m]") for name in probes]
    figures.append(draw("Sag", {"sag": table["sag"]}, "[m]"))
    figures.append(draw("Area", {"area": table["area"]}, "[m²]"))
    for reaction in reactions:
        name = reaction.removeprefix(REACTION)
        distance = table.get(f"least_distance:{name}")  # obstacles have it, and pins not
        if distance is None:
            figures.append(draw(f"Force of the pin {name}", components(reaction), "[N]"))
        else:
            figures.append(draw(f"Force of the obstacle {name}", components(reaction), "[N]"))
            title = f"Least distance from the obstacle {name}"
            figures.append(draw(title, {"d": distance}, "[m]"))
    return figures


def _probe_title(name: str) -> str:
    if name == "mean_displacement":
        return "Mean displacement"
    return f"Position of {name}"


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
    curves = {name: (times, values) for name, values in energies.items() if np.any(values)}
    heights = {
        name: (times, values)
        for name, values in observed.items()
        if name == "sag" or (name.endswith(".z") and not name.startswith(REACTION))
    }
    figures = chart("Energies", curves, "t [s]", "energy [J]")
    figures += chart("Probes", heights, "t [s]", "z, sag [m]")
    return render("notebook.html", {"title": title, "figures": figures})
