"""A stability map in words and as a figure: ranges of steps, ties, runs over key and step."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from fecloth.study.figures import Figure, new_figure
from fecloth.study.status import FAILED, OK

WRONG = "wrong"  # the run reached its end with energy from nowhere, or with a warning
JUDGED = (OK, WRONG, FAILED)  # any other run, as one above the time limit, says nothing
Range = tuple[float, float]  # longest dt that holds, shortest longer one that does not [s]


def range_of(cells: Iterable[Mapping[str, Any]], held: tuple[str, ...] = (OK,)) -> Range:
    """Return the longest dt at and below which all runs are good, and the next one, that is not."""
    # The first is 0 if the shortest step is not good, the second infinite if all are; (0, inf)
    # without a run that says something.
    longest = 0.0
    for cell in sorted(cells, key=lambda cell: cell["dt"]):
        if cell["status"] not in JUDGED:
            continue
        if cell["status"] not in held:
            return longest, cell["dt"]
        longest = cell["dt"]
    return longest, math.inf


def describe_range(longest: Range) -> str:
    low, high = longest
    if low == 0.0:
        return "not known" if math.isinf(high) else f"< {in_seconds(high)}"
    if math.isinf(high):
        return f"≥ {in_seconds(low)}"
    number, unit = _scaled(high)
    return f"{low * number / high:.3g}–{number:.3g} {unit}"


def describe_ratio(longest: Range, predicted: float | None) -> str:
    """Return the measured range over the predicted limit; "" without a limit above 0."""
    low, high = longest
    if not predicted or math.isinf(predicted) or (low == 0.0 and math.isinf(high)):
        return ""
    if low == 0.0:
        return f"< {high / predicted:.2g}"
    if math.isinf(high):
        return f"≥ {low / predicted:.2g}"
    return f"{low / predicted:.2g}–{high / predicted:.2g}"


def describe_limit(predicted: float | None) -> str:
    if predicted is None:
        return "not known"
    return "none" if math.isinf(predicted) else in_seconds(predicted) if predicted else "0 s"


def describe_best(ranges: Mapping[str, Range]) -> str:
    """Return which method holds the longest step; methods that the runs cannot tell apart tie."""
    longest = max((low for low, _ in ranges.values()), default=0.0)
    if longest == 0.0:
        return "no method holds at a step that was tried"
    longest_ranges = {
        name: r for name, r in ranges.items() if r[0] > 0.0 and r[1] > longest * (1 + 1e-9)
    }
    lows, highs = zip(*longest_ranges.values(), strict=True)
    if len(longest_ranges) == 1:
        (name,) = longest_ranges
        tried = ", the longest that was tried" if math.isinf(highs[0]) else ""
        return f"{name} holds the longest step, {describe_range(longest_ranges[name])}{tried}"
    names = f"{', '.join(list(longest_ranges)[:-1])} and {list(longest_ranges)[-1]} tie"
    if min(lows) > longest * (1 - 1e-9) and len(set(highs)) == 1:
        tried = ", the longest step that was tried" if math.isinf(highs[0]) else ""
        return f"{names} at {describe_range(next(iter(longest_ranges.values())))}{tried}"
    upper = "" if math.isinf(max(highs)) else f" and {in_seconds(max(highs))}"
    where = f"between {in_seconds(min(lows))}{upper}" if upper else f"above {in_seconds(min(lows))}"
    return f"{names}: their ranges overlap {where}"


def shorten(cause: str) -> str:
    """Return the cause of a failure or a warning without its numbers of steps and its advice."""
    if "the method has made the rest" in cause:
        return "the method makes energy"
    words = cause.partition(" failed: ")[2] or cause
    for end in (", where", "; ", ": ", " (", ". "):
        words = words.partition(end)[0]
    return words


def in_seconds(dt: float) -> str:
    """Return a time with its unit, to three digits."""
    number, unit = _scaled(dt)
    return f"{number:.3g} {unit}"


def _scaled(dt: float) -> tuple[float, str]:
    for unit, factor in (("s", 1.0), ("ms", 1e3)):
        if dt * factor >= 1 - 1e-9:
            return dt * factor, unit
    return dt * 1e6, "µs"


MOST_PANELS = 8
LOOKS: dict[str, dict[str, Any]] = {
    OK: {"marker": "o", "color": "#0072B2"},
    WRONG: {"marker": "^", "color": "#E69F00"},
    FAILED: {"marker": "X", "color": "#D55E00"},
    "stopped": {"marker": "s", "color": "0.6", "mfc": "none"},
}
LIMIT: dict[str, Any] = {"color": "black", "lw": 2, "label": "predicted limit"}
COLUMNS = 4


def draw_map(stability: Any) -> Figure:
    """Draw the runs of a `StabilityMap`; the line is the predicted limit of explicit methods."""
    methods = stability.methods[:MOST_PANELS]
    columns = min(COLUMNS, len(methods))
    rows = math.ceil(len(methods) / columns)
    drawing, axes = new_figure(rows, columns, (max(2.9 * columns, 6.0), 3.1 * rows + 1.1))
    panels = np.atleast_1d(axes).ravel()
    places = _places(stability)
    steps = [cell["dt"] for cell in stability.cells if cell["dt"]]
    for i, (ax, method) in enumerate(zip(panels, methods, strict=False)):
        own = [cell for cell in stability.cells if cell["method"] == method]
        _draw_runs(ax, own, [_place(cell, stability.keys, places) for cell in own])
        ax.set_title(method.replace("_", " "), fontsize=11)
        ax.set(yscale="log", ylim=(min(steps) / 1.5, max(steps) * 1.5))
        _set_places(ax, stability.keys, places, labelled=i + columns >= len(methods))
        if i % columns:
            ax.set_yticklabels([])
    for ax in panels[len(methods) :]:
        ax.set_axis_off()
    drawing.supylabel("time step [s]")
    if stability.keys:
        drawing.supxlabel(", ".join(stability.keys))
    shown = [zip(*ax.get_legend_handles_labels(), strict=True) for ax in panels]
    lines = {label: handle for pairs in shown for handle, label in pairs}
    look: dict[str, Any] = {"loc": "outside upper center", "ncols": len(lines), "frameon": False}
    drawing.legend(list(lines.values()), list(lines), **look)
    return drawing


def _places(stability: Any) -> list:
    """Return the values of the only key if they are numbers above 0, else the combinations."""
    values: list = []
    for cell in stability.cells:
        value = tuple(cell[key] for key in stability.keys)
        values += [] if value in values else [value]
    numbers = len(stability.keys) == 1 and all(
        isinstance(value, int | float) and value > 0 for (value,) in values
    )
    return sorted(value for (value,) in values) if numbers else values


def _place(cell: Mapping, keys: Sequence[str], places: list) -> float:
    """Return where a run stands: at the value of the key, or at the number of its combination."""
    values = tuple(cell[key] for key in keys)
    return places.index(values) if values in places else float(values[0])


def _draw_runs(ax, cells: Sequence[Mapping], x: Sequence[float]) -> None:
    for state, look in LOOKS.items():
        at = [
            (place, cell["dt"])
            for place, cell in zip(x, cells, strict=True)
            if (cell["status"] if cell["status"] in JUDGED else "stopped") == state
        ]
        if at:
            ax.plot(*zip(*at, strict=True), ls="", ms=7, label=state, **look)
    limits = {
        place: cell["predicted"]
        for place, cell in zip(x, cells, strict=True)
        if cell["predicted"] and math.isfinite(cell["predicted"])
    }
    if len(limits) == 1:
        ax.axhline(next(iter(limits.values())), **LIMIT)
    elif limits:
        ax.plot(sorted(limits), [limits[place] for place in sorted(limits)], **LIMIT)


def _set_places(ax, keys: Sequence[str], places: list, labelled: bool) -> None:
    """Set the axis of the values: logarithmic over a factor of ten, or named combinations."""
    if places and not isinstance(places[0], tuple):
        if places[-1] >= 10 * places[0]:
            ax.set(xscale="log", xlim=(places[0] / 1.5, places[-1] * 1.5))
        if not labelled:
            ax.set_xticklabels([])
        return
    names = [", ".join(str(value) for value in values) for values in places]
    turned = {"rotation": 30, "ha": "right"} if max(map(len, names), default=0) > 6 else {}
    ax.set_xticks(range(len(places)), names if labelled and keys else [""] * len(places), **turned)
    ax.set_xlim(-0.6, len(places) - 0.4)
