"""A table of results: rows of named cells, as text, as CSV and as HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fecloth.study.reports import markdown_table, write_csv
from fecloth.view.templates import render

Cell = float | int | str | bool | None
UNITS = {"h": "m", "dt": "s", "cpu_seconds": "s"}  # of columns, added to their names when shown


@dataclass(frozen=True)
class Table(Sequence[Mapping[str, Cell]]):
    """Rows of named cells; numbers are shown to four digits and stored in full.

    Examples
    --------
    >>> table = Table(({"h": 0.1, "sag": 0.012344}, {"h": 0.05}))
    >>> table.columns, table["h"], len(table)
    (['h', 'sag'], [0.1, 0.05], 2)
    >>> print(table)
    | h [m] | sag |
    |---|---|
    | 0.1 | 0.01234 |
    | 0.05 |  |
    """

    rows: tuple[Mapping[str, Cell], ...]

    @property
    def columns(self) -> list[str]:
        """Names of the columns, in their order."""
        return list(dict.fromkeys(key for row in self.rows for key in row))

    def __getitem__(self, key):
        """Return a row by its number, or a column by its name."""
        return [row.get(key) for row in self.rows] if isinstance(key, str) else self.rows[key]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Mapping[str, Cell]]:
        return iter(self.rows)

    def __str__(self) -> str:
        return markdown_table([{_head(k): row.get(k) for k in self.columns} for row in self.rows])

    def to_csv(self, path: str | Path) -> None:
        """Write the rows, with all digits."""
        write_csv(self.rows, path)

    def _repr_html_(self) -> str:
        """Return an HTML table."""
        rows = [[_text(row.get(name)) for name in self.columns] for row in self.rows]
        return render("table.html", {"head": map(_head, self.columns), "rows": rows})


def _head(column: str) -> str:
    return f"{column} [{UNITS[column]}]" if column in UNITS else column


def _text(value: Cell) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
