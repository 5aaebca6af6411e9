"""The result of `tune`: the tuned setting, its error, its cost, its proof, and all runs."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fecloth import errors
from fecloth.scene.toml_text import to_toml
from fecloth.study.figures import COLOURS, MARKERS, Figure, new_figure, use_plain_ticks
from fecloth.study.problems import SceneProblem
from fecloth.study.result import StudyResult, Table, in_percent
from fecloth.study.status import FAILED, LATE
from fecloth.study.tuning.choices import Bench, Trial, change_of, each_once
from fecloth.study.tuning.prediction import Goal
from fecloth.study.tuning.proof import Proof

OTHER_TERMS = "other terms"  # runs of another model, which the figure leaves out

COLUMNS = {  # of a setting: names in `Choice` and in the table
    "element": "element",
    "pattern": "pattern",
    "h": "h [m]",
    "method": "method",
    "rtol": "rtol [1/s]",
}


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(StudyResult):
    """What `tune` found.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        A row for each run, with its estimated error; see `Table`.
    doubts
        Likely mistakes in the set-up of what was studied.
    remarks
        Sentences on what was noticed.
    error
        Estimated, relative, the largest of all quantities; 0.01 is 1 %.
    seconds
        Measured CPU time of the tuned setting [s].
    predicted
        Its predicted CPU time [s].
    proved
        Whether a run with a finer mesh or shorter steps shows that the error, or with a
        budget the time, is as asked for.
    tolerance
        The largest relative error that the caller gave, or NaN.
    budget
        The CPU time that the caller gave [s], or NaN.
    quantities
        Texts of the quantities.
    parts
        The error by its cause, as far as it exists: "space", "time", "solver", "model" for
        changed terms, and "gap".
    settings
        The tuned setting in words: element, pattern, h [m], method, dt [s] or rtol [1/s].
    text
        The tuned scene as TOML; "" of a function's problem.
    scene
        Path of tuned.toml in the folder that was given, or None.
    search_seconds
        CPU time of the search with its set-up, without the run that verified the tuned
        setting [s].
    """

    error: float = math.nan
    seconds: float = math.nan
    predicted: float = math.nan
    proved: bool = False
    tolerance: float = math.nan
    budget: float = math.nan
    quantities: tuple[str, ...] = ()
    parts: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    text: str = ""
    scene: Path | None = None
    search_seconds: float = math.nan

    def notes(self) -> list[str]:
        """Return sentences on the parts of the error, on the CPU time, and the remarks.

        A number that is not known is left out.
        """
        lines = []
        if self.parts:
            parts = ", ".join(f"{name} {in_percent(size)}" for name, size in self.parts.items())
            lines.append(f"Estimated parts of the error: {parts}.")
        cost = f"CPU time: {self.seconds:.2g} s"
        if math.isfinite(self.predicted):
            cost += f", predicted {self.predicted:.2g} s"
        if math.isfinite(self.search_seconds):
            cost += f"; the search took {self.search_seconds:.2g} s"
        return [*lines, f"{cost}.", *self.remarks]

    @property
    def scene_file(self) -> tuple[str, str]:
        """Name and text of the tuned scene."""
        return "tuned.toml", self.text

    @property
    def exit_status(self) -> int:
        """Exit status of the command: 0 if the setting is proved, else 1."""
        return 0 if self.proved else errors.MISSED

    def figure(self) -> Figure:
        """Return a plot of the estimated errors of the runs over their CPU seconds.

        Both axes are logarithmic. Runs of other terms are left out, and so are runs whose error
        is 0 or not known. Each pair of a method and an element has its own marker. A ring marks
        the tuned run, and a dashed line the tolerance or the budget.
        """
        drawing, ax = new_figure(size=(10.0, 6.0))
        rows = [row for row in self.table if _is_shown(row)]
        if not rows:
            words = "The error of no run is known."
            ax.text(0.5, 0.5, words, ha="center", transform=ax.transAxes)
            ax.set_axis_off()
            return drawing

        def plot(rows: Sequence[Mapping[str, Any]], label: str, **look: Any) -> None:
            seconds = [row["CPU s"] for row in rows]
            errors = [row["error %"] for row in rows]
            ax.plot(seconds, errors, ls="", label=label, **look)

        names = dict.fromkeys(map(_series, rows))  # each once, in their order
        for i, name in enumerate(names):
            rows_of_series = [row for row in rows if _series(row) == name]
            marker = MARKERS[i % len(MARKERS)]
            colour = COLOURS[i % len(COLOURS)]
            plot(rows_of_series, name, marker=marker, color=colour, alpha=0.8)
        if tuned := [row for row in rows if row["run"] == "tuned"]:
            plot(tuned, "tuned", marker="o", ms=18, mfc="none", mec="k", mew=1.6)
        if math.isfinite(self.tolerance):
            ax.axhline(100 * self.tolerance, color="k", ls="--", label="tolerance")
        if math.isfinite(self.budget):
            ax.axvline(self.budget, color="k", ls="--", label="budget")
        words = f"error, at most, of {', '.join(self.quantities)} [%]"
        ax.set(xscale="log", yscale="log", xlabel="CPU time [s]", ylabel=words)
        ax.set_title(self.title, loc="left")
        use_plain_ticks(ax)
        ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
        return drawing


def _is_shown(row: Mapping[str, Any]) -> bool:
    """Whether a run has the tuned terms, and numbers above 0 for the logarithmic axes."""
    values = [row.get(name) or 0.0 for name in ("error %", "CPU s")]
    return row["run"] != OTHER_TERMS and all(0 < value < math.inf for value in values)


def _series(row: Mapping[str, Any]) -> str:
    """Return method and element, by which the runs differ in the figure."""
    return f"{row.get('method') or ''} {row.get('element') or ''}".strip() or "runs"


def summarise(
    bench: Bench,
    goal: Goal,
    proof: Proof,
    took: float,
    dropped: Sequence[str],
    folder: str | Path | None,
) -> Tuned:
    """Return the result of `tune`, and write tuned.toml in `folder`, if that is not None.

    `proof` is the tuned run with its error, and `took` are the CPU seconds of the search.
    `dropped` are the changes of terms and gaps in words. A function has no tuned.toml.
    """
    trial = proof.trial
    opened = bench.opened
    proved = proof.meets(goal) and not proof.why
    text = ""
    if isinstance(opened, SceneProblem):
        text = to_toml(change_of(opened, trial.choice).apply(opened.tables))
    tuned = Tuned(
        title=opened.name,
        verdict=_verdict(proof, goal, proved),
        table=table_of_runs(bench, proof),
        error=proof.error,
        seconds=trial.seconds,
        predicted=proof.candidate.seconds if proof.candidate else math.nan,
        proved=proved,
        tolerance=math.nan if goal.has_budget else goal.tolerance,
        budget=goal.budget if goal.has_budget else math.nan,
        quantities=tuple(quantity.text for quantity in bench.quantities),
        parts={name: float(part.max()) for name, part in proof.parts.items()},
        settings=_settings(trial),
        text=text,
        search_seconds=took,
        remarks=tuple(_remarks(bench, dropped)),
    )
    return replace(tuned, scene=tuned.write_scene(folder))


def _remarks(bench: Bench, dropped: Sequence[str]) -> Iterator[str]:
    """Yield sentences on changed terms, and on runs that were cut off or are no evidence."""
    if dropped:
        yield f"Changed terms: {', '.join(dropped)}."
    for status, what in ((LATE, "cut off at the limit of CPU time"), (FAILED, "no evidence")):
        runs = [trial for trial in each_once(bench.done) if trial.row["status"] == status]
        if runs:
            count = "1 run was" if len(runs) == 1 else f"{len(runs)} runs were"
            yield f"{count} {what}; the first, {runs[0].choice}: {runs[0].row['cause']}."


def _verdict(proof: Proof, goal: Goal, proved: bool) -> str:
    """Return the answer in words: whether it is proved, the setting, its error and CPU time.

    Without a proof it also says why there is none.
    """
    error = "unknown" if math.isnan(proof.error) else in_percent(proof.error)
    run = proof.trial
    setting = f"{run.choice}: estimated error {error}, CPU time {run.seconds:.2g} s"
    if goal.has_budget:
        allowed = f"{goal.budget:g} s"
        missed = f"a budget of {allowed} cannot be kept: no run of the search was shorter"
    else:
        allowed = in_percent(goal.tolerance)
        missed = f"no verified setting has an error below {allowed}"
    if proved:
        return f"proved: {setting} (allowed: {allowed})"
    return f"not proved: {proof.why or missed}. What can be had: {setting}"


def _settings(trial: Trial) -> dict[str, Any]:
    """Return what a setting has, by the names of `Tuned.settings`."""
    values = {"element": trial.row["element"]}
    values |= {name: getattr(trial.choice, name) for name in ("pattern", "h", "method", "rtol")}
    if math.isfinite(trial.row["step"]):
        values["dt"] = trial.row["step"]
    return {name: value for name, value in values.items() if value}


def table_of_runs(bench: Bench, proof: Proof) -> Table:
    """Return a row for each run, with the largest error that it may have, in per cent.

    For the tuned run this is the estimated error. For the others it is their distance to the
    verifying run, plus the error that is left in the verifying run: the estimated error of the
    tuned run less the distance of these two. Without a verifying run, for failed runs, and for
    runs that only measure seconds, there is no error. A column without any value is left out.
    """
    finer = proof.finer
    runs = [*bench.other_than(finer), proof.trial]
    error_of_finer = 0.0
    if finer:
        runs.append(finer)
        distance_to_tuned = float(bench.distance(finer, proof.trial).max())
        error_of_finer = max(proof.error - distance_to_tuned, 0.0)
    rows = []
    for trial in each_once(runs):
        row = _row(bench, trial, proof)
        if trial is proof.trial:
            row["error %"] = 100 * proof.error
        elif finer and trial.is_ok and trial.records:  # not of runs that only measure seconds
            distance = float(bench.distance(finer, trial).max())
            row["error %"] = 100 * (distance + error_of_finer)
        rows.append(row)
    with_values = {name for row in rows for name, value in row.items() if value is not None}
    return Table(tuple({name: row[name] for name in row if name in with_values} for row in rows))


def _row(bench: Bench, trial: Trial, proof: Proof) -> dict[str, Any]:
    """Return the row of a run without its error: its purpose, setting, status, size and seconds.

    A failed run has no size and no seconds.
    """
    row: dict[str, Any] = {"run": _purpose(bench, trial, proof)}
    row |= {title: getattr(trial.choice, name) or None for name, title in COLUMNS.items()}
    row["graded"] = "yes" if trial.choice.grading else None
    row["status"] = trial.row["status"]
    if trial.is_ok:
        row |= {name: trial.row[name] for name in ("triangles", "steps")}
        row["CPU s"] = trial.seconds
    return row


def _purpose(bench: Bench, trial: Trial, proof: Proof) -> str:
    """Return what a run was for, in words, as the column "run" of the table shows it."""
    if trial is proof.trial:
        return "tuned"
    if trial is proof.finer:
        return "verifying"
    if trial.is_ok and not trial.records:  # it was run without quantities
        return "timing"
    if isinstance(bench.opened, SceneProblem) and "point" in trial.row:
        terms = trial.row["point"].problem.scene.terms
        if terms != bench.opened.scene.terms:
            return OTHER_TERMS
    if trial.choice.sharper:
        return "sharper solver"
    return "search"
