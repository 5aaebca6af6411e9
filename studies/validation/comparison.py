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
    """Rows of a page: what was predicted, beside what was measured."""
    return [
        {
            "specimen": each.specimen,
            "quantity": f"{each.quantity} [{each.unit}]",
            "predicted": f"{each.predicted:.3g} ± {each.own:.2g}",
            "measured": f"{each.measured:.3g} ± {each.scatter:.2g}",
            "difference": f"{each.difference:+.2g} ± {each.total:.2g} ({each.percent:+.0f} %)",
            "agrees": "yes" if each.agrees else "**no**",
        }
        for each in comparisons
        if each.kind == "predicted" and each.agrees is not None
    ]
