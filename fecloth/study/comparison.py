"""The result of `compare`: differences between variants beside the error of each."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fecloth.quantities.digits import with_uncertainty
from fecloth.study.convergence import Convergence, best_value
from fecloth.study.figures import label_ends, labelled, line_style, new_figure, use_plain_ticks
from fecloth.study.overlay import Overlay
from fecloth.study.result import StudyResult

# What is refined, and where a value has the given size.
WHERE = {
    "h": "on the given mesh",
    "dt": "with the given step",
    "both": "on the given mesh and step",
}


@dataclass(frozen=True)
class Difference:
    """The difference of a variant from the first one, in % or in the unit of the quantity.

    Attributes
    ----------
    as_given
        Difference on the given mesh, with the given step.
    limit
        Difference of the extrapolated values.
    uncertainty
        Half width of the range in which the exact difference is expected.
    """

    as_given: float
    limit: float
    uncertainty: float


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(StudyResult):
    """The result of `compare`; the table has a row for each variant.

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
    quantity
        Text of the quantity.
    unit
        Its SI unit.
    refine
        "h", "dt" or "both".
    studies
        The `Convergence` of each variant that ran.
    differences
        Differences of each variant from the first in `studies`.
    scale
        Value that is 100 %. It is NaN if the value is zero within its uncertainty: then
        differences have the unit of the quantity.
    overlay
        The ends of the first two variants as given, on one mesh; None where there are none.
    """

    quantity: str = ""
    unit: str = ""
    refine: str = "h"
    studies: Mapping[str, Convergence] = field(default_factory=dict)
    differences: Mapping[str, Difference] = field(default_factory=dict)
    scale: float = math.nan
    overlay: Overlay | None = None

    @property
    def unit_of_differences(self) -> str:
        """The unit of `differences`: "%", or the unit of the quantity."""
        return self.unit if math.isnan(self.scale) else "%"

    def notes(self) -> list[str]:
        """Sentences on variants that failed or do not converge, their warnings and remarks."""
        lines = [f"{row['variant']}: {row['cause']}" for row in self.table if row.get("cause")]
        for name, study in self.studies.items():
            if not study.converges:
                lines.append(f"{name}: {study.verdict.splitlines()[0].rstrip('.')}.")
            lines += [f"{name}: {words}" for words in (*study.warnings, *study.remarks)]
        return [*lines, *self.remarks]

    def report(self, folder: str | Path) -> Path:
        """Write report.html, results.csv, the figure, and overlay/first.pvd for ParaView."""
        if self.overlay:
            self.overlay.write(Path(folder) / "overlay")
        return super().report(folder)

    def describe_files(self, folder: Path, page: Path) -> str:
        """Say which files there are for the browser and for ParaView."""
        words = f"wrote {page}"
        if self.overlay:
            return f"wrote {folder / 'overlay' / 'first.pvd'}\n{words}"
        return words

    def figure(self):
        """Return the values over h or dt, and beside them their estimated errors.

        Each variant has the band of its limit and its uncertainty, and its theoretical slope.
        """
        drawing, (ax, right) = new_figure(1, 2, size=(12.0, 5.0))
        drawing.suptitle(f"{self.title}: {self.quantity}")
        ends = []
        for i, (name, study) in enumerate(self.studies.items()):
            study.draw_values(ax, line_style(i))
            study.draw_errors(right, name, line_style(i))
            first = study.table[0]
            ends.append((name, line_style(i)["color"], first[study.size_name], first["value"]))
        ax.set(ylabel=labelled(self.quantity, self.unit))
        right.set(xlabel=ax.get_xlabel(), ylabel=labelled("estimated error", self.unit))
        if right.lines:
            use_plain_ticks(right)
            right.legend()
        else:
            right.text(0.5, 0.5, "no error to show", ha="center", transform=right.transAxes)
        if ends:
            label_ends(ax, ends)
        else:
            ax.text(0.5, 0.5, "no variant has a value", ha="center", transform=ax.transAxes)
        return drawing


def find_scale(study: Convergence) -> float:
    """Return the value that is 100 %; NaN if it is zero within its uncertainty."""
    value = best_value(study)
    if abs(value) > study.uncertainty:
        return value
    return math.nan


def describe_difference(comparison: Comparison, name: str) -> str:
    """Return a sentence as "sag: Springs is 3.2 ± 0.1 % smaller than StVK, 4 % on the given mesh".

    `name` is the variant that is compared with the first one.
    """
    first = next(iter(comparison.studies))
    difference = comparison.differences[name]
    unit = comparison.unit_of_differences
    size = with_uncertainty(abs(difference.limit), difference.uncertainty, unit)
    if math.isnan(difference.uncertainty):
        size = f"{abs(difference.limit):.2g} {unit}".strip()
        sentence = f"{name} differs from {first} on the finest level by {size}, ± not known"
    elif abs(difference.limit) <= difference.uncertainty:
        sentence = f"{name} and {first} cannot be told apart: the difference is {size}"
    elif not math.isfinite(comparison.studies[first].limit):  # a field, whose difference is a size
        sentence = f"{name} differs from {first} by {size}"
    else:
        sentence = (
            f"{name} is {size} {'smaller' if difference.limit < 0 else 'larger'} than {first}"
        )
    as_given = f"{abs(difference.as_given):.2g} {unit}".strip()
    return f"{comparison.quantity}: {sentence}, {as_given} {WHERE[comparison.refine]}"
