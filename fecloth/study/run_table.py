"""The table of runs that all studies read: settings, status, values, size and cost of each."""

from collections.abc import Mapping, Sequence
from typing import Any

from fecloth.errors import InputError
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import value_of
from fecloth.study.runs import Row, doubts_of, record_at
from fecloth.study.status import NO_VALUE, OK, failure

SIZES = ("triangles", "steps", "newton", "cpu_seconds")


def with_values(row: Mapping, quantities: Sequence[Quantity]) -> Row:
    """Return a row of `run_quantities` with the `values` of quantities by their texts.

    A run without a value, as where a signal has no period, gets the status "no value" and the
    reason. A run that failed has no values.
    """
    values: dict[str, float] = {}
    row = {**row, "values": values}
    if row["status"] == OK:
        for quantity in quantities:
            try:
                values[quantity.text] = value_of(quantity, record_at(row, quantity))
            except InputError as error:
                row |= failure(NO_VALUE, error)
    return row


def row_of_run(row: Mapping, settings: Mapping, results: Mapping) -> dict[str, Any]:
    """Return the row of a run in the table of a study.

    It has the settings, the status, the results (values and their errors), the size, the CPU
    seconds and the kinds of doubts of the run. A run that did not finish has the cause in place
    of what is not known of it.
    """
    cells = {**settings, "status": row["status"]}
    if row["status"] != OK:
        cells |= failure(row["status"], row["cause"])
    cells |= results
    cells |= {name: row[name] for name in SIZES if name in row}
    if doubts := doubts_of(row):
        cells["doubts"] = ", ".join(dict.fromkeys(doubt.kind.value for doubt in doubts))
    return cells
