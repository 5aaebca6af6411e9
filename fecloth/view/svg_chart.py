"""Line charts as inline SVG, with a title, two axes with round numbers, and a legend.

A chart takes the width of its container. Of a long curve it draws the extremes of equal spans, so
that no peak is lost.
"""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.output.frame_reader import drawable

WIDTH, HEIGHT = 460, 230
LEFT, RIGHT, TOP, BOTTOM = 72, 22, 12, 36
NEAR = 0.05  # fraction of a tick step or span by which a curve may lie outside the grid
SPANS = 250  # spans of a long curve; each is drawn by its least and largest value
COLOURS = ("#1f5fa8", "#d1495b", "#2f8f6b", "#b7791f", "#6b4fa0", "#3a9db0", "#8a5a44", "#5c6773")

Curve = tuple[np.ndarray, np.ndarray]


def chart(title: str, curves: Mapping[str, Curve], x: str, y: str, log: bool = False) -> str:
    """Return a <figure> of curves, each two arrays (k,); "" if no curve has two points.

    Parameters
    ----------
    x, y
        Labels of the axes, with units.
    log
        Use a logarithmic y axis; values ≤ 0 are gaps in the curve.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 5)
    >>> figure = chart("fall", {"z": (t, -4.905 * t**2)}, "t [s]", "z [m]")
    >>> figure.startswith("<figure>"), figure.count("<path"), "−4" in figure
    (True, 1, True)
    """
    curves = {name: _points_to_draw(*curve, log) for name, curve in curves.items()}
    curves = {name: curve for name, curve in curves.items() if np.isfinite(curve[1]).sum() > 1}
    if not curves:
        return ""
    xs, ys = (np.concatenate([curve[i] for curve in curves.values()]) for i in (0, 1))
    up, across = _axis(np.nanmin(ys), np.nanmax(ys), 5, log), _tight_axis(xs.min(), xs.max())
    body = [_grid(across, up, log), _axis_labels(x, y)]
    for colour, (name, curve) in zip(_colours(len(curves)), curves.items(), strict=True):
        path = _path(_place(across, curve[0], 0), _place(up, curve[1], 1))
        stroke = f'stroke="{colour}" stroke-width="1.8" fill="none" stroke-linejoin="round"'
        stroke += ' stroke-linecap="round"'
        body.append(f'<path d="{path}" {stroke}><title>{html.escape(name)}</title></path>')
    return (
        f"<figure><figcaption>{html.escape(title)}</figcaption>{_legend(list(curves))}"
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{html.escape(title)}">'
        f"{''.join(body)}</svg></figure>"
    )


def _points_to_draw(x, y, log):
    """Return the points to draw: y as its decimal logarithm if `log`, NaN in gaps."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    y = np.where(drawable(y) & ((y > 0) | (not log)), y, np.nan)
    y = np.log10(y) if log else y
    if len(x) <= 2 * SPANS:
        return x, y
    spans = np.array_split(np.arange(len(x)), SPANS)
    shown = np.unique(np.concatenate([[0], *(_extremes(s, y[s]) for s in spans), [len(x) - 1]]))
    return x[shown], y[shown]


def _extremes(span, y):
    """Return the indices of the least and largest value of a span; one index if all are gaps."""
    return [span[np.nanargmin(y)], span[np.nanargmax(y)]] if np.isfinite(y).any() else span[:1]


def _path(px, py):
    """Return an SVG path with a line for each piece between gaps; one point is a dot."""
    points, there = [f"{a:.1f} {b:.1f}" for a, b in zip(px, py, strict=True)], np.isfinite(py)
    pieces = np.split(np.arange(len(points)), np.flatnonzero(np.diff(there)) + 1)
    lines = ([points[i] for i in piece] for piece in pieces if there[piece[0]])
    return "".join("M" + "L".join(line * 2 if len(line) == 1 else line) for line in lines)


@dataclass(frozen=True)
class Axis:
    """Ends of an axis and the positions of its ticks."""

    low: float
    high: float
    ticks: np.ndarray


def _tight_axis(low: float, high: float) -> Axis:
    """Return an axis from `low` to `high` with round ticks inside."""
    wide = _axis(low, high, 5)
    if not low < high:
        return wide
    slack = NEAR * (high - low)
    below = wide.ticks[(wide.ticks <= low) & (wide.ticks >= low - slack)]
    low, slack = min([low, *below]), 1e-9 * (high - low)
    inside = (wide.ticks >= low - slack) & (wide.ticks <= high + slack)
    return Axis(low, high, wide.ticks[inside])


def _axis(low: float, high: float, most: int, log: bool = False) -> Axis:
    """Return an axis of about `most` round ticks that includes `low` and `high`."""
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        low, high = low - (0.5 * abs(low) or 0.5), high + (0.5 * abs(high) or 0.5)
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * k for k in (1, 2, 2.5, 5, 10) if power * k >= 0.999 * rough)
    step = max(1.0, math.ceil(step)) if log else step
    first, last = math.floor(low / step + NEAR), math.ceil(high / step - NEAR)
    ticks = step * np.arange(first, last + 1)
    return Axis(ticks[0], ticks[-1], ticks)


def _place(axis, values, way):
    """Return the pixel coordinates of values along an axis (way 0: across, 1: up)."""
    share = (values - axis.low) / (axis.high - axis.low)
    if way:
        return HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)
    return LEFT + share * (WIDTH - LEFT - RIGHT)


def _grid(across, up, log):
    parts = []
    for px, value in zip(_place(across, across.ticks, 0), across.ticks, strict=True):
        parts.append(f'<line x1="{px:.1f}" x2="{px:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>')
        label = f'<text x="{px:.1f}" y="{HEIGHT - BOTTOM + 15}" text-anchor="middle">'
        parts.append(f"{label}{_number(value, across)}</text>")
    for py, value in zip(_place(up, up.ticks, 1), up.ticks, strict=True):
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{py:.1f}" y2="{py:.1f}"/>')
        label = f'<text x="{LEFT - 5}" y="{py + 4:.1f}" text-anchor="end">'
        shown = _number(10.0**value) if log else _number(value, up)
        parts.append(f"{label}{shown}</text>")
    return f'<g class="grid">{"".join(parts)}</g>'


def _axis_labels(x, y):
    middle = (TOP + HEIGHT - BOTTOM) / 2
    return (
        f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 4}" text-anchor="middle">'
        f"{html.escape(x)}</text>"
        f'<text transform="translate(11 {middle}) rotate(-90)" text-anchor="middle">'
        f"{html.escape(y)}</text>"
    )


def _number(value: float, axis: Axis | None = None) -> str:
    """Return a number in words; on an axis with the digits that tell its ticks apart."""
    digits = 4
    if axis is not None and len(axis.ticks) > 1:
        largest, step = np.abs(axis.ticks).max(), axis.ticks[1] - axis.ticks[0]
        digits = max(digits, math.ceil(math.log10(largest / step)) + 2)
    text = f"{0.0 if abs(value) < 1e-15 else value:.{digits}g}"
    mantissa, _, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}".replace("-", "−") if exponent else text.replace("-", "−")


def _colours(count):
    return [COLOURS[i % len(COLOURS)] for i in range(count)]


def _legend(names):
    if len(names) < 2:
        return ""
    entries = zip(_colours(len(names)), names, strict=True)
    marks = "".join(
        f'<span><i style="background:{c}"></i>{html.escape(n)}</span>' for c, n in entries
    )
    return f'<p class="key">{marks}</p>'
