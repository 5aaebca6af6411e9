"""`stability`: where each method fails, over the step and the values of any key."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fecloth import errors
from fecloth.errors import InputError
from fecloth.integrators import studied_by
from fecloth.scene.scene import Scene
from fecloth.study import stability_words, variants
from fecloth.study.change import describe_values
from fecloth.study.chart_grid import known_names
from fecloth.study.figures import MOST_GROUPS, Figure
from fecloth.study.opened import Opened, open_study
from fecloth.study.problems import Problem
from fecloth.study.result import StudyResult, Table
from fecloth.study.run_problems import Task, print_warnings, refuse_huge
from fecloth.study.stability_runs import ALL_METHODS, list_runs, run_all
from fecloth.study.stability_words import JUDGED, WRONG, draw_map, range_of
from fecloth.study.status import FAILED, OK, REFUSED

LONGEST_CASE = 120.0  # usual limit of the CPU time of a run [s]


@dataclass(frozen=True, eq=False, repr=False)
class StabilityMap(StudyResult):
    """The result of `stability`: the table has a row for each method and combination of values.

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
    keys
        Names of the keys that were varied.
    methods
        Names of the methods.
    cells
        One row for each run: method, values, dt, status ("ok", "wrong", "failed", or the
        status of a case that was stopped), cause, energy made over the energy that moved,
        CPU seconds.
    """

    keys: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    cells: Table = field(default_factory=lambda: Table(()))

    @property
    def has_stopped(self) -> bool:
        """Whether a run was stopped: the map has a hole there."""
        return any(row["status"] not in JUDGED for row in self.cells)

    def figure(self) -> Figure:
        """Return a panel for each of the first eight methods: its runs and predicted limit."""
        return draw_map(self)

    def notes(self) -> list[str]:
        """Sentences on the columns, on stopped runs, and on methods outside of the figure."""
        lines = [
            "Longest step: up to it the runs reach the end, make at most 5 % of the energy that "
            "moves, and do not warn. Longer steps may be wrong and yet not fail.",
            "Predicted limit: critical_dt at the start; none if every step is stable in small "
            "motions.",
        ]
        # such a run, as one above the time limit, neither holds nor fails
        if stopped_runs := [row for row in self.cells if row["status"] not in JUDGED]:
            words = f"{stopped_runs[0]['status']}: {stopped_runs[0]['cause']}"
            count = "1 run says"
            if len(stopped_runs) > 1:
                count = f"{len(stopped_runs)} runs say"
            lines.append(f"{count} nothing about the step; the first: {words}")
        if len(self.methods) > MOST_GROUPS:
            lines.append(f"The figure shows the first {MOST_GROUPS} methods, the table all.")
        return lines

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 3 if the map has a hole."""
        if self.has_stopped:
            return errors.FAILED
        return 0

    def report(self, folder: str | Path) -> Path:
        """Write report.html, results.csv, the figure, and runs.csv with every run."""
        page = super().report(folder)
        self.cells.to_csv(Path(folder) / "runs.csv")
        return page


def stability(
    problem: Scene | str | Path | Callable | Opened,
    over: str | Iterable[str] | Mapping[str, Sequence] | None = None,
    methods: Sequence[str] | None = None,
    **shared: Any,
) -> StabilityMap:
    """Run a problem with each method and with steps from long to short: where does it fail?

    System, start and time come from the problem; its own method and step are not used. Each
    method takes its defaults. Implicit ones take 8, 16, … 256 steps; explicit ones six steps
    within 2.8 and 0.35 times their predicted limit, `critical_dt` at the start. A measured
    limit is a range: 12 % wide where the prediction is right and the run has 100 steps
    (shorter ones show growth less), else a factor of two at most.

    A run is "ok"; "failed" if a step failed, with the cause; or "wrong": it reached the end, but
    made more than 5 % of the energy that moved, or warned, as of a large error in time. Raises
    `InputError` for an unknown method or key, an equilibrium, and if the problem refuses every
    value. One of several that is refused gives rows with the reason.

    Parameters
    ----------
    problem
        As for `of`; one in time.
    over
        Values of one or more keys, as for `sweep`; without, the problem as it is.
    methods
        Names as in a scene, such as "bdf2" or "central_difference"; by default eight.
    shared
        Arguments of `fecloth.study.of`, as probes, jobs and cache.
        A function may take dt, but the steps are the steps of the map.
    """
    names = methods
    if names is None:
        names = studied_by("stability")
    allowed = f"must be names of {', '.join(ALL_METHODS)}"
    if isinstance(names, str) or not names:
        raise InputError(f"methods = {names!r}", allowed, "stability")
    chosen_methods = known_names(
        "method", names, known=ALL_METHODS, allowed=allowed, where="stability"
    )
    ranges: dict[str, list] = {}
    if over:
        ranges = variants.read_ranges(over)
    combinations = variants.combine(ranges)
    study = open_study(problem, shared)
    opened = variants.with_first_values(study.problem, ranges)
    runs = study.runs(LONGEST_CASE)
    refuse_huge(opened, runs)
    doubts = print_warnings(opened)
    tried_combinations, tasks, refused_cells = _list_tasks(opened, combinations, chosen_methods)
    cells = run_all(tasks, runs) + refused_cells
    rows = [
        _table_row(method, values, cells) for method in chosen_methods for values in combinations
    ]
    return StabilityMap(
        title=opened.name,
        doubts=doubts,
        verdict=_verdict(tried_combinations, chosen_methods, cells),
        table=Table(tuple(rows)),
        keys=tuple(ranges),
        methods=tuple(chosen_methods),
        cells=Table(tuple(cells)),
    )


