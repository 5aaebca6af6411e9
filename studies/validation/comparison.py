"""A prediction beside a measurement: the record that all folders of `studies.validation` share.

Every folder writes its records to `comparison.csv` with `write_comparisons`, in the columns
`COLUMNS`, so that one table and one chart can be made over all of them (`read_comparisons`).

All parts are standard uncertainties in the unit of the quantity, after ASME V&V 20-2009:

    total² = time² + space² + solver² + input² + start² + scatter²

With difference = predicted − measured they agree where |difference| ≤ 2 total, as in `fc.budget`.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import fecloth as fc
from fecloth.errors import InputError
from fecloth.study.budgeting.result import COVERS
from fecloth.study.result import Row, write_csv

PARTS = "time", "space", "solver", "input", "start", "scatter"
KINDS = (
    "fitted",  # the measurement took part in the fit
    "predicted",  # it took no part in it
    "shown",  # nothing was measured, or the number is for orientation: no verdict
)
COLUMNS = (
    "folder", "specimen", "quantity", "unit", "predicted", "time", "space", "solver", "input",
    "start", "total", "measured", "scatter", "difference", "agrees", "kind",
)  # fmt: skip
WORDS = {
    "time": "the time step", "space": "the mesh", "solver": "the solver", "input": "the fabric",
    "start": "the start", "scatter": "the measurement",
}  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """A predicted value with its standard uncertainties, and what was measured.

    Parameters
    ----------
    folder, specimen, quantity, unit
        What was compared, in words: the folder is the name in `studies/validation`.
    predicted, time, space, solver, input, start
        The predicted value and the parts of its uncertainty, in `unit`.
    measured, scatter
        The measured value and its standard uncertainty; NaN and 0 where nothing was measured.
    kind
        "fitted", "predicted" or "shown".

    Raises
    ------
    InputError
        For another kind, or a part that is negative.
    """

    folder: str
    specimen: str
    quantity: str
    unit: str
    predicted: float
    time: float = 0.0
    space: float = 0.0
    solver: float = 0.0
    input: float = 0.0
    start: float = 0.0
    measured: float = math.nan
    scatter: float = 0.0
    kind: str = "predicted"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"kind = {self.kind!r}", f"must be one of {', '.join(KINDS)}")
        for name in PARTS:
            if getattr(self, name) < 0:  # NaN: a part that is not known
                raise InputError(f"{name} = {getattr(self, name)}", "must be >= 0", self.quantity)

    @property
    def total(self) -> float:
        """The root of the sum of the squares of all parts, with the scatter."""
        return math.hypot(*(getattr(self, name) for name in PARTS))

    @property
    def own(self) -> float:
        """The uncertainty of the prediction alone, without the scatter: for bars and bands."""
        return math.hypot(*(getattr(self, name) for name in PARTS if name != "scatter"))

    @property
    def difference(self) -> float:
        """Predicted minus measured; NaN where nothing was measured."""
        return self.predicted - self.measured

    @property
    def agrees(self) -> bool | None:
        """Whether |difference| ≤ 2 total; None without a measurement, or for what is only shown."""
        if self.kind == "shown" or math.isnan(self.measured):
            return None
        return abs(self.difference) <= COVERS * self.total

    def sentence(self, wrong: str = "model") -> str:
        """The numbers and the verdict in words: which is `wrong` where they do not agree."""
        words = f"{self.specimen}, {self.quantity}: {self.predicted:.3g} ± {self.own:.2g}"
        words += f" {self.unit}".rstrip()
        if math.isnan(self.measured):
            return f"{words}; it was not measured"
        words += f", measured {self.measured:.3g} ± {self.scatter:.2g}"
        if self.agrees is None:
            return f"{words}; shown without a verdict"
        if not math.isfinite(self.total):
            return f"{words}: an uncertainty is not known"
        part = max(PARTS, key=lambda name: getattr(self, name))
        largest = f"{self.total:.2g}, of which {getattr(self, part):.2g} are of {WORDS[part]}"
        if self.agrees:
            twice = "twice " if abs(self.difference) > self.total else ""
            return f"{words}: agrees within {twice}its uncertainty of {largest}"
        off = f"{self.difference:+.2g} ± {self.total:.2g}" + f" {self.unit}".rstrip()
        return f"{words}: the {wrong} is wrong by {off} ({self.percent:+.0f} %)"

    @property
    def percent(self) -> float:
        """The difference in per cent of what was measured."""
        return 100 * self.difference / abs(self.measured) if self.measured else math.nan

    def scaled(self, factor: float, unit: str) -> Comparison:
        """Return the same in another unit: all numbers times `factor` > 0."""
        numbers = ("predicted", "measured", *PARTS)
        return replace(self, unit=unit, **{n: factor * getattr(self, n) for n in numbers})

    def row(self) -> dict[str, Any]:
        """The cells of `COLUMNS`; agrees is "yes", "no" or "", and what is not known is None."""
        cells = {name: getattr(self, name) for name in COLUMNS}
        words = {None: "", True: "yes", False: "no"}
        cells["agrees"] = words[self.agrees]
        bare = math.isnan(self.measured)
        return cells | (dict.fromkeys(("measured", "scatter", "difference")) if bare else {})


def from_budget(
    answer: fc.Budget,
    folder: str,
    specimen: str,
    words: Mapping[str, str] | None = None,
    kind: str = "predicted",
) -> list[Comparison]:
    """The comparisons of all quantities of a budget; `words` are by the texts of quantities."""
    found = []
    for row in answer.table:
        cells: dict[str, Any] = dict(row)
        text = str(cells["quantity"])
        parts = {name: float(cells[name]) for name in PARTS if name != "scatter"}
        found.append(
            Comparison(
                folder, specimen, (words or {}).get(text, text), str(cells["unit"]),
                float(cells["value"]), **parts, measured=float(cells.get("measured", math.nan)),
                scatter=float(cells["data"]), kind=kind,
            )
        )  # fmt: skip
    return found


def write_comparisons(out: Path, comparisons: Sequence[Comparison]) -> None:
    """Write OUT/comparison.csv, a row a comparison, with all digits."""
    write_csv([each.row() for each in comparisons], out / "comparison.csv")


def read_comparisons(path: Path) -> list[Comparison]:
    """The comparisons of a file that `write_comparisons` wrote."""
    texts = ("folder", "specimen", "quantity", "unit", "kind")
    computed = ("total", "difference", "agrees")
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    found = []
    for row in rows:
        numbers = {n: row[n] for n in COLUMNS if n not in (*texts, *computed)}
        blank = {"measured": math.nan, "scatter": 0.0}
        values = {n: float(cell) if cell else blank[n] for n, cell in numbers.items()}
        found.append(Comparison(**{n: row[n] for n in texts}, **values))  # type: ignore[arg-type]
    return found


def table(comparisons: Sequence[Comparison]) -> list[Row]:
    """Rows of a page: the parts that are not 0 everywhere, to three digits."""
    parts = [name for name in PARTS if any(getattr(c, name) for c in comparisons)]
    rows: list[Row] = []
    for each in comparisons:
        own = {name: f"{getattr(each, name):.2g}" for name in parts if name != "scatter"}
        bare = math.isnan(each.measured)
        rows.append(
            {
                "specimen": each.specimen, "quantity": each.quantity, "unit": each.unit,
                "predicted": f"{each.predicted:.4g}", **own, "total": f"{each.total:.2g}",
                "measured": "" if bare else f"{each.measured:.4g} ± {each.scatter:.2g}",
                "difference": "" if bare else f"{each.difference:+.2g} ({each.percent:+.1f} %)",
                "agrees": each.row()["agrees"], "kind": each.kind,
            }
        )  # fmt: skip
    return rows
