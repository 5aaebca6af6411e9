"""A stability map in words and as a figure: ranges of steps, ties, runs over key and step."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from fecloth.study.figures import COLUMNS, MOST_GROUPS, Figure, new_figure
from fecloth.study.status import FAILED, OK

WRONG = "wrong"  # the run reached its end with energy from nowhere, or with a warning
JUDGED = (OK, WRONG, FAILED)  # any other run, as one above the time limit, says nothing
Range = tuple[float, float]  # longest dt that holds, shortest longer one that does not [s]


def range_of(cells: Iterable[Mapping[str, Any]], held: tuple[str, ...] = (OK,)) -> Range:
    """Return the longest dt up to which all runs hold, and the next longer one, which does not.

    A run holds if its status is one of `held`. A run that was stopped is left out, because it
    says nothing. The first dt is 0 if the shortest step does not hold; the second is infinite if
    all steps hold. If all runs are left out, the range is 0 and infinite. Times are in s.
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
    """Return a range of steps in words, as "1.2–1.3 ms".

    Without a step that holds it is as "< 1.3 ms", without one that does not hold as "≥ 1.2 ms".
    """
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
    """Return the measured range over the predicted limit in words, as "0.94–1.1".

    Return "" without a predicted limit above 0, or if the measured range is not known.
    """
    low, high = longest
    if not predicted or math.isinf(predicted) or (low == 0.0 and math.isinf(high)):
        return ""
    if low == 0.0:
        return f"< {high / predicted:.2g}"
    if math.isinf(high):
        return f"≥ {low / predicted:.2g}"
    return f"{low / predicted:.2g}–{high / predicted:.2g}"


def describe_limit(predicted: float | None) -> str:
    """Return a predicted limit [s] in words; None is not known, infinite is none."""
    if predicted is None:
        return "not known"
    if math.isinf(predicted):
        return "none"
    if not predicted:
        return "0 s"
    return in_seconds(predicted)


def describe_best(ranges: Mapping[str, Range]) -> str:
    """Return a sentence on which method holds the longest step, or which methods tie.

    `ranges` are the ranges of `range_of` by the name of the method. Methods tie if their ranges
    overlap: then the measured limits may be the same.
    """
    longest = max((low for low, _ in ranges.values()), default=0.0)
    if longest == 0.0:
        return "no method holds at a step that was tried"
    # The methods that hold the longest step, or may hold it: their range does not end below it.
    # 1e-9 is for round-off: steps of two methods that should be equal may differ by it.
    best = {
        name: (low, high)
        for name, (low, high) in ranges.items()
        if low > 0.0 and high > longest * (1 + 1e-9)
    }
    *others, last = best
    range_words = describe_range(best[last])
    lowest = min(low for low, _ in best.values())
    highest = max(high for _, high in best.values())
    if not others:
        words = f"{last} holds the longest step, {range_words}"
        if math.isinf(highest):
            return f"{words}, the longest that was tried"
        return words
    names = f"{', '.join(others)} and {last} tie"
    have_same_range = lowest > longest * (1 - 1e-9) and len({h for _, h in best.values()}) == 1
    if have_same_range and math.isinf(highest):
        return f"{names} at {range_words}, the longest step that was tried"
    if have_same_range:
        return f"{names} at {range_words}"
    if math.isinf(highest):
        return f"{names}: their ranges overlap above {in_seconds(lowest)}"
    between = f"between {in_seconds(lowest)} and {in_seconds(highest)}"
    return f"{names}: their ranges overlap {between}"


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
    """Return a time in the largest unit in which it is at least 1, and the unit."""
    for unit, factor in (("s", 1.0), ("ms", 1e3)):
        if dt * factor >= 1 - 1e-9:
            return dt * factor, unit
    return dt * 1e6, "µs"


LOOKS: dict[str, dict[str, Any]] = {
    OK: {"marker": "o", "color": "#0072B2"},
    WRONG: {"marker": "^", "color": "#E69F00"},
    FAILED: {"marker": "X", "color": "#D55E00"},
    "stopped": {"marker": "s", "color": "0.6", "mfc": "none"},
}
LIMIT: dict[str, Any] = {"color": "black", "lw": 2, "label": "predicted limit"}


