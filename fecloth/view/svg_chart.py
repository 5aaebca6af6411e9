"""Line charts as inline SVG, with a title, two axes with round numbers, and a legend.

A chart takes the width of its container. Of a long curve it draws the extremes of equal spans,
so that no peak is lost.

`observed_charts` draws the columns of observed.csv, `result_figures` a result in a notebook.
"""

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from fecloth.output.frame_reader import drawable
from fecloth.view.web_page import render

WIDTH = 460
HEIGHT = 230
LEFT = 72
RIGHT = 22
TOP = 12
BOTTOM = 36
NEAR = 0.05  # fraction of a tick step or span by which a curve may lie outside the grid
SPANS = 250  # spans of a long curve; each is drawn by its least and largest value
COLOURS = ("#1f5fa8", "#d1495b", "#2f8f6b", "#b7791f", "#6b4fa0", "#3a9db0", "#8a5a44", "#5c6773")

Curve = tuple[np.ndarray, np.ndarray]


def chart(title: str, curves: Mapping[str, Curve], x: str, y: str, log: bool = False) -> str:
    """Return a <figure> of curves, each two arrays (k,); "" if no curve has two points.

    x and y are the labels of the axes, with units. With `log` the y axis is logarithmic, and
    values ≤ 0 are gaps in the curve.
    """
    curves = {name: _points_to_draw(*curve, log) for name, curve in curves.items()}
    curves = {name: curve for name, curve in curves.items() if np.isfinite(curve[1]).sum() > 1}
    if not curves:
        return ""
    xs, ys = (np.concatenate([curve[i] for curve in curves.values()]) for i in (0, 1))
    across = _axis(xs, (LEFT, WIDTH - RIGHT), tight=True)
    up = _axis(ys, (HEIGHT - BOTTOM, TOP), log)
    drawn = [
        {"name": name, "colour": colour, "path": _path(across.place(px), up.place(py))}
        for (name, (px, py)), colour in zip(curves.items(), itertools.cycle(COLOURS), strict=False)
    ]
    at = {"left": LEFT, "right": WIDTH - RIGHT, "top": TOP, "bottom": HEIGHT - BOTTOM}
    at |= {"width": WIDTH, "height": HEIGHT}
    ticks = {"across": across.labels(), "up": up.labels()}
    return render("chart.html", {"curves": drawn, "title": title, "x": x, "y": y, **at, **ticks})


