"""The result of `chart`: the Pareto front of error over CPU seconds, and what it says."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fecloth import errors
from fecloth.study.chart_figure import draw_chart, grey_letters
from fecloth.study.convergence import Convergence
from fecloth.study.figures import Figure
from fecloth.study.result import StudyResult, Table, with_uncertainty
from fecloth.study.status import OK

LEVELS = (10.0, 1.0, 0.1, 0.01)  # %, the errors that the verdict names


@dataclass(frozen=True, eq=False, repr=False)
class Chart(StudyResult):
    """What `chart` found: the table has a row for each setting."""

    quantity: str = ""  # text of the quantity
    # The converged limit of the problem: value, uncertainty, order; None if it was not found
    limit: Convergence | None = None
    others: tuple[str, ...] = ()  # quantities of interest that the chart is not of
    size: float = math.nan  # size of the quantity, in its unit; errors are a percentage of it

    @property
    def front(self) -> Table:
        """The rows that no other beats in error and seconds, the cheapest first."""
        rows = [row for row in self.table if row.get("on front")]
        return Table(tuple(sorted(rows, key=seconds_of)))

    def notes(self) -> list[str]:
        """Sentences on the limit, the grey points and the settings without an error."""
        lines = []
        if self.others:
            names = ", ".join(self.others)
            lines.append(f"All errors are of {self.quantity}, the first quantity; not of {names}.")
        if self.limit:
            convergence = self.limit
            value = convergence.limit if math.isfinite(convergence.limit) else convergence.value
            words = with_uncertainty(value, convergence.uncertainty, convergence.unit)
            verdict = convergence.verdict.splitlines()[0].partition(f": {self.quantity} = ")[0]
            lines.append(f"Limit: {self.quantity} = {words}; {verdict.rstrip('.')}.")
        letters = grey_letters(self.table)
        if letters:
            key = ", ".join(f"{letter} {name}" for name, letter in letters.items())
            lines.append(f"Grey letters in the figure: {key}.")
        without = [row["status"] for row in self.table if row["status"] != OK]
        counts = {status: without.count(status) for status in dict.fromkeys(without)}
        if counts:
            parts = ", ".join(f"{count} {status}" for status, count in counts.items())
            lines.append(f"Settings without an error: {parts}, of {len(self.table)}.")
        return lines

    def summary(self) -> str:
        """What the command prints: the verdict, the notes and the front."""
        words = (
            f"These are {len(self.front)} of {len(self.table)} settings: no other is as accurate\n"
            "at the same cost. The report has all."
        )
        return "\n".join([*self.words(), "", str(self.front), "", words])

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if no setting has an error."""
        return 0 if len(self.front) else errors.FAILED

    def figure(self) -> Figure:
        """Return the errors over CPU seconds: a line for each series of its best settings."""
        return draw_chart(self)


def find_front(rows: Sequence[Mapping]) -> set[int]:
    """Return the numbers of the rows that no other beats in both seconds and error."""
    # Errors below their uncertainty count as equal to it: there the cheapest is the best.
    known = [(row["seconds"], known_error(row), i) for i, row in enumerate(rows) if is_known(row)]
    front, least = set(), math.inf
    for _, error, i in sorted(known):
        if error < least:
            front.add(i)
            least = error
    return front


def seconds_of(row: Mapping) -> float:
    """Return the CPU seconds of a row."""
    return row["seconds"]


def is_known(row: Mapping) -> bool:
    """Whether the setting has an error."""
    return row["status"] == OK and math.isfinite(row["error"])


def known_error(row: Mapping, unit: str = "") -> float:
    """Return the error of a row, at least its uncertainty; `unit` is "" or " %"."""
    return max(row[f"error{unit}"], row[f"uncertainty{unit}"])


def describe_chart(table: Table, limit: Convergence) -> str:
    """Return the cheapest setting for each level of error, and the level that none reaches."""
    # A setting reaches a level if its error and the uncertainty together are below it.
    rows: list[Any] = [row for row in table if is_known(row)]
    if not rows:
        return "no setting has an error"
    if "error %" not in rows[0]:
        cheapest = min((row for row in rows if row["on front"]), key=known_error)
        error = f"error {cheapest['error']:.2g} {limit.unit}"
        words = f"for {cheapest['seconds']:.2g} s by {describe_row(cheapest)}"
        return f"{error} {words}; the limit is zero"
    several, last = len({row.get("model") for row in rows}) > 1, list[str]()
    named: dict[int, tuple[Any, list[str]]] = {}
    for level in LEVELS:
        reached = [row for row in rows if row["error %"] + row["uncertainty %"] <= level]
        if not reached:
            last = [_not_reached(level, rows)]
            break
        cheapest = min(reached, key=seconds_of)
        named.setdefault(id(cheapest), (cheapest, []))[1].append(f"{level:g}")
    lines = [
        f"{', '.join(levels)} %: {describe_row(row, several)}, {row['seconds']:.2g} s "
        f"({_stated_error(row)})"
        for row, levels in named.values()
    ]
    return "\n".join([*lines, *last])


def _stated_error(row: Mapping) -> str:
    """Return the error of a row; below its uncertainty only a bound is known."""
    if row["error %"] > row["uncertainty %"]:
        return f"error {row['error %']:.2g} %"
    return f"error at most {row['error %'] + row['uncertainty %']:.2g} %"


def _not_reached(level: float, rows: Iterable[Mapping]) -> str:
    known_to = next(iter(rows))["uncertainty %"]
    if known_to >= level:
        return f"the limit is known to {known_to:.2g} % only"
    return f"no setting is proved to reach {level:g} %"


def describe_row(row: Mapping, with_model: bool = True) -> str:
    """Return a setting in words."""
    parts = [f"{row['method']} with {row['element']}"]
    parts += [row["model"]] if with_model and row.get("model") else []
    if row.get("h"):
        h = row["h"]
        parts.append(f"h = {100 * h:.3g} cm" if h >= 0.0099 else f"h = {1e3 * h:.3g} mm")
    if row.get("rtol"):
        return ", ".join([*parts, f"rtol = {row['rtol']:g} 1/s"])
    if row.get("dt"):
        dt = row["dt"]
        parts.append(f"dt = {1e3 * dt:.3g} ms" if dt < 0.999 else f"dt = {dt:.3g} s")
    return ", ".join(parts)
