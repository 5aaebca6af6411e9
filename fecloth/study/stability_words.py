"""A stability map in words and as a figure: ranges of steps, ties, runs over key and step."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from fecloth.study.figures import Figure, new_figure
from fecloth.study.status import FAILED, OK

WRONG = "wrong"  # the run reached its end with energy from nowhere, or with a warning
JUDGED = (OK, WRONG, FAILED)  # any other run, as one above the time limit, says nothing
Range = tuple[float, float]  # longest dt that holds, shortest longer one that does not [s]


def range_of(cells: Iterable[Mapping[str, Any]], held: tuple[str, ...] = (OK,)) -> Range:
    """Return the longest dt at and below which all runs are good, and the next one, that is not.

    The first is 0 if the shortest step is not good, the second infinite if all are; (0, inf)
    without a run that says something.
    """
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
        if math.isinf(high):
            return "not known"
        return f"< {in_seconds(high)}"
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
    if math.isinf(predicted):
        return "none"
    return in_seconds(predicted) if predicted else "0 s"


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
        if math.isinf(highs[0]):
            tried = ", the longest step that was tried"
        else:
            tried = ""
        return f"{names} at {describe_range(next(iter(longest_ranges.values())))}{tried}"
    upper = "" if math.isinf(max(highs)) else f" and {in_seconds(max(highs))}"
    if upper:
        where = f"between {in_seconds(min(lows))}{upper}"
    else:
        where = f"above {in_seconds(min(lows))}"
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
    size = max(2.9 * columns, 6.0), 3.1 * rows + 1.1
    drawing, axes = new_figure(rows, columns, size, squeeze=False, sharex=True, sharey=True)
    panels = axes.ravel()
    cells = stability.cells
    values = [tuple(cell[key] for key in stability.keys) for cell in cells]
    x = _places(values)
    for ax, method in zip(panels, methods, strict=False):
        own = [i for i, cell in enumerate(cells) if cell["method"] == method]
        _draw_runs(ax, [cells[i] for i in own], [x[i] for i in own])
        ax.set_title(method.replace("_", " "), fontsize=11)
    steps = [cell["dt"] for cell in cells if cell["dt"]]
    numbers = not isinstance(x[0], str)
    first = panels[0]
    first.set(yscale="log", ylim=(min(steps) / 1.5, max(steps) * 1.5))
    if numbers and max(x) >= 10 * min(x):
        first.set(xscale="log", xlim=(min(x) / 1.5, max(x) * 1.5))
    elif not numbers:
        first.set_xlim(-0.6, len(set(x)) - 0.4)
    for ax in panels[max(len(methods) - columns, 0) : len(methods)]:
        ax.tick_params("x", labelbottom=True)
        if not numbers and max(map(len, x)) > 6:
            ax.tick_params("x", rotation=30)
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


def _places(values: Sequence[tuple]) -> list:
    """Return the values of the only key if they are numbers above 0, else combinations as texts."""
    if all(len(v) == 1 and isinstance(v[0], int | float) and v[0] > 0 for v in values):
        return [value for (value,) in values]
    return [", ".join(map(str, each)) for each in values]


def _draw_runs(ax, cells: Sequence[Mapping], x: Sequence) -> None:
    pairs = list(zip(x, cells, strict=True))
    ax.plot(x, [math.nan] * len(x), ls="")  # the axis has all places, in their order
    for state, look in LOOKS.items():
        at = [
            (place, cell["dt"])
            for place, cell in pairs
            if (cell["status"] if cell["status"] in JUDGED else "stopped") == state
        ]
        if at:
            ax.plot(*zip(*at, strict=True), ls="", ms=7, label=state, **look)
    limits = {place: cell["predicted"] for place, cell in pairs}
    known = {place: each for place, each in limits.items() if each and math.isfinite(each)}
    if len(known) == 1:
        ax.axhline(next(iter(known.values())), **LIMIT)
    elif known:
        order = list(known) if isinstance(x[0], str) else sorted(known)
        ax.plot(order, [known[place] for place in order], **LIMIT)
