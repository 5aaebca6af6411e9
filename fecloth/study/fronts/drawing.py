"""The figure of a front: errors over CPU seconds, with h and dt of the best settings."""

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from fecloth.study.figures import (
    MOST_GROUPS,
    Figure,
    label_ends,
    line_style,
    new_figure,
    remove_overlaps,
    use_plain_ticks,
)
from fecloth.study.status import OK

Row = Mapping[str, Any]
Series = dict[str, list[Row]]


def is_known(row: Row) -> bool:
    """Whether the setting has an error, and the limit an uncertainty."""
    return row["status"] == OK and math.isfinite(row["error"] + row["uncertainty"])


def known_error(row: Row) -> float:
    """Return the error of a row, at least its uncertainty: below it an error means nothing."""
    return max(row["error"], row["uncertainty"])


def best_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that have less error than all cheaper rows, the cheapest first."""
    best = []
    least_error = math.inf
    for row in sorted(rows, key=lambda row: (row["seconds"], known_error(row))):
        if known_error(row) < least_error:
            best.append(row)
            least_error = known_error(row)
    return best


def series_of(rows: Sequence[Row]) -> Series:
    """Return the rows with an error by method, element and, where they vary, the other names."""
    known = [row for row in rows if is_known(row)]
    names = ["method", "element"]
    for name in ("model", "pattern", "terms"):
        if len({row.get(name) for row in known}) > 1:
            names.append(name)
    series: Series = {}
    for row in known:
        words = " ".join(str(row[name]) for name in names if row.get(name))
        series.setdefault(words, []).append(row)
    return series


def rank_series(series: Series) -> list[str]:
    """Return the names of the series, those with most points on the front first."""

    def sorting_key(name: str) -> tuple[int, float]:
        rows = series[name]
        on_front = sum(bool(row.get("on front")) for row in rows)
        return -on_front, min(row["seconds"] * known_error(row) for row in rows)

    return sorted(series, key=sorting_key)


def draw_front(table: Sequence[Row], title: str, quantity: str, unit: str) -> Figure:
    """Draw the errors over CPU seconds: a line for each series, and the front across them.

    The errors are in % of the size of the quantity or, if a row has none, in its `unit`. Up to
    eight series are lines, the points of all others are grey. A setting whose error is below its
    uncertainty has only a bound: its mark is open. The points say h and dt, those on the front
    first, where there is room. Without any error the figure only says so.
    """
    drawing, ax = new_figure(size=(10.0, 6.0))
    series = series_of(table)
    if not series:
        ax.text(0.5, 0.5, "no setting has an error", ha="center", transform=ax.transAxes)
        return drawing
    names = rank_series(series)
    known = [row for rows in series.values() for row in rows]
    percent = " %" if all("error %" in row for row in known) else ""
    ax.set(xscale="log", yscale="log", xlabel="CPU time [s]")
    ax.set_ylabel(f"error of {quantity} [{percent.strip() or unit}]")
    ax.set_title(title, loc="left")
    words = "wide grey line: front; open: at most this error"
    ax.set_title(words, loc="right", fontsize=10, color="0.35")
    for name in names[MOST_GROUPS:]:
        ax.plot(*_points(series[name], percent), ".", color="0.7", ms=5)
    ends = []
    front = best_rows(known)
    wide = {"color": "0.2", "lw": 9, "alpha": 0.2, "zorder": 1, "solid_capstyle": "round"}
    ax.plot(*_points(front, percent), **wide)
    labels = [_label_sizes(ax, row, percent, "0.2") for row in front]
    for i, name in enumerate(names[:MOST_GROUPS]):
        style = line_style(i)
        _draw_marks(ax, series[name], percent, {**style, "ls": "", "ms": 4, "alpha": 0.35})
        rows = best_rows(series[name])
        x, y = _draw_marks(ax, rows, percent, style)
        ends.append((name, str(style["color"]), x[-1], y[-1]))
        others = (row for row in rows if row not in front)
        labels += [_label_sizes(ax, row, percent, str(style["color"])) for row in others]
    x, y = _points(known, percent)
    floor = known[0][f"uncertainty{percent}"]  # of the limit, so it is the same in all rows
    lowest = min(*y, floor or math.inf)  # 0 has no place on a logarithmic axis
    ax.set(xlim=(min(x) / 1.4, max(x) * 1.4), ylim=(lowest / 2, max(y) * 1.6))
    if 0 < floor < math.inf:
        ax.axhspan(ax.get_ylim()[0], floor, color="0.93", zorder=0)
        below = "below: within the uncertainty of the limit"
        ax.text(0.01, 0.012, below, transform=ax.transAxes, fontsize=9, color="0.35")
    use_plain_ticks(ax)
    label_ends(ax, ends)
    remove_overlaps(labels)
    return drawing


def _label_sizes(ax: Any, row: Row, percent: str, colour: str) -> Any:
    """Write h and dt of a row beside its point, and return the text."""
    sizes = [f"h {1e3 * row['h']:.3g} mm"] if row.get("h") else []
    if row.get("rtol"):
        sizes.append(f"rtol {row['rtol']:.3g}/s")
    elif row.get("dt"):
        sizes.append(f"dt {1e3 * row['dt']:.3g} ms")
    return ax.annotate(
        ", ".join(sizes),
        (row["seconds"], bound_of(row, percent)),
        xytext=(4, 4),
        textcoords="offset points",
        fontsize=7,
        color=colour,
        annotation_clip=True,
    )


def _draw_marks(ax: Any, rows: Sequence[Row], percent: str, style: Mapping) -> tuple[list, list]:
    """Draw a line with a mark for each row, open where only a bound is known; return x and y."""
    measured = [row for row in rows if row["error"] > row["uncertainty"]]
    ax.plot(*_points(measured, percent), **style)
    bounds = [row for row in rows if row not in measured]
    ax.plot(*_points(bounds, percent), **{**style, "ls": "", "mfc": "white"})
    return _points(rows, percent)


def _points(rows: Sequence[Row], percent: str) -> tuple[list, list]:
    """Return the CPU seconds and the errors of rows; `percent` is " %" or ""."""
    return [row["seconds"] for row in rows], [bound_of(row, percent) for row in rows]


def bound_of(row: Row, percent: str = "") -> float:
    """Return the error of a row; below its uncertainty it is at most the sum of both.

    It is above 0, for a logarithmic axis.
    """
    error = row[f"error{percent}"]
    uncertainty = row[f"uncertainty{percent}"]
    if error > uncertainty:
        return error
    return error + max(uncertainty, sys.float_info.epsilon)
