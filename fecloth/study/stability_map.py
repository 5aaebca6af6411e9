"""`stability`: where each method fails, over the step and the values of any key."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

from fecloth import errors
from fecloth.errors import InputError
from fecloth.integrators import studied_by
from fecloth.scene.scene import Scene
from fecloth.study.figures import Figure
from fecloth.study.opened import Opened, open_study
from fecloth.study.result import StudyResult, Table
from fecloth.study.run_table import row_of_run
from fecloth.study.runs import Run
from fecloth.study.scene_source import describe_values
from fecloth.study.stability_figure import draw_map
from fecloth.study.stability_runs import (
    ALL_METHODS,
    JUDGED,
    WRONG,
    Range,
    list_runs,
    range_of,
    search,
)
from fecloth.study.status import OK
from fecloth.study.variants import combine, known_names, plan, read_ranges

LONGEST_CASE = 120.0  # usual limit of the CPU time of a run [s]


@dataclass(frozen=True, eq=False, repr=False)
class StabilityMap(StudyResult):
    """The result of `stability`: the table has a row for each method and combination of values.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        One row for each run or level; see `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    keys
        Names of the keys that were varied.
    methods
        Names of the methods.
    cells
        One row for each run: method, values, dt, status ("ok", "wrong", "failed", or the
        status of a case that was stopped), cause, energy made over the energy that moved,
        CPU seconds.
    """

    keys: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    cells: Table = field(default_factory=lambda: Table(()))

    @property
    def has_stopped(self) -> bool:
        """Whether a run was stopped: the map has a hole there."""
        return any(row["status"] not in JUDGED for row in self.cells)

    def figure(self) -> Figure:
        """Return a panel for each of the first eight methods: its runs and predicted limit."""
        return draw_map(self.cells, self.methods, self.keys)

    def notes(self) -> list[str]:
        """What the columns mean."""
        return [
            "Longest step: up to it the runs reach the end, make at most 5 % of the energy that "
            "moves, and do not warn. Longer steps may be wrong and yet not fail.",
        ]

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if the map has a hole."""
        if self.has_stopped:
            return errors.FAILED
        return 0

    def report(self, folder: str | Path) -> Path:
        """Write report.html, results.csv, the figure, and runs.csv with every run."""
        page = super().report(folder)
        self.cells.to_csv(Path(folder) / "runs.csv")
        return page


def stability(
    problem: Scene | str | Path | Callable | Opened,
    over: str | Iterable[str] | Mapping[str, Sequence] | None = None,
    methods: Sequence[str] | None = None,
    **shared: Any,
) -> StabilityMap:
    """Run a problem with each method and with steps from long to short: where does it fail?

    System, start and time come from the problem; its own method and step are not used. Each
    method takes its defaults. Implicit ones take 8, 16, … 256 steps; explicit ones six steps
    within 2.8 and 0.35 times their predicted limit, `critical_dt` at the start. Where the
    shortest step does not hold, half of it runs, and so on up to six times, unless it would
    take longer than the time limit of a case; where the longest one does not fail, twice of it,
    down to a single step. A measured limit is a range: 12 % wide where the prediction is right
    and the run has 100 steps (shorter ones show growth less), else a factor of two at most.

    A run is "ok"; "failed" if a step failed, with the cause; or "wrong": it reached the end, but
    made more than 5 % of the energy that moved, or warned, as of a large error in time. Raises
    `InputError` for an unknown method or key, an equilibrium, and if the problem refuses every
    value. One of several that is refused gives rows with the reason.

    Parameters
    ----------
    problem
        As for `of`; one in time.
    over
        Values of one or more keys, as for `sweep`; without, the problem as it is.
    methods
        Names as in a scene, such as "bdf2" or "central_difference"; by default eight.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
        A function may take dt, but the steps are the steps of the map.
    """
    names = methods
    if names is None:
        names = studied_by("stability")
    allowed = f"must be names of {', '.join(ALL_METHODS)}"
    if isinstance(names, str) or not names:
        raise InputError(f"methods = {names!r}", allowed, "stability")
    chosen_methods = known_names("method", names, ALL_METHODS, allowed, "stability")
    ranges = read_ranges(over) if over else {}
    combinations = combine(ranges)
    opened, how, doubts = open_study(problem, shared).begin(combinations[0], LONGEST_CASE)

    def make(values: dict) -> list[Run]:
        return list_runs(opened.at(values), values, chosen_methods)

    planned = plan(make, combinations)
    rows = search([run for run in chain(*planned) if isinstance(run, Run)], how)
    for values, (first, *_) in zip(combinations, planned, strict=True):
        if not isinstance(first, Run):  # a row with the reason, for each method
            unknown = {"values": values, "dt": None, "steps": None, "predicted": None}
            rows += [{"method": method, **unknown, **first} for method in chosen_methods]
    maps = [
        (method, values, [r for r in rows if (r["method"], r["values"]) == (method, values)])
        for method in chosen_methods
        for values in combinations
    ]
    return StabilityMap(
        title=opened.name,
        doubts=doubts,
        verdict=_verdict(maps),
        table=Table(tuple(_table_row(*of_method) for of_method in maps)),
        keys=tuple(ranges),
        methods=tuple(chosen_methods),
        cells=Table(tuple(map(_cells_of, rows))),
    )


def _cells_of(row: Mapping) -> dict[str, Any]:
    """Return the cells of a run in runs.csv."""
    settings = {"method": row["method"], **row["values"], "dt": row["dt"], "steps": row["steps"]}
    results = {"cause": row["cause"], "energy made": row.get("made"), "predicted": row["predicted"]}
    return row_of_run(row, settings, results)


def _table_row(method: str, values: Mapping, rows: Sequence[Mapping]) -> dict:
    """Return the row of the table for a method with a combination of values.

    It has the measured limit as a range, the predicted limit, and what happens with the next
    longer step. `rows` are the rows of its runs.
    """
    low, high = range_of(rows)
    predicted = rows[0]["predicted"]  # the same in all of them
    ratio = ""
    if low and predicted and math.isfinite(high + predicted):
        ratio = f"{low / predicted:.2g}–{high / predicted:.2g}"
    # the shortest step that does not hold; else a run that was stopped, if there is one
    told = [(row["status"], shorten(row["cause"])) for row in rows if row["dt"] == high]
    told += [(row["status"], row["cause"]) for row in rows if row["status"] not in JUDGED]
    return {
        "method": method,
        **values,
        "longest step": describe_range((low, high)),
        "does not fail up to": describe_range(range_of(rows, (OK, WRONG))),
        "predicted limit": describe_limit(predicted),
        "measured over predicted": ratio,
        "next step": ": ".join(told[0]) if told else "",
    }


def _verdict(maps: Sequence[tuple[str, Mapping, Sequence[Mapping]]]) -> str:
    """Return which methods hold the longest step, on a line for each combination of values.

    If it is the same for all combinations, there is only one line. `maps` has the method, the
    values and the rows of each range.
    """
    ranges: dict[str, dict[str, Range]] = {}
    for method, values, rows in maps:
        if any(row["dt"] for row in rows):  # not refused
            ranges.setdefault(describe_values(values), {})[method] = range_of(rows)
    best = {name: describe_best(of_methods) for name, of_methods in ranges.items()}
    if len(set(best.values())) == 1:
        (words,) = set(best.values())
        return words if len(best) == 1 else f"at every value {words}"
    return "\n".join(f"{name}: {words}" for name, words in best.items())


def describe_best(ranges: Mapping[str, Range]) -> str:
    """Return a sentence on which methods hold the longest step.

    `ranges` are the ranges of `range_of` by the name of the method. Methods tie if their ranges
    overlap: then the measured limits may be the same.
    """
    longest = max(low for low, _ in ranges.values())
    if longest == 0.0:
        return "no method holds at a step that was tried"
    # 1e-9 is for round-off: steps of two methods that should be equal may differ by it
    best = {
        name: high
        for name, (low, high) in ranges.items()
        if low > 0.0 and high > longest * (1 + 1e-9)
    }
    *others, last = best
    names = f"{', '.join(others)} and {last} hold" if others else f"{last} holds"
    return f"{names} the longest step, {describe_range((longest, max(best.values())))}"


def describe_range(longest: Range) -> str:
    """Return a range of steps in words, as "1.2–1.3 ms".

    Without a step that holds it is as "< 1.3 ms", without one that does not hold as "≥ 1.2 ms".
    """
    low, high = longest
    if low == 0.0:
        return "not known" if math.isinf(high) else f"< {in_seconds(high)}"
    if math.isinf(high):
        return f"≥ {in_seconds(low)}"
    number, unit = _scaled(high)
    return f"{low * number / high:.3g}–{number:.3g} {unit}"


def describe_limit(predicted: float | None) -> str:
    """Return a predicted limit [s] in words; None is not known, infinite is none."""
    if predicted is None:
        return "not known"
    return "none" if math.isinf(predicted) else in_seconds(predicted)


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
