"""The shape that the results of all studies share: verdict, table, figure, report."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fecloth import errors
from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file, writing
from fecloth.quantities.digits import with_uncertainty
from fecloth.simulation.doubts.doubt import NOTE, Doubt, warnings_of
from fecloth.study.figures import Figure
from fecloth.study.status import OK
from fecloth.view.web_page import render

Row = Mapping[str, object]
Cell = float | int | str | bool | None
UNITS = {"h": "m", "dt": "s", "cpu_seconds": "s"}  # units that are shown with names of columns
ERROR_OF = {  # column → column of its error, which says how many of its digits are shown
    "value": "error",
    "limit": "uncertainty",
    "error %": "uncertainty %",
    "at most %": "uncertainty %",
    "difference of limits": "±",
}


def write_csv(rows: Sequence[Row], path: str | Path) -> None:
    """Write the rows to a CSV file, with the columns of all rows; make its folder if needed.

    A column with a list or dict in any row is left out, because a cell holds a single value.
    Raise `WriteError` if the file cannot be written.
    """
    columns = []
    for column in _columns(rows):
        if not any(isinstance(row.get(column), list | dict) for row in rows):
            columns.append(column)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with writing(Path(path)), Path(path).open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def markdown_table(rows: Sequence[Row]) -> str:
    """Format rows as a Markdown table, numbers to four digits."""
    columns = _columns(rows)
    table = [columns, *[[_cell(row.get(column)) for column in columns] for row in rows]]
    lines = [f"| {' | '.join(cells)} |" for cells in table]
    return "\n".join([lines[0], f"|{'---|' * len(columns)}", *lines[1:]])


def _columns(rows: Sequence[Row]) -> list[str]:
    """Return the names of all columns, in the order in which they first occur."""
    return list(dict.fromkeys(key for row in rows for key in row))


def _cell(value: object) -> str:
    """Return a value as a cell of a Markdown table, on one line."""
    return " ".join(_text(value).split()).replace("|", "\\|")


@dataclass(frozen=True)
class Table(Sequence[Mapping[str, Cell]]):
    """Rows of named cells; numbers are shown to four digits, or as many as their error has.

    Attributes
    ----------
    rows
        The rows: column → cell.
    """

    rows: tuple[Mapping[str, Cell], ...]

    @property
    def columns(self) -> list[str]:
        """Names of the columns, in their order."""
        return _columns(self.rows)

    def __getitem__(self, key):
        """Return a row by its number, or a column by its name."""
        if isinstance(key, str):
            return [row.get(key) for row in self.rows]
        return self.rows[key]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Mapping[str, Cell]]:
        return iter(self.rows)

    def __str__(self) -> str:
        rows = [{**row, **_round_by_errors(row)} for row in self.rows]
        return markdown_table([{_head(k): row.get(k) for k in self.columns} for row in rows])

    def to_csv(self, path: str | Path) -> None:
        """Write the rows, with all digits."""
        write_csv(self.rows, path)

    def to_pandas(self) -> Any:
        """Return the rows as a DataFrame; raise `InputError` where pandas is not installed."""
        try:
            import pandas
        except ImportError as error:
            remedy = "Install pandas, or take to_csv."
            raise InputError("the package pandas", "is not installed", "", remedy) from error
        return pandas.DataFrame(list(self.rows), columns=self.columns)

    def _repr_html_(self) -> str:
        rows = [{**row, **_round_by_errors(row)} for row in self.rows]
        cells = [[_text(row.get(name)) for name in self.columns] for row in rows]
        return render("table.html", {"head": map(_head, self.columns), "rows": cells})


def _round_by_errors(row: Mapping[str, Cell]) -> dict[str, str]:
    """Return the cells of numbers that have an error in the row, and the cells of these errors.

    Both are texts with as many digits as the error has. All other cells are left out.
    """
    cells = {}
    for column, value in row.items():
        # "difference of limits [%]" has its error in the column "± [%]"
        name, bracket, unit = column.partition(" [")
        error_column = f"{ERROR_OF.get(name, '')}{bracket}{unit}"
        error = row.get(error_column)
        if isinstance(value, float) and isinstance(error, float) and error > 0:
            cells[column], cells[error_column] = with_uncertainty(value, error).split(" ± ")
    return cells


def _head(column: str) -> str:
    """Return the name of a column as it is shown, with its unit."""
    if column in UNITS:
        return f"{column} [{UNITS[column]}]"
    return column


def _text(value: object) -> str:
    """Return a cell as text: numbers to four digits, nothing for None."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


