"""The result of `chart`: the Pareto front of error over CPU seconds, and what it says."""

import math
import string
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fecloth import errors
from fecloth.study.comparison import best_value
from fecloth.study.convergence import Convergence
from fecloth.study.figures import (
    MOST_GROUPS,
    Figure,
    label_ends,
    line_style,
    new_figure,
    use_plain_ticks,
)
from fecloth.study.result import StudyResult, Table, with_uncertainty
from fecloth.study.status import OK

# The verdict names the cheapest setting for an error of 10, 1, 0.1 and 0.01 %.
LARGEST_NAMED_ERROR = 10.0
LEAST_NAMED_ERROR = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Chart(StudyResult):
    """The result of `chart`: the table has a row for each setting.

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
    quantity
        Text of the quantity.
    limit
        The converged limit of the problem: value, uncertainty, order. It is None if it was
        not found.
    others
        Quantities of interest for which the chart has no errors.
    size
        Size of the quantity, in its unit; errors are a percentage of it.
    """

    quantity: str = ""
    limit: Convergence | None = None
    others: tuple[str, ...] = ()
    size: float = math.nan

    @property
    def front(self) -> Table:
        """The rows that no other beats in error and seconds, the cheapest first."""
        rows = [row for row in self.table if row.get("on front")]
        return Table(tuple(sorted(rows, key=seconds_of)))

    def notes(self) -> list[str]:
        """Sentences on the limit, the grey letters and the settings without an error."""
        lines = []
        if self.others:
            names = ", ".join(self.others)
            lines.append(f"All errors are of {self.quantity}, the first quantity; not of {names}.")
        if study := self.limit:
            words = with_uncertainty(best_value(study), study.uncertainty, study.unit)
            # The verdict begins such as "converges as it should (…): u = 1.2 ± 0.1 mm": only its
            # first part is shown, because the limit stands in the sentence already.
            verdict = study.verdict.splitlines()[0].partition(f": {self.quantity} = ")[0]
            lines.append(f"Limit: {self.quantity} = {words}; {verdict.rstrip('.')}.")
        if key := ", ".join(f"{sign} {name}" for name, sign in grey_letters(self.table).items()):
            lines.append(f"Grey letters in the figure: {key}.")
        counts = Counter(row["status"] for row in self.table if row["status"] != OK)
        if parts := ", ".join(f"{count} {status}" for status, count in counts.items()):
            lines.append(f"Settings without an error: {parts}, of {len(self.table)}.")
        return lines

    def summary(self) -> str:
        """What the command prints: the verdict, the notes and the front."""
        count = f"These are {len(self.front)} of {len(self.table)} settings"
        words = f"{count}: no other is as accurate\nat the same cost. The report has all."
        return "\n".join([*self.words(), "", str(self.front), "", words])

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if no setting has an error."""
        if len(self.front):
            return 0
        return errors.FAILED

    def figure(self) -> Figure:
        """Return the errors over CPU seconds: a line for each series of its best settings."""
        return draw_chart(self)


def find_front(rows: Sequence[Mapping]) -> set[int]:
    """Return the numbers of the rows that no other beats in both seconds and error.

    Errors below their uncertainty count as equal to it: there the cheapest is the best.
    """
    rows_with_error = [row for row in rows if is_known(row)]
    best = {id(row) for row in best_rows(rows_with_error)}
    return {i for i, row in enumerate(rows) if id(row) in best}


def best_rows(rows: Sequence[Mapping]) -> list[Mapping]:
    """Return the rows that have less error than all cheaper rows, the cheapest first."""
    best = []
    least_error = math.inf
    for row in sorted(rows, key=lambda row: (row["seconds"], known_error(row))):
        if known_error(row) < least_error:
            best.append(row)
            least_error = known_error(row)
    return best


def seconds_of(row: Mapping) -> float:
    """Return the CPU seconds of a setting."""
    return row["seconds"]


def is_known(row: Mapping) -> bool:
    """Whether the setting has an error."""
    return row["status"] == OK and math.isfinite(row["error"])


def known_error(row: Mapping) -> float:
    """Return the error of a row, at least its uncertainty."""
    return max(row["error"], row["uncertainty"])


def describe_chart(table: Table, limit: Convergence) -> str:
    """Return a line on the cheapest setting for each of the errors 10, 1, 0.1 and 0.01 %.

    A setting reaches an error if its own error and the uncertainty together are not above it.
    The last line says which error no setting reaches, if there is one. If the quantity has no
    size, because its limit is zero, return the setting with the least error, in the unit of the
    quantity. `limit` is the convergence of the problem.
    """
    rows: list[Any] = [row for row in table if is_known(row)]
    if not rows:
        return "no setting has an error"
    if "error %" not in rows[0]:
        cheapest = min((row for row in rows if row["on front"]), key=known_error)
        error_words = f"error {cheapest['error']:.2g} {limit.unit}"
        cost_words = f"for {cheapest['seconds']:.2g} s by {describe_row(cheapest)}"
        return f"{error_words} {cost_words}; the limit is zero"
    several_models = len({row.get("model") for row in rows}) > 1
    last_lines = list[str]()
    # One setting may be the cheapest for several errors: then they share a line. Rows are not
    # hashable, so both dicts have the id of the row as key.
    cheapest_rows: dict[int, Any] = {}
    errors_of: dict[int, list[str]] = {}
    named_error = LARGEST_NAMED_ERROR
    while named_error >= LEAST_NAMED_ERROR:
        reached = [row for row in rows if row["error %"] + row["uncertainty %"] <= named_error]
        if not reached:
            uncertainty = rows[0]["uncertainty %"]  # of the limit, so it is the same in all rows
            if uncertainty >= named_error:
                last_lines = [f"the limit is known to {uncertainty:.2g} % only"]
            else:
                last_lines = [f"no setting is proved to reach {named_error:g} %"]
            break  # a smaller error is not reached either
        cheapest = min(reached, key=seconds_of)
        cheapest_rows[id(cheapest)] = cheapest
        errors_of.setdefault(id(cheapest), []).append(f"{named_error:g}")
        named_error /= 10
    lines = []
    for key, row in cheapest_rows.items():
        setting = f"{describe_row(row, several_models)}, {row['seconds']:.2g} s"
        lines.append(f"{', '.join(errors_of[key])} %: {setting} ({_describe_error(row)})")
    return "\n".join([*lines, *last_lines])


def _describe_error(row: Mapping) -> str:
    """Return the error of a row; below its uncertainty only a bound is known."""
    if row["error %"] > row["uncertainty %"]:
        return f"error {row['error %']:.2g} %"
    return f"error at most {row['error %'] + row['uncertainty %']:.2g} %"


def describe_row(row: Mapping, with_model: bool = True) -> str:
    """Return method, element, model, mesh and step of a setting in words.

    h below 1 cm is in mm, dt below 1 s in ms. `with_model` says whether the model is named.
    """
    parts = [f"{row['method']} with {row['element']}"]
    h = row.get("h")
    rtol = row.get("rtol")
    dt = row.get("dt")
    if with_model and row.get("model"):
        parts.append(row["model"])
    if h and h >= 0.0099:  # 1 cm, with some room for round-off
        parts.append(f"h = {100 * h:.3g} cm")
    elif h:
        parts.append(f"h = {1e3 * h:.3g} mm")
    if rtol:
        parts.append(f"rtol = {rtol:g} 1/s")
    elif dt and dt < 0.999:  # 1 s, with some room for round-off
        parts.append(f"dt = {1e3 * dt:.3g} ms")
    elif dt:
        parts.append(f"dt = {dt:.3g} s")
    return ", ".join(parts)


LETTERS = string.ascii_letters
Series = dict[str, list[Mapping]]


def series_of(rows: Iterable[Mapping]) -> Series:
    """Return the rows with an error by "method element model"; the model only if it varies."""
    measured = list(filter(is_known, rows))
    several_models = len({row.get("model") for row in measured}) > 1
    series: Series = {}
    for row in measured:
        parts = [row["method"], row["element"], row["model"] if several_models else ""]
        series.setdefault(" ".join(part for part in parts if part), []).append(row)
    return series


def split_series(rows: Iterable[Mapping]) -> tuple[Series, Series]:
    """Return the series that are drawn as lines, at most eight, and the other series.

    The lines are the series with most points on the Pareto front; among series with equally
    many points there, those with the least product of error and seconds.
    """
    series = series_of(rows)

    def sorting_key(name: str) -> tuple:
        points = series[name]
        points_on_front = sum(bool(row.get("on front")) for row in points)
        least_product = min(row["seconds"] * known_error(row) for row in points)
        return -points_on_front, least_product

    names = sorted(series, key=sorting_key)
    drawn_names = names[:MOST_GROUPS]
    other_names = names[MOST_GROUPS:]
    drawn_series = {name: series[name] for name in drawn_names}
    other_series = {name: series[name] for name in other_names}
    return drawn_series, other_series


def grey_letters(rows: Iterable[Mapping]) -> dict[str, str]:
    """Return the letter of each series that is drawn in grey."""
    _, other_series = split_series(rows)
    return dict(zip(sorted(other_series), LETTERS, strict=False))


def draw_chart(chart: Any) -> Figure:
    """Draw the errors of a `Chart` over CPU seconds, with the Pareto front.

    The errors are in % of the size of the quantity or, if a row has none, in its unit. Up to
    eight series are lines; the points of all others are grey letters. Without any error the
    figure only says so.
    """
    drawing, ax = new_figure(size=(10.0, 6.0))
    drawn_series, other_series = split_series(chart.table)
    if not drawn_series:
        ax.text(0.5, 0.5, "no setting has an error", ha="center", transform=ax.transAxes)
        return drawing
    # a quantity whose limit is 0 has no size, so its errors are not in %
    unit = " %" if all("error %" in row for row in _rows(drawn_series)) else ""
    any_row = next(iter(_rows(drawn_series)))
    floor = any_row[f"uncertainty{unit}"]  # of the limit, so it is the same in all rows
    ylabel = f"error of {chart.quantity} [{unit.strip() or chart.limit.unit}]"
    ax.set(xscale="log", yscale="log", xlabel="CPU time [s]", ylabel=ylabel)
    ax.set_title(chart.title, loc="left")
    legend = "wide grey line: Pareto front; open: at most this error"
    ax.set_title(legend, loc="right", fontsize=10, color="0.35")
    for name, letter in grey_letters(chart.table).items():
        grey = {"ls": "", "marker": f"${letter}$", "ms": 7, "color": "0.55", "mew": 0.3}
        ax.plot(*_points(other_series[name], unit), **grey)
    ends = []
    for i, (name, rows) in enumerate(drawn_series.items()):
        style = line_style(i)
        # all settings of the series as pale marks, and the best of them as a line
        _draw_marks(ax, rows, unit, {**style, "ls": "", "ms": 4, "alpha": 0.35})
        x, y = _draw_marks(ax, best_rows(rows), unit, style)
        ends.append((name, str(style["color"]), x[-1], y[-1]))
    wide = {"color": "0.2", "lw": 9, "alpha": 0.2, "zorder": 1, "solid_capstyle": "round"}
    ax.plot(*_points(chart.front, unit), **wide)
    x, y = _points([*_rows(drawn_series), *_rows(other_series)], unit)
    lowest = min(*y, floor or math.inf)  # 0 has no place on a logarithmic axis
    ax.set(xlim=(min(x) / 1.4, max(x) * 1.4), ylim=(lowest / 2, max(y) * 1.6))
    if floor > 0:
        ax.axhspan(ax.get_ylim()[0], floor, color="0.93", zorder=0)
        floor_label = "below: within the uncertainty of the limit"
        ax.text(0.01, 0.012, floor_label, transform=ax.transAxes, fontsize=9, color="0.35")
    use_plain_ticks(ax)
    label_ends(ax, ends)
    return drawing


def _draw_marks(ax, rows: Sequence[Mapping], unit: str, style: Mapping) -> tuple[list, list]:
    """Draw a line with a mark for each row; return x and y of all rows.

    A row whose error is below its uncertainty has only a bound: its mark is open.
    """
    measured = [row for row in rows if row["error"] > row["uncertainty"]]
    ax.plot(*_points(measured, unit), **style)
    bounds = [row for row in rows if row not in measured]
    ax.plot(*_points(bounds, unit), **{**style, "ls": "", "mfc": "white"})
    return _points(rows, unit)


def _rows(series: Series) -> Iterable[Mapping]:
    """Return the rows of all series."""
    return (row for rows in series.values() for row in rows)


def _points(rows: Iterable[Mapping], unit: str) -> tuple[list, list]:
    """Return the CPU seconds and the errors of rows; `unit` is " %" or ""."""
    rows = list(rows)
    return [row["seconds"] for row in rows], [bound_of(row, unit) for row in rows]


def bound_of(row: Mapping, unit: str = "") -> float:
    """Return the error of a row; below its uncertainty it is at most the sum of both.

    It is above 0, for a logarithmic axis.
    """
    error = row[f"error{unit}"]
    uncertainty = row[f"uncertainty{unit}"]
    if error > uncertainty:
        return error
    return error + max(uncertainty, sys.float_info.epsilon)
