"""Columns of numbers with units, from a CSV file or a mapping, in SI units."""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError, brief, did_you_mean, errors_of
from fecloth.quantities import units
from fecloth.quantities.units import Dimension
from fecloth.validation import file_problem

_HEAD = re.compile(r"\s*(?P<name>[^\[\]]+?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*")
COMMAS = "write commas between columns, and decimal points"
PLAIN = {"": 1.0, "-": 1.0, "1": 1.0, "%": 1e-2}  # units of numbers without a dimension
# By SI unit; of several dimensions with this unit the first.
DIMENSIONS = {dimension.si: dimension for dimension in reversed(units.DIMENSIONS.values())}


def factor_to_si(name: str, unit: str | None, si: str) -> float:
    """Return the value of a unit in SI.

    Raises `InputError` if quantities with this SI unit do not have the unit, or if the column
    has no unit and its quantity has one.
    """
    if not si:
        if (unit or "") not in PLAIN:
            allowed = "its quantity has no unit; write no unit or [%]"
            raise InputError(f"column {name} [{unit}]", allowed)
        return PLAIN[unit or ""]
    dimension = DIMENSIONS.get(si.replace("²", "^2").replace("³", "^3"), Dimension({si: 1.0}))
    if not unit:
        raise InputError(f"column {name!r}", f"has no unit; write it as {name} [{dimension.si}]")
    try:
        if unit == si:
            return 1.0
        return units.quantity(name, f"1 {unit}", dimension)
    except InputError:
        allowed = f"its unit must be one of {', '.join(dimension.units)}"
        raise InputError(f"column {name} [{unit}]", allowed) from None


@dataclass(frozen=True, eq=False)
class DataTable:
    """Columns as they are written, with the numbers of their lines.

    Attributes
    ----------
    where
        The file, for messages.
    cells
        Name of each column → its unit, or None, and its cells.
    lines
        Number of the line of each row, from 1.
    """

    where: str
    cells: Mapping[str, tuple[str | None, Sequence[Any]]]
    lines: Sequence[int]

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def numbers(self, name: str, si: str | None, plain: bool = False) -> np.ndarray:
        """Return the values of a column in SI.

        If `si` is None, the values are as they are written; so are values without a unit if
        `plain` is true. Raises `InputError` for a column that is missing, an unknown unit, and a
        cell that is not a finite number.
        """
        if name not in self.cells:
            allowed = f"is not in the file, which has {', '.join(self.cells)}"
            remedy = did_you_mean(name, self.cells)
            raise InputError(f"column {name!r}", allowed, self.where, remedy)
        unit, cells = self.cells[name]
        with errors_of(self.where):
            if si is None or (plain and not unit):
                factor = 1.0
            else:
                factor = factor_to_si(name, unit, si)
        values = [
            self._number(name, cell, line) for cell, line in zip(cells, self.lines, strict=True)
        ]
        return factor * np.array(values)

    def _number(self, name: str, cell: Any, line: int) -> float:
        """Return the number in a cell; raise `InputError` if it is none or not finite."""
        try:
            value = float(cell)
        except (TypeError, ValueError):
            value = np.nan
        if not np.isfinite(value):
            what = f"line {line}, column {name!r}: {cell!r}"
            raise InputError(what, "must be a finite number", self.where)
        return value


def read_table(data: str | Path | Mapping[str, Sequence[float]], label: str) -> DataTable:
    """Read a CSV file, or a mapping of names with units to values.

    Raises `InputError` for anything but columns of one length with names of their own; `label`
    is the name of a mapping in messages.
    """
    if not isinstance(data, str | Path | Mapping):
        allowed = "must be a path, or a mapping of columns"
        raise InputError(f"data = {brief(data)}", allowed, label)
    if isinstance(data, Mapping):
        columns = [(str(name), list(values)) for name, values in data.items()]
        lengths = {len(values) for _, values in columns}
        if len(lengths) != 1:
            raise InputError("data", "needs columns of one length", label)
        return _table(label, columns, range(1, 1 + lengths.pop()))
    return _read_csv(Path(data), where=str(data))


def _read_csv(path: Path, where: str) -> DataTable:
    """Read a CSV file; empty lines, and lines that begin with #, are left out."""
    if problem := file_problem(path):
        raise InputError(problem[0], "must be a CSV file", where, problem[1])
    content = path.read_text(encoding="utf-8-sig", errors="replace")
    numbered = [
        (number, line)
        for number, line in enumerate(content.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    rows = list(csv.reader(line for _, line in numbered))
    if len(rows) < 2:
        allowed = "it needs a line of names, then lines of numbers"
        raise InputError("too few lines", allowed, where)
    if ";" in numbered[0][1]:
        raise InputError("columns between semicolons", COMMAS, where)
    for (number, _), row in zip(numbered, rows, strict=True):
        if len(row) != len(rows[0]):
            what = f"line {number} has {len(row)} cells"
            allowed = f"must have {len(rows[0])}, as the first line; {COMMAS}"
            raise InputError(what, allowed, where)
    columns = [(name, list(cells)) for name, *cells in zip(*rows, strict=True)]
    return _table(where, columns, [number for number, _ in numbered[1:]])


def _table(where: str, columns: Sequence[tuple[str, list[Any]]], lines: Sequence[int]) -> DataTable:
    """Return the table of columns, pairs of a head "name [unit]" and cells."""
    cells: dict[str, tuple[str | None, Sequence[Any]]] = {}
    for head, values in columns:
        match = _HEAD.fullmatch(head)
        if not match or match["name"] in cells:
            allowed = "must be a name of its own, with its unit: name [unit]"
            raise InputError(f"column {head!r}", allowed, where)
        cells[match["name"]] = match["unit"], values
    return DataTable(where, cells, lines)
