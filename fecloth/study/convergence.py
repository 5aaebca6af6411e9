"""The result of `converge`: value, uncertainty, order, and a verdict in words."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.mesh.grading import Grading
from fecloth.output.frames import write_vtk
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.study.figures import Figure, labelled, line_style, new_figure, use_plain_ticks
from fecloth.study.result import UNITS, StudyResult, in_percent
from fecloth.study.runs import end_of
from fecloth.study.status import OK
from fecloth.study.uncertainty import LEAST_ORDER, Estimate

# The distance of the observed from the theoretical order, over the theoretical one: up to this
# distance both are called the same.
ORDER_TOLERANCE = 0.25
# The differences between levels over the quantity: below it an engineer takes the values as
# equal, whatever their order.
SMALL_DIFFERENCE = 0.005
SLOWEST_ORDER = 0.3  # below this observed order a level more gains less than 20 % for ratio 2


@dataclass(frozen=True, eq=False, repr=False)
class Convergence(StudyResult):
    """The result of `converge`; lengths in m, times in s, the quantity in its own unit.

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
    value
        The quantity on the finest level; of a field, path or vector its size.
    uncertainty
        The exact value is expected in value ± uncertainty: of what was refined, plus the
        shares; at least the distance of other states. NaN where these are not excluded, and where
        no limit is seen.
    limit
        The value extrapolated to h = 0 or dt = 0.
    order
        The observed order, NaN if there is none.
    theory
        The theoretical order.
    converges
        Whether the verdict begins with "converges".
    refine
        "h", "dt" or "both".
    shares
        Estimated size of each part of the error: "mesh" or "time step" or both (what was
        refined), and "time step" or "mesh" and "solver" as far as they were estimated.
    estimate
        The `Estimate` from the published procedure.
    gradings
        With ``grade=True``, the gradings of the meshes; the table then also has rows of
        uniform meshes.
    levels
        Rows of the runs of the levels, coarse to fine.
    others
        Rows of the runs that show the shares of what was not refined.
    states
        Of an equilibrium that may have other states: (value, number of folds) of each state that
        was found, first that of the finest level.
    may_have_other_states
        Whether an equilibrium may have other states that were not found.
    """

    quantity: str = ""
    unit: str = ""
    value: float = math.nan
    uncertainty: float = math.nan
    limit: float = math.nan
    order: float = math.nan
    theory: float = math.nan
    converges: bool = False
    refine: str = "h"
    shares: Mapping[str, float] = field(default_factory=dict)
    estimate: Estimate | None = None
    gradings: tuple[Grading, ...] = ()
    levels: Sequence[Mapping] = ()
    others: Sequence[Mapping] = ()
    states: tuple[tuple[float, float | None], ...] = ()
    may_have_other_states: bool = False

    def notes(self) -> list[str]:
        """Sentences on the extrapolated value, the parts of the error and what was noticed."""
        lines = []
        # other values have no limit to extrapolate to
        is_monotone = self.estimate and self.estimate.behaviour in ("monotone", "constant")
        if self.estimate and math.isfinite(self.limit) and is_monotone and self.has_limit:
            procedure = self.estimate.procedure
            text = f"{self.limit:.8g} {self.unit}".strip()
            lines.append(f"Extrapolated value: {text}. Procedure: {procedure}.")
        if self.shares:
            parts = []
            for name, size in self.shares.items():
                known = f"{size:.2g} {self.unit}".strip()
                parts.append(f"{name} {'not known' if math.isnan(size) else known}")
            lines.append(f"Estimated parts of the error: {', '.join(parts)}.")
        return [*lines, *self.remarks]

    def report(self, folder: str | Path) -> Path:
        """Write report.html, results.csv, the figure, and finest.pvd for ParaView.

        finest.pvd has the last state of the run on the finest level. There is none of natural
        frequencies, nor where no run ended well.
        """
        if self._finest:
            system, state = end_of(self._finest)
            write_vtk(Path(folder) / "finest", system.cloth, state, system)
        return super().report(folder)

    def describe_files(self, folder: Path, page: Path) -> str:
        """Say which files there are for the browser and for ParaView."""
        words = super().describe_files(folder, page)
        if self._finest:
            return f"wrote {folder / 'finest.pvd'}\n{words}"
        return words

    @property
    def _finest(self) -> Mapping | None:
        """The row of the finest level whose run ended well; None of natural frequencies."""
        rows = [row for row in self.levels if row["status"] == OK and "frequencies" not in row]
        return rows[-1] if rows else None

    def figure(self) -> Figure:
        """Return the errors of the levels with the theoretical slope, and beside it the values.

        Both are over h or, if only the step was refined, over dt. Levels without a value are
        left out. Of graded meshes the left panel shows the errors of uniform meshes, too.
        """
        drawing, (left, right) = new_figure(1, 2, size=(10.0, 4.4))
        drawing.suptitle(f"{self.title}: {self.quantity}")
        rows_of_mesh: dict[str, list] = {}
        for row in self.table:
            if row.get("error"):  # errors of 0 have no place on logarithmic axes
                label = f"{row['mesh']} meshes" if "mesh" in row else "estimated error"
                rows_of_mesh.setdefault(label, []).append(row)
        for i, (label, rows) in enumerate(rows_of_mesh.items()):
            self._draw_errors(left, rows, label, line_style(i))
        if rows_of_mesh:
            use_plain_ticks(left)
            left.legend()
        else:
            left.text(0.5, 0.5, "no error to show", ha="center", transform=left.transAxes)
        self.draw_values(right, line_style(0))
        left.set(xlabel=right.get_xlabel(), ylabel=labelled("estimated error", self.unit))
        right.set_ylabel(labelled("value", self.unit))
        return drawing

    def draw_errors(self, ax, label: str, style: Mapping[str, Any]) -> None:
        """Draw the estimated errors of the levels over h or dt, with the theoretical slope."""
        rows = [row for row in self.table if row.get("error") and row.get("mesh") != "uniform"]
        if rows:
            self._draw_errors(ax, rows, label, style)

    def _draw_errors(self, ax, rows: list, label: str, style: Mapping[str, Any]) -> None:
        """Draw the errors of some rows, and a dashed line with the theoretical slope."""
        sizes = np.array([row[self.size_name] for row in rows])
        errors = [row["error"] for row in rows]
        ax.loglog(sizes, errors, label=label, **style)
        slope = errors[0] * (sizes / sizes[0]) ** self.theory
        ax.loglog(sizes, slope, "--", color=style["color"], lw=1, label=f"order {self.theory:g}")

    @property
    def is_one_state(self) -> bool:
        """Whether no other state of an equilibrium was found, and some other start was tried."""
        return len(self.states) < 2 and not self.may_have_other_states

    @property
    def has_limit(self) -> bool:
        """Whether the values approach a limit, so that their distance from it is estimated."""
        return self.estimate is not None and not math.isnan(self.estimate.uncertainty)

    @property
    def size_name(self) -> str:
        """The column of the table that has the sizes: dt, if only the step was refined, or h."""
        return "dt" if self.refine == "dt" else "h"

    def draw_values(self, ax, style: Mapping[str, Any]) -> None:
        """Draw the values over h or dt, and a band of the best value with its uncertainty.

        A dotted line joins the value of the finest level with the best value at h = 0. Values
        without an uncertainty have neither band nor line.
        """
        rows = [row for row in self.table if row.get("value") is not None]
        rows = [row for row in rows if row.get("mesh") != "uniform"]
        sizes = [row[self.size_name] for row in rows]
        values = [row["value"] for row in rows]
        best = best_value(self)
        if math.isfinite(self.uncertainty):
            low, high = best - self.uncertainty, best + self.uncertainty
            ax.axhspan(low, high, color=style["color"], alpha=0.15, lw=0)
            ax.plot([0, *sizes[-1:]], [best, *values[-1:]], ":", color=style["color"])
        ax.plot(sizes, values, **style)
        ax.set(xlim=(0, None), xlabel=labelled(self.size_name, UNITS[self.size_name]))
        ax.ticklabel_format(useOffset=False)
        ax.locator_params(axis="x", nbins=5)


def best_value(study: Convergence) -> float:
    """Return the limit, or the value of the finest level where there is no limit."""
    if math.isfinite(study.limit):
        return study.limit
    return study.value


def has_no_limit(estimate: Estimate, obstacles: Sequence[str] = ()) -> bool:
    """Whether refinement does not reduce the changes: then the values are near no limit.

    Very slow changes are called so only with a reason, one of the `obstacles` to convergence.
    """
    is_slow = estimate.order < SLOWEST_ORDER and bool(obstacles)
    return estimate.behaviour == "diverging" or is_slow


def judge(
    estimate: Estimate,
    values: Sequence[float],
    obstacles: Sequence[str],
    size: float = 0.0,
    doubt: Doubt | None = None,
    usual_cause: str = "",
) -> tuple[bool, str]:
    """Return whether values converge, and the verdict: a sentence that says so, or why not.

    They converge if they are equal, or if they have an order that can be trusted and the fit
    shows more than scatter. The sentence says whether the order is above or below the theory.

    Parameters
    ----------
    estimate
        The estimate that `estimate_uncertainty` made from the values.
    values
        Value of each level, coarse to fine.
    obstacles
        Possible reasons why values do not converge, for the sentence.
    size
        Size of the quantity. If the finest three values have no order, but differ by a small
        part of it, the verdict states this part.
    doubt
        Doubt about the finest run by which its values are no evidence, or None.
    usual_cause
        Words on the usual cause of an order below the theory, where there are no obstacles.
    """
    if doubt:
        return False, f"not known to converge: the finest run warns of {doubt}"
    theory = estimate.theory
    order = estimate.order
    why = ""
    if obstacles:
        why = f" Possible reasons: {'; '.join(obstacles)}."
    if estimate.behaviour == "constant":
        return True, "converges: all levels give the same value to round-off"
    spread = float(np.ptp(values[-3:]))  # of the three finest levels
    is_irregular = estimate.behaviour != "monotone"
    # differences that are small for an engineer, and have no clear order
    if spread <= SMALL_DIFFERENCE * size and (is_irregular or order < SLOWEST_ORDER):
        no_limit = ", and no limit" if has_no_limit(estimate, obstacles) else ""
        return False, f"no order to be seen within {in_percent(spread / size)}{no_limit}"
    if estimate.behaviour == "oscillating":
        return False, f"does not converge: the values go up and down from level to level.{why}"
    if estimate.behaviour == "without order":
        return False, f"not known to converge: the changes between levels follow no order.{why}"
    if has_no_limit(estimate, obstacles):
        words = "does not converge: no limit seen, as refinement does not reduce the changes"
        return False, f"{words}.{why}"
    orders = f"observed order {order:.2f}, theory {theory:g}"
    # with scatter ≥ data_range the fit shows scatter only, and the order says nothing
    if order < LEAST_ORDER or estimate.scatter >= estimate.data_range:
        return False, f"not yet in the asymptotic range ({orders}).{why}"
    if order < (1 - ORDER_TOLERANCE) * theory:
        cause = f" ({'; '.join(obstacles)})" if obstacles else usual_cause
        return True, f"converges with order {order:.2f}, below the theory {theory:g}{cause}"
    if order > (1 + ORDER_TOLERANCE) * theory:
        return True, f"converges faster than its theory ({orders})"
    return True, f"converges as it should ({orders})"
