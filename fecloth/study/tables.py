"""A table of results: rows of named cells, as text, as CSV and as HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from fecloth.study.reports import markdown_table, write_csv

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
        head = "".join(f"<th>{escape(_head(name))}</th>" for name in self.columns)
        body = "".join(
            f"<tr>{''.join(f'<td>{_text(row.get(name))}</td>' for name in self.columns)}</tr>"
            for row in self.rows
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _head(column: str) -> str:
    return f"{column} [{UNITS[column]}]" if column in UNITS else column


def _text(value: Cell) -> str:
    if value is None:
        return ""
    return escape(f"{value:.4g}" if isinstance(value, float) else str(value))
