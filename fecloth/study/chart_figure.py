"""The figure of a chart: error over CPU seconds, a labelled line for each series."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from fecloth.study.figures import Figure, label_ends, line_style, new_figure, use_plain_ticks
from fecloth.study.status import OK

MOST_LINES = 8
LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
BETTER = 0.98  # times the best error so far: what a line counts as an improvement
LEAST = 1e-12  # where errors of zero are drawn
Series = dict[str, list[Mapping]]


def series_of(rows: Iterable[Mapping]) -> Series:
    """Return the rows with an error by "method element model"; the model only if it varies."""
    measured = [row for row in rows if row["status"] == OK and math.isfinite(row["error"])]
    several = len({row.get("model") for row in measured}) > 1
    series: Series = {}
    for row in measured:
        parts = [row["method"], row["element"], row["model"] if several else ""]
        series.setdefault(" ".join(part for part in parts if part), []).append(row)
    return series


def split_series(rows: Iterable[Mapping]) -> tuple[Series, Series]:
    """Return the series that are drawn as lines, at most eight, and the others."""
    # First come groups with most points on the front, then groups with the least error × seconds.
    series = series_of(rows)

    def rank(name: str) -> tuple:
        points = series[name]
        product = min(row["seconds"] * max(row["error"], row["uncertainty"]) for row in points)
        return -sum(bool(row.get("on front")) for row in points), product

    names = sorted(series, key=rank)
    chosen, rest = names[:MOST_LINES], names[MOST_LINES:]
    return {n: series[n] for n in chosen}, {n: series[n] for n in rest}


def grey_letters(rows: Iterable[Mapping]) -> dict[str, str]:
    """Return the letter of each series that is drawn in grey."""
    _, rest = split_series(rows)
    return dict(zip(sorted(rest), LETTERS, strict=False))


def draw_chart(chart: Any) -> Figure:
    """Draw the chart: see `Chart.figure`."""
    drawing, ax = new_figure(size=(10.0, 6.0))
    lines, rest = split_series(chart.table)
    if not lines:
        ax.text(0.5, 0.5, "no setting has an error", ha="center", transform=ax.transAxes)
        return drawing
    unit = " %" if all("error %" in row for row in _rows(lines)) else ""
    floor = next(iter(_rows(lines)))[f"uncertainty{unit}"]
    ax.set(xscale="log", yscale="log", xlabel="CPU time [s]")
    ax.set_ylabel(f"error of {chart.quantity} [{unit.strip() or chart.limit.unit}]")
    ax.set_title(chart.title, loc="left")
    key = "wide grey line: Pareto front; open: at most this error"
    ax.set_title(key, loc="right", fontsize=10, color="0.35")
    for name, letter in grey_letters(chart.table).items():
        x, y = _points(rest[name], unit)
        ax.plot(x, y, ls="", marker=f"${letter}$", ms=7, color="0.55", mew=0.3)
    ends = []
    for i, (name, rows) in enumerate(lines.items()):
        style = line_style(i)
        _draw_marks(ax, rows, unit, {**style, "ls": "", "ms": 4, "alpha": 0.35})
        x, y = _draw_marks(ax, best_rows(rows), unit, style)
        ends.append((name, str(style["color"]), x[-1], y[-1]))
    x, y = _points(sorted(chart.front, key=lambda row: row["seconds"]), unit)
    ax.plot(x, y, color="0.2", lw=9, alpha=0.2, zorder=1, solid_capstyle="round")
    _set_limits(ax, [*_rows(lines), *_rows(rest)], unit)
    _draw_band(ax, floor)
    use_plain_ticks(ax)
    label_ends(ax, ends)
    return drawing


def _draw_marks(ax, rows: Sequence[Mapping], unit: str, style: Mapping) -> tuple[list, list]:
    """Draw a line with a mark for each row, open where the error is a bound; return all points."""
    measured = [row for row in rows if row["error"] > row["uncertainty"]]
    ax.plot(*_points(measured, unit), **style)
    bounds = [row for row in rows if row not in measured]
    ax.plot(*_points(bounds, unit), **{**style, "ls": "", "mfc": "white"})
    return _points(rows, unit)


def best_rows(rows: Sequence[Mapping]) -> list[Mapping]:
    """Return the front of one series, the cheapest first."""
    better, least = [], math.inf
    for row in sorted(rows, key=lambda row: (row["seconds"], row["error"])):
        error = max(row["error"], row["uncertainty"])
        if error < BETTER * least:
            better.append(row)
            least = error
    return better


def _rows(series: Series) -> Iterable[Mapping]:
    return (row for rows in series.values() for row in rows)


def _points(rows: Iterable[Mapping], unit: str) -> tuple[list, list]:
    rows = list(rows)
    return [row["seconds"] for row in rows], [bound_of(row, unit) for row in rows]


def bound_of(row: Mapping, unit: str = "") -> float:
    """Return the error of a row; below its uncertainty it is not known, but at most their sum."""
    error, uncertainty = row[f"error{unit}"], row[f"uncertainty{unit}"]
    return error if error > uncertainty else error + max(uncertainty, LEAST)


def _set_limits(ax, rows: Sequence[Mapping], unit: str) -> None:
    x, y = _points(rows, unit)
    ax.set_xlim(min(x) / 1.4, max(x) * 1.4)
    ax.set_ylim(min(*y, rows[0][f"uncertainty{unit}"] or math.inf) / 2, max(y) * 1.6)


def _draw_band(ax, floor: float) -> None:
    """Shade the errors below the uncertainty of the limit."""
    if floor <= 0:
        return
    ax.axhspan(ax.get_ylim()[0], floor, color="0.93", zorder=0)
    text = "below: within the uncertainty of the limit"
    ax.text(0.01, 0.012, text, transform=ax.transAxes, fontsize=9, color="0.35")
