"""`sweep`: quantities of interest over the values of any key."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.figures import Figure, labelled, line_style, mark_failures, new_figure
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import Asked
from fecloth.study.result import StudyResult, Table
from fecloth.study.run_table import row_of_run, with_values
from fecloth.study.runs import Run
from fecloth.study.scene_source import describe_values
from fecloth.study.status import OK, REFUSED
from fecloth.study.variants import combine, plan, read_ranges, run_planned


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(StudyResult):
    """The result of `sweep`: the table has a row for each combination of values.

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
        Names of the columns that were varied.
    quantities
        Names of the columns that were computed.
    units
        SI unit of each quantity.
    """

    keys: tuple[str, ...] = ()
    quantities: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def figure(self) -> Figure:
        """Return a panel for each quantity, over the values of the first key.

        A panel has a line for each combination of values of the other keys, and a cross for each
        run that failed.
        """
        drawing, axes = new_figure(len(self.quantities), 1, (8.0, 3.8 * len(self.quantities)))
        first_key, *other_keys = self.keys
        rows_of_line: dict = {}  # rows by the values of the other keys
        for row in self.table:
            rows_of_line.setdefault(tuple(row[key] for key in other_keys), []).append(row)
        for ax, name, unit in zip(np.ravel(axes), self.quantities, self.units, strict=True):
            for i, (other_values, rows) in enumerate(rows_of_line.items()):
                points = [row for row in rows if row.get(name) is not None]
                x = [row[first_key] for row in points]
                y = [row[name] for row in points]
                pairs = zip(other_keys, other_values, strict=True)
                label = ", ".join(f"{key} {value}" for key, value in pairs)
                ax.plot(x, y, label=label, **line_style(i))
                mark_failures(ax, rows, first_key, str(line_style(i)["color"]))
            ax.set(xlabel=first_key, ylabel=labelled(name, unit))
            if _spans_decades([row[first_key] for row in self.table]):
                ax.set_xscale("log")
            if other_keys:
                ax.legend()
        return drawing


def sweep(
    problem: Scene | str | Path | Callable | Opened,
    over: str | Iterable[str] | Mapping[str, Sequence],
    quantity: Asked | Sequence[Asked] | None = None,
    **shared: Any,
) -> Sweep:
    """Run a problem for every combination of values and return quantities of each run.

    A value that the problem refuses gives a row with the status "refused" and the reason.
    Raises `InputError` for a quantity or a key that the problem refuses, or if the problem
    refuses every value.

    Parameters
    ----------
    problem
        As for `of`.
    over
        Values of one or more keys: texts such as "fabric.bending_rigidity=1e-6:1e-4:log:9",
        "…:lin:5" or "time.method=bdf2,newmark", or a mapping of keys to values. The keys of a
        scene are written as for ``--set``; the keys of a function are its arguments, with h
        and dt.
    quantity
        One or more; by default all of [interest], or of all probes, or the displacement.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
    """
    ranges = read_ranges(over)
    combinations = combine(ranges)
    opened, how, doubts = open_study(problem, shared).begin(combinations[0])
    quantities = opened.choose_quantities(quantity)

    def make(values: dict) -> list[Run]:
        return [Run(opened.at(values).finer(sharper=1.0), describe_values(values))]

    rows = [row for (row,) in run_planned(plan(make, combinations), quantities, how)]
    if all(row["status"] == REFUSED for row in rows):
        raise InputError(f"every value: {rows[0]['cause']}")
    table_rows = []
    for values, row in zip(combinations, rows, strict=True):
        row = with_values(row, quantities)
        table_rows.append(row_of_run(row, values, row["values"]))
    table = Table(tuple(table_rows))
    names = next((row["energies"] for row in rows if row["status"] == OK), ())
    return Sweep(
        title=opened.name,
        doubts=doubts,
        verdict=_verdict(table, quantities),
        table=table,
        keys=tuple(ranges),
        quantities=tuple(quantity.text for quantity in quantities),
        units=tuple(quantity.unit(names) for quantity in quantities),
    )


def _verdict(table: Table, quantities: Sequence[Quantity]) -> str:
    """Return a sentence with the range of each quantity, and how many runs failed."""
    parts = []
    for quantity in quantities:
        values = [value for value in table[quantity.text] if isinstance(value, float)]
        if values:
            parts.append(f"{quantity.text} from {min(values):.4g} to {max(values):.4g}")
    failed = sum(row["status"] != OK for row in table)
    words = "; ".join(parts) or "no run has a value"
    if failed:
        return f"{words}; {failed} of {len(table)} runs failed"
    return words


def _spans_decades(values: Sequence) -> bool:
    """Whether all values are numbers above 0, the largest at least ten times the smallest."""
    are_positive = all(isinstance(value, int | float) and value > 0 for value in values)
    return are_positive and max(values) >= 10 * min(values)
