"""The longest step that holds, from runs with several steps: ranges and ties, in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from fecloth.study.status import FAILED, OK

WRONG = "wrong"  # the run reached its end with energy from nowhere, or with a warning
JUDGED = (OK, WRONG, FAILED)  # any other run, as one above the time limit, says nothing
Range = tuple[float, float]  # longest dt that holds, shortest longer one that does not [s]


def range_of(cells: Iterable[Mapping[str, Any]], good: tuple[str, ...] = (OK,)) -> Range:
    """Return the longest dt at and below which all runs are good, and the next one, which is not.

    The first is 0 if the shortest step is not good, the second infinite if all are; (0, inf)
    without a run that says something.

    Examples
    --------
    >>> cells = [{"dt": dt, "status": "ok"} for dt in (0.1, 0.2)]
    >>> range_of([*cells, {"dt": 0.4, "status": "failed"}]), range_of(cells)
    ((0.2, 0.4), (0.2, inf))
    >>> range_of([{"dt": 0.1, "status": "wrong"}, {"dt": 0.2, "status": "ok"}])
    (0.0, 0.1)
    """
    longest = 0.0
    for cell in sorted(cells, key=lambda cell: cell["dt"]):
        if cell["status"] not in JUDGED:
            continue
        if cell["status"] not in good:
            return longest, cell["dt"]
        longest = cell["dt"]
    return longest, math.inf


def describe_range(found: Range) -> str:
    """Return the words of a range of steps.

    Examples
    --------
    >>> [describe_range(r) for r in ((0.0025, 0.005), (0.025, math.inf), (0.0, 4.9e-5))]
    ['2.5–5 ms', '≥ 25 ms', '< 49 µs']
    >>> describe_range((0.0008, 0.0016)), describe_range((0.0, math.inf))
    ('0.8–1.6 ms', 'not known')
    """
    low, high = found
    if low == 0.0:
        return "not known" if math.isinf(high) else f"< {in_seconds(high)}"
    if math.isinf(high):
        return f"≥ {in_seconds(low)}"
    number, unit = _scaled(high)
    return f"{low * number / high:.3g}–{number:.3g} {unit}"


def describe_ratio(found: Range, predicted: float | None) -> str:
    """Return the measured range over the predicted limit; "" without a limit above 0.

    Examples
    --------
    >>> describe_ratio((0.7e-3, 1.4e-3), 1e-3), describe_ratio((0.0, 2e-3), 1e-3)
    ('0.7–1.4', '< 2')
    >>> describe_ratio((1e-3, math.inf), math.inf), describe_ratio((1e-3, math.inf), 2e-3)
    ('', '≥ 0.5')
    """
    low, high = found
    if not predicted or math.isinf(predicted) or (low == 0.0 and math.isinf(high)):
        return ""
    if low == 0.0:
        return f"< {high / predicted:.2g}"
    if math.isinf(high):
        return f"≥ {low / predicted:.2g}"
    return f"{low / predicted:.2g}–{high / predicted:.2g}"


def describe_limit(predicted: float | None) -> str:
    """Return the words of a predicted limit.

    Examples
    --------
    >>> [describe_limit(dt) for dt in (8.96e-4, math.inf, 0.0, None)]
    ['896 µs', 'none', '0 s', 'not known']
    """
    if predicted is None:
        return "not known"
    return "none" if math.isinf(predicted) else in_seconds(predicted) if predicted else "0 s"


def describe_best(ranges: Mapping[str, Range]) -> str:
    """Return which method holds the longest step; methods that the runs cannot tell apart tie.

    Examples
    --------
    >>> most = (0.025, math.inf)
    >>> describe_best({"bdf2": most, "newmark": most, "central_difference": (1e-3, 2e-3)})
    'bdf2 and newmark tie at ≥ 25 ms, the longest step that was tried'
    >>> describe_best({"bdf2": (0.0125, 0.025), "newmark": (0.005, 0.01)})
    'bdf2 holds the longest step, 12.5–25 ms'
    >>> describe_best({"a": (1e-3, 2e-3), "b": (0.9e-3, 1.8e-3)})
    'a and b tie: their ranges overlap between 900 µs and 2 ms'
    >>> describe_best({"a": (0.0, 1e-3)})
    'no method holds at a step that was tried'
    """
    longest = max((low for low, _ in ranges.values()), default=0.0)
    if longest == 0.0:
        return "no method holds at a step that was tried"
    best = {name: r for name, r in ranges.items() if r[0] > 0.0 and r[1] > longest * (1 + 1e-9)}
    lows, highs = zip(*best.values(), strict=True)
    if len(best) == 1:
        (name,) = best
        tried = ", the longest that was tried" if math.isinf(highs[0]) else ""
        return f"{name} holds the longest step, {describe_range(best[name])}{tried}"
    names = f"{', '.join(list(best)[:-1])} and {list(best)[-1]} tie"
    if min(lows) > longest * (1 - 1e-9) and len(set(highs)) == 1:
        tried = ", the longest step that was tried" if math.isinf(highs[0]) else ""
        return f"{names} at {describe_range(next(iter(best.values())))}{tried}"
    upper = "" if math.isinf(max(highs)) else f" and {in_seconds(max(highs))}"
    where = f"between {in_seconds(min(lows))}{upper}" if upper else f"above {in_seconds(min(lows))}"
    return f"{names}: their ranges overlap {where}"


def shorten(cause: str) -> str:
    """Return the cause of a failure or a warning without its numbers of steps and its advice.

    Examples
    --------
    >>> shorten("StepFailed: step 3 from t = 1 s with dt = 1 s failed: it moves, where (a) … Take")
    'it moves'
    >>> shorten("error in time about 13 % of the motion; dt = 0.5 ms would give 1 %")
    'error in time about 13 % of the motion'
    """
    if "the method has made the rest" in cause:
        return "the method makes energy"
    words = cause.partition(" failed: ")[2] or cause
    for end in (", where", "; ", ": ", " (", ". "):
        words = words.partition(end)[0]
    return words


def in_seconds(dt: float) -> str:
    """Return a time with its unit, to three digits.

    Examples
    --------
    >>> in_seconds(0.025), in_seconds(3.125e-5), in_seconds(1.5)
    ('25 ms', '31.2 µs', '1.5 s')
    """
    number, unit = _scaled(dt)
    return f"{number:.3g} {unit}"


def _scaled(dt: float) -> tuple[float, str]:
    for unit, factor in (("s", 1.0), ("ms", 1e3)):
        if dt * factor >= 1 - 1e-9:
            return dt * factor, unit
    return dt * 1e6, "µs"