def _points_to_draw(x, y, log):
    """Return the points to draw: y as its decimal logarithm if `log`, NaN in gaps."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    y = np.where(drawable(y) & ((y > 0) | (not log)), y, np.nan)
    y = np.log10(y) if log else y
    if len(x) <= 2 * SPANS:
        return x, y
    spans = np.array_split(np.arange(len(x)), SPANS)
    # the least and the largest value of each span; any index where all are gaps
    least = [s[np.argmin(np.nan_to_num(y[s], nan=np.inf))] for s in spans]
    most = [s[np.argmax(np.nan_to_num(y[s], nan=-np.inf))] for s in spans]
    shown = np.unique([0, *least, *most, len(x) - 1])
    return x[shown], y[shown]


def _path(px, py):
    """Return an SVG path with a line for each piece between gaps; one point is a dot."""
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(px, py, strict=True)]
    there = np.isfinite(py)
    pieces = np.split(np.arange(len(points)), np.flatnonzero(np.diff(there)) + 1)
    lines = ([points[i] for i in piece] for piece in pieces if there[piece[0]])
    return "".join("M" + "L".join(line * 2 if len(line) == 1 else line) for line in lines)


class Axis(NamedTuple):
    """Ends of an axis, the pixels there, and the positions of its ticks."""

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
        """Return where the lines and the labels of the ticks are, and the labels."""
        digits = 4  # or as many as tell the ticks apart
        if len(self.ticks) > 1 and not self.log:
            largest = np.abs(self.ticks).max()
            step = self.ticks[1] - self.ticks[0]
            digits = max(digits, math.ceil(math.log10(largest / step)) + 2)
        words = [_number(10.0**v if self.log else v, digits) for v in self.ticks]
        return [
            {"at": f"{at:.1f}", "text_at": f"{at + 4:.1f}", "label": label}
            for at, label in zip(self.place(self.ticks), words, strict=True)
        ]


def _axis(values: np.ndarray, pixels: tuple[float, float], log=False, tight=False) -> Axis:
    """Return an axis of about five round ticks that includes the values."""
    # One that is `tight` ends at the values, or at a tick that is a little below them.
    low = float(np.nanmin(values))
    high = float(np.nanmax(values))
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        low = low - (0.5 * abs(low) or 0.5)
        high = high + (0.5 * abs(high) or 0.5)
        tight = False
    rough = (high - low) / 5
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * k for k in (1, 2, 2.5, 5, 10) if power * k >= 0.999 * rough)
    step = max(1.0, math.ceil(step)) if log else step
    first = math.floor(low / step + NEAR)
    last = math.ceil(high / step - NEAR)
    ticks = step * np.arange(first, last + 1)
    if not tight:
        return Axis(ticks[0], ticks[-1], pixels, ticks, log)
    low = min([low, *ticks[(ticks <= low) & (ticks >= low - NEAR * (high - low))]])
    slack = 1e-9 * (high - low)
    return Axis(low, high, pixels, ticks[(ticks >= low - slack) & (ticks <= high + slack)])


def _number(value: float, digits: int) -> str:
    """Return a number in words."""
    text = f"{0.0 if abs(value) < 1e-15 else value:.{digits}g}"
    mantissa, _, exponent = text.partition("e")
    if exponent:
        return f"{mantissa}e{int(exponent)}".replace("-", "−")
    return text.replace("-", "−")


MOST = 6  # charts of probes, and of pins; the others are only in observed.csv
REACTION = "reaction:"


def observed_charts(table: Mapping[str, np.ndarray]) -> list[str]:
    """Return a <figure> for each probe, for sag and area, and for the force of each pin or body."""
    # `table` has the columns of observed.csv; without rows there is no figure.
    if not table:
        return []
    vectors = [name.removesuffix(".x") for name in table if name.endswith(".x")]
    pins = [name for name in vectors if name.startswith(REACTION)]
    probes = [name for name in vectors if name not in pins]
    shown = [(_title(name), _components(table, name), "[m]") for name in probes[:MOST]]
    shown += [("Sag", {"sag": table["sag"]}, "[m]"), ("Area", {"area": table["area"]}, "[m²]")]
    for name in pins[:MOST]:
        obstacle = name.removeprefix(REACTION)
        least = table.get(f"least_distance:{obstacle}")
        if least is None:
            title = _title(name)
        else:
            title = f"Force of the obstacle {obstacle}"
        shown.append((title, _components(table, name), "[N]"))
        if least is not None:
            shown.append((f"Least distance from the obstacle {obstacle}", {"d": least}, "[m]"))
    return [
        chart(
            title, {name: (table["t"], values) for name, values in columns.items()}, "t [s]", unit
        )
        for title, columns, unit in shown
    ]


def _title(name: str) -> str:
    if name.startswith(REACTION):
        return f"Force of the pin {name.removeprefix(REACTION)}"
    if name == "mean_displacement":
        return "Mean displacement"
    return f"Position of {name}"


def _components(table, name: str) -> dict[str, np.ndarray]:
    return {component: table[f"{name}.{component}"] for component in "xyz"}


def result_figures(
    title: str,
    times: np.ndarray,
    energies: Mapping[str, np.ndarray],
    observed: Mapping[str, np.ndarray],
) -> str:
    """Return HTML of the nonzero energies [J], and of `observed` heights [m], over time."""
    curves = {name: (times, values) for name, values in energies.items() if np.any(values)}
    heights = {
        name: (times, values)
        for name, values in observed.items()
        if name == "sag" or (name.endswith(".z") and not name.startswith("reaction:"))
    }
    figures = chart("Energies", curves, "t [s]", "energy [J]")
    figures += chart("Probes", heights, "t [s]", "z, sag [m]")
    return render("notebook.html", {"title": title, "figures": figures})
