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
_WORDS = re.compile(r"[^\W\d]\w*([ -]\w+)*")
MOST_BYTES = 20_000_000  # of a file; it takes ten seconds and some hundred MB of memory
COMMAS = "write commas between columns, and decimal points"
PLAIN = {"": 1.0, "-": 1.0, "1": 1.0, "%": 1e-2}  # units of numbers without a dimension
# By SI unit; of several dimensions with this unit the first.
DIMENSIONS = {dimension.si: dimension for dimension in reversed(units.DIMENSIONS.values())}


def dimension_of(si: str) -> Dimension:
    """Return the dimension that has this SI unit.

    A unit that is not in the tables can only be written as it is.
    """
    return DIMENSIONS.get(si.replace("²", "^2").replace("³", "^3"), Dimension({si: 1.0}))


def factor_to_si(name: str, unit: str | None, si: str) -> float:
    """Return the value in SI of the unit of a column.

    Raises `InputError` if quantities with this SI unit do not have the unit, or if the column
    has no unit and its quantity has one.

    Parameters
    ----------
    name
        Name of the column, for messages.
    unit
        Its unit as it is written; None or "" if it has none.
    si
        The SI unit of its quantity; "" for a quantity without a dimension.
    """
    if not si:
        if (unit or "") not in PLAIN:
            allowed = "its quantity has no unit; write no unit or [%]"
            raise InputError(f"column {name} [{unit}]", allowed)
        return PLAIN[unit or ""]
    dimension = dimension_of(si)
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
        """Return the values (rows,) of the column `name` in SI.

        `si` is the SI unit of its quantity, "" for a quantity without a dimension. If `si` is
        None, the values are returned as they are written; so are the values of a column without
        a unit if `plain` is true. Raises `InputError` for a column that is missing, for an
        unknown unit, for a missing unit (if not `plain`), and for a cell that is not a finite
        number.
        """
        if name not in self.cells:
            shown = [other for other, (_, cells) in self.cells.items() if _is_name(other, cells)]
            if shown:
                allowed = f"is not in the file, which has {', '.join(shown)}"
            else:
                allowed = "is not in the file, which has no column of numbers with a name"
            remedy = did_you_mean(name, shown)
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
        """Return the number in a cell of the column `name`, in the line of that number.

        Raises `InputError` if the cell is not a number, or not a finite one.
        """
        try:
            value = float(cell)
        except (TypeError, ValueError):
            value = np.nan  # refused below
        if not np.isfinite(value):
            what = f"line {line}, column {name!r}: {cell!r}"
            raise InputError(what, "must be a finite number", self.where)
        return value


def read_table(data: str | Path | Mapping[str, Sequence[float]], label: str) -> DataTable:
    """Return the table in a CSV file, or in a mapping from "name [unit]" to values.

    Raises `InputError` for other data, for columns of different lengths, and for two columns of
    one name. In messages `label` is the name of a mapping; a file has its path.
    """
    if not isinstance(data, str | Path | Mapping):
        allowed = "must be a path, or a mapping of columns"
        raise InputError(f"data = {brief(data)}", allowed, label)
    if isinstance(data, Mapping):
        columns = [(str(name), list(values)) for name, values in data.items()]
        lengths = {len(values) for _, values in columns}
        if len(lengths) != 1:
            raise InputError("data", "needs columns of one length", label)
        return _make_table(label, columns, lines=range(1, 1 + lengths.pop()))
    return _read_csv(Path(data), where=str(data))


def _read_csv(path: Path, where: str) -> DataTable:
    """Return the table in a CSV file; empty lines, and lines that begin with #, are left out.

    Raises `InputError`, with the place `where`, for a file that cannot be read, is larger than
    `MOST_BYTES` or has fewer than two lines, for semicolons between the names, and for a line
    with more or fewer cells than the first.
    """
    if problem := file_problem(path):
        raise InputError(problem[0], "must be a CSV file", where, problem[1])
    if (size := path.stat().st_size) > MOST_BYTES:
        raise InputError(f"has {size} bytes", f"must have at most {MOST_BYTES}", where)
    # "utf-8-sig" leaves out the mark with which some programs begin a file in UTF-8.
    content = path.read_text(encoding="utf-8-sig", errors="replace")
    numbered_lines = [
        (number, line)
        for number, line in enumerate(content.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    rows = list(csv.reader(line for _, line in numbered_lines))
    if len(rows) < 2:
        allowed = "it needs a line of names, then lines of numbers"
        raise InputError("too few lines", allowed, where)
    if ";" in numbered_lines[0][1]:
        raise InputError("columns between semicolons", COMMAS, where)
    for (number, _), row in zip(numbered_lines, rows, strict=True):
        if len(row) != len(rows[0]):
            what = f"line {number} has {len(row)} cells"
            allowed = f"must have {len(rows[0])}, as the first line; {COMMAS}"
            raise InputError(what, allowed, where)
    columns = [(head, list(cells)) for head, *cells in zip(*rows, strict=True)]
    return _make_table(where, columns, lines=[number for number, _ in numbered_lines[1:]])


def _make_table(
    where: str, columns: Sequence[tuple[str, list[Any]]], lines: Sequence[int]
) -> DataTable:
    """Return the table of `columns`, pairs of a head "name [unit]" and the cells.

    `lines` are the line numbers of the cells. Raises `InputError`, with the place `where`, for
    a head of another form, and for two columns of one name.
    """
    cells: dict[str, tuple[str | None, Sequence[Any]]] = {}
    for number, (head, values) in enumerate(columns, 1):
        match = _HEAD.fullmatch(head)
        if not match or match["name"] in cells:
            what = f"the head of column {number}"
            if match and _is_name(match["name"], values):
                what += f", {head!r},"
            allowed = "must be a name of its own, with its unit: name [unit]"
            raise InputError(what, allowed, where)
        cells[match["name"]] = match["unit"], values
    return DataTable(where, cells, lines)


def _is_name(head: str, cells: Sequence[Any]) -> bool:
    """Return whether messages may have a head: it is words, and numbers stand below it.

    A scene from elsewhere may name any file, such as one with passwords; of its text nothing
    goes into messages and logs.
    """
    try:
        float(cells[0])
    except (TypeError, ValueError, IndexError):
        return False
    return bool(_WORDS.fullmatch(head))
