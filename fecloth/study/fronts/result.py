"""The result of `front`: a table of settings with error and seconds, and what it says."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from fecloth import errors
from fecloth.quantities.digits import with_uncertainty
from fecloth.study.convergence import Convergence
from fecloth.study.figures import Figure
from fecloth.study.fronts.drawing import draw_front
from fecloth.study.result import (
    Cell,
    StudyResult,
    Table,
    in_percent,
    read_tolerance,
)
from fecloth.study.status import OK

NAMED_ERRORS = (10.0, 1.0, 0.1)  # %: the verdict names the cheapest setting for each
Row = Mapping[str, Cell]


@dataclass(frozen=True, eq=False, repr=False)
class Front(StudyResult):
    """The result of `front` and `chart`: the table has a row for each setting that ran.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        One row for each setting: its names and sizes, status, triangles, steps, CPU seconds, and
        the error with its uncertainty. See `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    quantity
        Text of the quantity, or of the quantities.
    limit
        The converged limit of the first quantity: value, uncertainty, order. It is None if it was
        not found.
    limits
        The limits of all quantities, by their texts.
    size
        Size of the first quantity, in its unit; errors are a percentage of it.
    others
        Quantities of interest for which the front has no errors.
    """

    quantity: str = ""
    limit: Convergence | None = None
    limits: Mapping[str, Convergence] = field(default_factory=dict)
    size: float = math.nan
    others: tuple[str, ...] = ()

    @property
    def front(self) -> Table:
        """The rows that no other beats in error and seconds, the cheapest first."""
        rows = [row for row in self.table if row.get("on front")]
        return Table(tuple(sorted(rows, key=lambda row: float(row["seconds"] or 0.0))))

    def cheapest(self, tolerance: float | str) -> Row | None:
        """Return the cheapest row with error and U within a relative tolerance; None for none.

        The tolerance is a number or a text, as 0.01 or "1%".
        """
        return find_cheapest(self.table, 100 * read_tolerance(tolerance))

    def needless(self, tolerance: float | str) -> list[str]:
        """Return the changes of the terms that meet a relative tolerance in some setting.

        They are names such as "without Drag"; the list is empty if the terms did not vary.
        """
        most = 100 * read_tolerance(tolerance)
        names = [str(row["terms"]) for row in self.table if row.get("terms") and _meets(row, most)]
        return list(dict.fromkeys(names))

    def notes(self) -> list[str]:
        """Sentences on the limit, and on the settings without an error."""
        lines = []
        if self.others:
            names = ", ".join(self.others)
            lines.append(f"All errors are of {self.quantity}, the first quantity; not of {names}.")
        for name, study in self.limits.items():
            words = with_uncertainty(study.limit, study.uncertainty, study.unit)
            order = "no order" if math.isnan(study.order) else f"observed order {study.order:.2f}"
            lines.append(f"Limit: {name} = {words} ({order}, theory {study.theory:g}).")
        counts = Counter(str(row["status"]) for row in self.table if row["status"] != OK)
        if parts := ", ".join(f"{count} {status}" for status, count in counts.items()):
            lines.append(f"Settings without an error: {parts}, of {len(self.table)}.")
        return [*lines, *self.remarks]

    def summary(self) -> str:
        """What the command prints: the verdict, the notes and the front."""
        if not self.front:  # no setting has a known error
            return "\n".join(self.words())
        count = f"These are {len(self.front)} of {len(self.table)} settings"
        words = f"{count}: no other is as accurate\nat the same cost. The report has all."
        return "\n".join([*self.words(), "", str(self.front), "", words])

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if no setting has an error."""
        if len(self.front):
            return 0
        return errors.FAILED

    def figure(self) -> Figure:
        """Return the errors over CPU seconds: a line for each series of its best settings."""
        unit = self.limit.unit if self.limit else ""
        return draw_front(self.table, self.title, self.quantity, unit)


def _meets(row: Row, most: float) -> bool:
    """Whether a row has an error that is with its uncertainty at most so many per cent."""
    if row["status"] != OK or row.get("error %") is None:
        return False
    return float(row["error %"] or 0.0) + float(row["uncertainty %"] or 0.0) <= most


def find_cheapest(rows: Sequence[Row], most: float) -> Row | None:
    """Return the cheapest row with error and U of at most so many per cent; None for none."""
    meeting = [row for row in rows if _meets(row, most)]
    return min(meeting, key=lambda row: float(row["seconds"] or 0.0), default=None)


def describe_front(table: Table, limit: Convergence | None, tolerance: float = math.nan) -> str:
    """Return a line on the cheapest setting for each of the errors 10, 1 and 0.1 %.

    The `tolerance` that the user asked for [%] is one of the errors, and the smallest. A setting
    that is the cheapest for several errors has one line. The last line says which error no
    setting reaches, if there is one.
    """
    if limit is None:
        return "not known: the limit of this problem was not found; see `converge`"
    several_models = len({row.get("model") for row in table}) > 1
    lines: dict[str, list[str]] = {}  # the errors, by the words of their setting
    last_line = []
    named_errors = {*NAMED_ERRORS, tolerance} if tolerance > 0 else {*NAMED_ERRORS}
    for named in sorted(named_errors, reverse=True):
        if named < tolerance:
            break
        row = find_cheapest(table, named)
        if row is None:
            last_line = [f"no setting is proved to reach {named:g} %"]
            break
        words = f"{describe_row(row, several_models)}, {row['seconds']:.2g} s ({_describe(row)})"
        lines.setdefault(words, []).append(f"{named:g}")
    return "\n".join(
        [*(f"{', '.join(named)} %: {words}" for words, named in lines.items()), *last_line]
    )


def _describe(row: Row) -> str:
    """Return the error of a row; below its uncertainty only a bound is known."""
    error, uncertainty = float(row["error %"] or 0.0), float(row["uncertainty %"] or 0.0)
    if error > uncertainty:
        return f"error {in_percent(error / 100)}"
    return f"error at most {in_percent((error + uncertainty) / 100)}"


def describe_row(row: Row, with_model: bool = True) -> str:
    """Return method, element, model, pattern, terms, mesh and step of a setting in words.

    h below 1 cm is in mm, dt below 1 s in ms. `with_model` says whether the model is named.
    """
    parts = [f"{row['method']} with {row['element']}"]
    if row.get("pattern"):
        parts[0] += f" {row['pattern']}"
    if with_model and row.get("model"):
        parts.append(str(row["model"]))
    if row.get("terms"):
        parts.append(str(row["terms"]))
    return ", ".join([*parts, *describe_sizes(row)])


def describe_sizes(row: Row) -> list[str]:
    """Return "h = …" and "dt = …" or "rtol = …" of a row, as far as it has them."""
    parts = []
    h, rtol, dt = (row.get(name) for name in ("h", "rtol", "dt"))
    if isinstance(h, float):
        size = f"{100 * h:.3g} cm" if h >= 0.0099 else f"{1e3 * h:.3g} mm"  # 1 cm, with round-off
        parts.append(f"h = {size}")
    if rtol:
        parts.append(f"rtol = {rtol:g} 1/s")
    elif isinstance(dt, float):
        size = f"{1e3 * dt:.3g} ms" if dt < 0.999 else f"{dt:.3g} s"  # 1 s, with round-off
        parts.append(f"dt = {size}")
    return parts