def draw_map(stability: Any) -> Figure:
    """Draw the runs of a `StabilityMap`: dt of each run over the values of the varied keys.

    There is a panel for each of the first eight methods. Marks show how a run ended; the line
    is the predicted limit of explicit methods.
    """
    methods = stability.methods[:MOST_GROUPS]
    columns = min(COLUMNS, len(methods))
    rows = math.ceil(len(methods) / columns)
    size = max(2.9 * columns, 6.0), 3.1 * rows + 1.1
    drawing, axes = new_figure(rows, columns, size, squeeze=False, sharex=True, sharey=True)
    panels = axes.ravel()
    cells = stability.cells
    values = [tuple(cell[key] for key in stability.keys) for cell in cells]
    x = _places(values)
    for ax, method in zip(panels, methods, strict=False):  # more panels may be left over
        runs_of_method = [i for i, cell in enumerate(cells) if cell["method"] == method]
        _draw_runs(ax, [cells[i] for i in runs_of_method], [x[i] for i in runs_of_method])
        ax.set_title(method.replace("_", " "), fontsize=11)
    steps = [cell["dt"] for cell in cells if cell["dt"]]
    are_numbers = not isinstance(x[0], str)
    first_panel = panels[0]  # all panels share its axes
    first_panel.set(yscale="log", ylim=(min(steps) / 1.5, max(steps) * 1.5))
    if are_numbers and max(x) >= 10 * min(x):  # a decade or more
        first_panel.set(xscale="log", xlim=(min(x) / 1.5, max(x) * 1.5))
    elif not are_numbers:
        first_panel.set_xlim(-0.6, len(set(x)) - 0.4)
    # the lowest panel of each column has the labels of the axis
    for ax in panels[max(len(methods) - columns, 0) : len(methods)]:
        ax.tick_params("x", labelbottom=True)
        if not are_numbers and max(map(len, x)) > 6:  # longer texts would overlap
            ax.tick_params("x", rotation=30)
    for ax in panels[len(methods) :]:
        ax.set_axis_off()
    drawing.supylabel("time step [s]")
    if stability.keys:
        drawing.supxlabel(", ".join(stability.keys))
    _draw_legend(drawing, panels)
    return drawing


def _draw_legend(drawing: Figure, panels: Iterable[Any]) -> None:
    """Draw one legend for all panels above them, with each label once."""
    line_of = {}  # a line of any panel, by its label
    for ax in panels:
        for line, label in zip(*ax.get_legend_handles_labels(), strict=True):
            line_of[label] = line
    drawing.legend(
        list(line_of.values()),
        list(line_of),
        loc="outside upper center",
        ncols=len(line_of),
        frameon=False,
    )


def _places(values: Sequence[tuple]) -> list:
    """Return the places of combinations of values on the axis.

    They are the values of the only key, if these are numbers above 0, else texts.
    """
    if all(len(v) == 1 and isinstance(v[0], int | float) and v[0] > 0 for v in values):
        return [value for (value,) in values]
    return [", ".join(map(str, combination)) for combination in values]


def _draw_runs(ax, cells: Sequence[Mapping], x: Sequence) -> None:
    """Draw the runs of a method at their places x, and the predicted limit.

    `cells` are the rows of the runs. A limit that is not known, 0 or infinite is not drawn. If
    it is the same everywhere, it is a line across the panel.
    """
    pairs = list(zip(x, cells, strict=True))
    ax.plot(x, [math.nan] * len(x), ls="")  # the axis has all places, in their order
    for state, look in LOOKS.items():  # a label in the legend for each state
        points = [(place, cell["dt"]) for place, cell in pairs if _state_of(cell) == state]
        if points:
            places = [place for place, _ in points]
            steps = [dt for _, dt in points]
            ax.plot(places, steps, ls="", ms=7, label=state, **look)
    limits = {}
    for place, cell in pairs:
        if cell["predicted"] and math.isfinite(cell["predicted"]):
            limits[place] = cell["predicted"]
    if len(limits) == 1:
        ax.axhline(next(iter(limits.values())), **LIMIT)
    elif limits:
        places = list(limits)
        if not isinstance(x[0], str):
            places = sorted(limits)
        ax.plot(places, [limits[place] for place in places], **LIMIT)


def _state_of(cell: Mapping[str, Any]) -> str:
    """Return the status of a run; "stopped" if it says nothing about the step."""
    if cell["status"] in JUDGED:
        return cell["status"]
    return "stopped"