@dataclass(frozen=True, eq=False)
class StudyResult:
    """The result of a study: what all kinds of results share.

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
    """

    title: str
    verdict: str
    table: Table
    doubts: tuple[Doubt, ...] = field(default=(), kw_only=True)
    remarks: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The doubts that spoil an answer, in words: a sentence each."""
        return warnings_of(self.doubts)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.title}: {self.verdict.splitlines()[0]}>"

    def figure(self) -> Figure:
        """Return a Matplotlib figure of the result."""
        raise NotImplementedError

    def notes(self) -> list[str]:
        """Sentences that follow the verdict in the report: the remarks, and what it adds."""
        return list(self.remarks)

    def summary(self) -> str:
        """What the command of the study prints: the verdict, the notes and the table."""
        return "\n".join([*self.words(), "", str(self.table), ""])

    def words(self) -> list[str]:
        """The verdict, the doubts that are more than notes, and the notes, a line each."""
        doubts = (doubt.line for doubt in self.doubts if doubt.kind.label != NOTE)
        return [*self.verdict.splitlines(), *doubts, *self.notes()]

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if a row of the table has no result, else 0."""
        if any(row.get("status", OK) != OK for row in self.table):
            return errors.FAILED
        return 0

    def report(self, folder: str | Path) -> Path:
        """Write report.html, results.csv, the figure and the scene, if any.

        The figure is written as figure.png and figure.svg. The folder is made if needed. Return
        the path of report.html; raise `WriteError` if a file cannot be written.
        """
        folder = Path(folder)
        drawing = self.figure()
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            self.table.to_csv(folder / "results.csv")
            for suffix in ("png", "svg"):
                drawing.savefig(folder / f"figure.{suffix}", dpi=160)
        self.write_scene(folder)
        replace_file(folder / "report.html", (self._fill("study.html") + "\n").encode())
        return folder / "report.html"

    def write_scene(self, folder: str | Path | None) -> Path | None:
        """Write the scene alone, if there is one and a folder; return its path."""
        name, text = self.scene_file
        if not text or folder is None:
            return None
        replace_file(Path(folder) / name, text.encode())
        return Path(folder) / name

    def describe_files(self, folder: Path, page: Path) -> str:
        """Say which files `report` has written to the folder, beside results and figure."""
        name, text = self.scene_file
        if text:
            return f"wrote {page} and {folder / name}"
        return f"wrote {page}"

    @property
    def scene_file(self) -> tuple[str, str]:
        """Name and text of the scene that a report also writes; empty if there is none."""
        return "", ""

    def _repr_html_(self) -> str:
        return self._fill("study_in_notebook.html")

    def _fill(self, template: str) -> str:
        """Return the template with title, words and table."""
        table = self.table._repr_html_()
        return render(template, {"title": self.title, "lines": self.words(), "table": table})


def read_tolerance(value: float | str) -> float:
    """Return a relative tolerance from a number or a text such as "1%" or "0.01".

    Raise `InputError` for what is no number, or not between 0 and 1 (100 %).
    """
    text = str(value).strip()
    try:
        number = float(text.rstrip("% "))
    except ValueError:
        number = 0.0  # which is refused below
    if text.endswith("%"):
        number /= 100
    if not 0 < number < 1:
        remedy = ""
        if 1 <= number < 100 and not text.endswith("%"):  # it was probably meant in per cent
            remedy = f"For {number:g} percent write {number:g}%."
        allowed = "must lie between 0 and 100 %, as 1% or 0.01"
        raise InputError(f"tolerance = {value}", allowed, "", remedy)
    return number


def in_percent(value: float) -> str:
    """Return a part as a percentage; to two digits, above 100 % without decimals."""
    if abs(value) < 1:
        return f"{100 * value:.2g} %"
    return f"{100 * value:.0f} %"
