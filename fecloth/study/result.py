"""The shape that the results of all studies share: verdict, table, figure, report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fecloth.output.atomic_files import replace_file
from fecloth.study.status import OK
from fecloth.study.tables import Table
from fecloth.view.templates import render

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    """

    title: str
    verdict: str
    table: Table

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.title}: {self.verdict.splitlines()[0]}>"

    def figure(self) -> Figure:
        """Return a Matplotlib figure of the result."""
        raise NotImplementedError

    def notes(self) -> list[str]:
        """Sentences that follow the verdict in the report."""
        return []

    def summary(self) -> str:
        """What the command of the study prints: the verdict, the notes and the table."""
        return "\n".join([self.verdict, *self.notes(), "", str(self.table), ""])

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if a row of the table has no result, else 0."""
        return 3 if any(row.get("status", OK) != OK for row in self.table) else 0

    def report(self, folder: str | Path) -> Path:
        """Write report.html, results.csv, figure.png and figure.svg; return the page's path."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self.table.to_csv(folder / "results.csv")
        drawing = self.figure()
        for kind in ("png", "svg"):
            drawing.savefig(folder / f"figure.{kind}", dpi=160)
        replace_file(folder / "report.html", (self._fill("study.html") + "\n").encode())
        return folder / "report.html"

    def describe_files(self, folder: Path, page: Path) -> str:
        """Say which files `report` has written to the folder, beside results and figure."""
        return f"wrote {page}"

    def _repr_html_(self) -> str:
        """Return verdict, notes and table, for notebooks."""
        return self._fill("study_in_notebook.html")

    def _fill(self, template: str) -> str:
        lines = [*self.verdict.splitlines(), *self.notes()]
        table = self.table._repr_html_()
        return render(template, {"title": self.title, "lines": lines, "table": table})


def with_uncertainty(value: float, uncertainty: float, unit: str = "") -> str:
    """Return a value and its uncertainty, to two digits of the latter.

    Examples
    --------
    >>> with_uncertainty(0.123456, 0.00123, "m"), with_uncertainty(1234.5, 56.7)
    ('0.1235 ± 0.0012 m', '1234 ± 57')
    >>> with_uncertainty(2.5e-7, 3e-9, "m"), with_uncertainty(1.5, 0.0)
    ('2.500e-07 ± 3.0e-09 m', '1.5 ± 0')
    """
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
