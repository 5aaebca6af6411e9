"""The shape that the results of all studies share: verdict, table, figure, report."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fecloth import errors
from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file, writing
from fecloth.simulation.doubts.doubt import Doubt, in_words
from fecloth.study.figures import Figure
from fecloth.study.status import OK
from fecloth.view.web_page import render

LONGEST_CELL = 300  # characters
Row = Mapping[str, object]
Cell = float | int | str | bool | None
UNITS = {"h": "m", "dt": "s", "cpu_seconds": "s"}  # of columns, added to their names when shown
UNCERTAIN = {  # column: column of its error, which says how many of its digits are shown
    "value": "error",
    "limit": "uncertainty",
    "error %": "uncertainty %",
    "at most %": "uncertainty %",
    "difference of limits": "±",
}


def write_csv(rows: Sequence[Row], path: str | Path) -> None:
    """Write all rows, with the union of their columns; omit columns that hold lists."""
    columns = [
        c for c in _columns(rows) if not any(isinstance(row.get(c), list | dict) for row in rows)
    ]
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
    return list(dict.fromkeys(key for row in rows for key in row))


def _cell(value: object) -> str:
    text = " ".join(_text(value).split())
    return (text if len(text) <= LONGEST_CELL else text[:LONGEST_CELL] + " …").replace("|", "\\|")


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
        shown = [{**row, **_digits(row)} for row in self.rows]
        return markdown_table([{_head(k): row.get(k) for k in self.columns} for row in shown])

    def to_csv(self, path: str | Path) -> None:
        """Write the rows, with all digits."""
        write_csv(self.rows, path)

    def _repr_html_(self) -> str:
        shown = [{**row, **_digits(row)} for row in self.rows]
        rows = [[_text(row.get(name)) for name in self.columns] for row in shown]
        return render("table.html", {"head": map(_head, self.columns), "rows": rows})


def _digits(row: Mapping[str, Cell]) -> dict[str, str]:
    """Return the cells of numbers and their errors, with as many digits as the errors have."""
    cells = {}
    for column, value in row.items():
        name, bracket, unit = column.partition(" [")
        beside = f"{UNCERTAIN.get(name, '')}{bracket}{unit}"
        error = row.get(beside)
        if isinstance(value, float) and isinstance(error, float) and error > 0:
            cells[column], cells[beside] = with_uncertainty(value, error).split(" ± ")
    return cells


def _head(column: str) -> str:
    if column in UNITS:
        return f"{column} [{UNITS[column]}]"
    return column


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What a study found.

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
        """The doubts in words, a sentence each."""
        return in_words(self.doubts)

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
        """The verdict, the warnings and the notes, a line each."""
        warned = (f"warning: {words}" for words in self.warnings)
        return [*self.verdict.splitlines(), *warned, *self.notes()]

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if a row of the table has no result, else 0."""
        if any(row.get("status", OK) != OK for row in self.table):
            return errors.FAILED
        return 0

    def report(self, folder: str | Path) -> Path:
        """Write report.html, results.csv, the figure and the scene, if any; return the page."""
        folder = Path(folder)
        drawing = self.figure()
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            self.table.to_csv(folder / "results.csv")
            for kind in ("png", "svg"):
                drawing.savefig(folder / f"figure.{kind}", dpi=160)
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
        return f"wrote {page}" + (f" and {folder / name}" if text else "")

    @property
    def scene_file(self) -> tuple[str, str]:
        """Name and text of the scene that a report also writes; empty if there is none."""
        return "", ""

    def _repr_html_(self) -> str:
        return self._fill("study_in_notebook.html")

    def _fill(self, template: str) -> str:
        table = self.table._repr_html_()
        return render(template, {"title": self.title, "lines": self.words(), "table": table})


def with_uncertainty(value: float, uncertainty: float, unit: str = "") -> str:
    """Return a value and its uncertainty, to two digits of the latter."""
    size = max(abs(value), uncertainty)
    if not uncertainty > 0 or not size < float("inf"):
        text = f"{value:.8g} ± {uncertainty:.2g}"
    elif 1e-3 <= size < 1e5 and uncertainty > 1e-9 * size:
        places = _places(uncertainty)
        text = f"{value:.{max(places, 0)}f} ± {uncertainty:.{max(places, 0)}f}"
    else:
        digits = max(_places(uncertainty) - _places(size) + 1, 1)
        text = f"{value:.{min(digits, 15)}e} ± {uncertainty:.1e}"
    return f"{text} {unit}".strip()


def _places(number: float) -> int:
    """Return the decimal places of the second digit of a number."""
    return 1 - int(f"{number:.1e}".partition("e")[2])


def read_tolerance(value: float | str) -> float:
    """Return a relative tolerance, of a number or of a text such as "1%" or "0.01"."""
    text = str(value).strip()
    try:
        number = float(text.rstrip("% ")) / (100 if text.endswith("%") else 1)
    except ValueError:
        number = 0.0
    if not 0 < number < 1:
        if 1 <= number < 100:
            remedy = f"For {number:g} percent write {number:g}%."
        else:
            remedy = ""
        allowed = "must lie between 0 and 100 %, as 1% or 0.01"
        raise InputError(f"tolerance = {value}", allowed, "", remedy)
    return number


def in_percent(value: float) -> str:
    if abs(value) < 1:
        return f"{100 * value:.2g} %"
    return f"{100 * value:.0f} %"