def _list_tasks(
    opened: Problem, combinations: Sequence[dict], methods: Sequence[str]
) -> tuple[list[dict], list[Task], list[dict]]:
    """Return the combinations of values that run, all their runs, and the cells of the others.

    A combination that the problem refuses does not run: its cells, one for each method, have the
    reason. Raise `InputError` if all combinations are refused.
    """
    runs_of_combinations = variants.make_or_refuse(
        lambda values: list_runs(values, variants.vary(opened, values), methods), combinations
    )
    tried_combinations = []
    tasks: list[Task] = []
    refused_cells = []
    for values, runs_or_refusal in zip(combinations, runs_of_combinations, strict=True):
        if isinstance(runs_or_refusal, list):
            tried_combinations.append(values)
            tasks += runs_or_refusal
            continue
        for method in methods:
            cell = {"method": method, **values, "dt": None, "steps": None}
            refused_cells.append({**cell, **runs_or_refusal, "predicted": None})
    return tried_combinations, tasks, refused_cells


def _cells_of(method: str, values: Mapping, cells: Iterable[Mapping]) -> list[Mapping]:
    """Return the cells of the runs of a method with a combination of values."""
    settings = {"method": method, **values}
    return [cell for cell in cells if all(cell[key] == value for key, value in settings.items())]


def _table_row(method: str, values: Mapping, cells: Sequence[Mapping]) -> dict:
    """Return the row of the table for a method with a combination of values.

    It has the measured limit as a range, the predicted limit, and what happens with the next
    longer step. `cells` are the rows of all runs.
    """
    own_cells = _cells_of(method, values, cells)
    measured_range = range_of(own_cells)
    predicted = own_cells[0]["predicted"]  # the same in all of them
    next_step = ""
    for cell in own_cells:
        # the second dt of the measured range is the shortest step that does not hold
        if cell["dt"] == measured_range[1] and cell["status"] in (WRONG, FAILED):
            next_step = f"{cell['status']}: {stability_words.shorten(cell['cause'])}"
            break
    if own_cells[0]["status"] == REFUSED:  # as of a combination that the problem refuses
        next_step = f"{REFUSED}: {own_cells[0]['cause']}"
    return {
        "method": method,
        **values,
        "longest step": stability_words.describe_range(measured_range),
        "does not fail up to": stability_words.describe_range(range_of(own_cells, (OK, WRONG))),
        "predicted limit": stability_words.describe_limit(predicted),
        "measured over predicted": stability_words.describe_ratio(measured_range, predicted),
        "next step": next_step,
    }


def _verdict(combinations: Sequence[Mapping], methods: Sequence[str], cells: Sequence) -> str:
    """Return which method holds the longest step, on a line for each combination of values.

    If it is the same for all combinations, there is only one line.
    """
    best_of_values = {}
    for values in combinations:
        ranges = {method: range_of(_cells_of(method, values, cells)) for method in methods}
        best_of_values[describe_values(values)] = stability_words.describe_best(ranges)
    if len(set(best_of_values.values())) == 1:
        (best,) = set(best_of_values.values())
        if len(best_of_values) == 1:
            return best
        return f"at every value {best}"
    return "\n".join(f"{name}: {best}" for name, best in best_of_values.items())
