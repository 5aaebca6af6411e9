"""Report of a study: results.csv and report.md with settings, machine, figures and findings."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from fecloth.output.atomic_files import writing

LONGEST_CELL = 300  # characters
Row = Mapping[str, object]


def write_csv(rows: Sequence[Row], path: str | Path) -> None:
    """Write all rows, with the union of their columns; omit columns that hold lists."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    columns = [c for c in columns if not any(isinstance(row.get(c), list | dict) for row in rows)]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with writing(Path(path)), Path(path).open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def markdown_table(rows: Sequence[Row]) -> str:
    """Format rows as a Markdown table, numbers to four digits."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = [columns, *[[_cell(row.get(column)) for column in columns] for row in rows]]
    lines = [f"| {' | '.join(cells)} |" for cells in table]
    return "\n".join([lines[0], f"|{'---|' * len(columns)}", *lines[1:]])


def _cell(value: object) -> str:
    if value is None:
        return ""
    text = f"{value:.4g}" if isinstance(value, float) else " ".join(str(value).split())
    return (text if len(text) <= LONGEST_CELL else text[:LONGEST_CELL] + " …").replace("|", "\\|")
