"""The outcome of a run, and messages about it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fecloth.errors import FeclothError, amount
from fecloth.output.atomic_files import WriteError
from fecloth.simulation.account import Accounts
from fecloth.simulation.answer import list_answers
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.run import Result
from fecloth.system.system import System

DONE = "done"
FAILED = "failed"
INTERRUPTED = "interrupted"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SceneResult(Result):
    """How the run of a scene ended: a `Result`, its arrays read from the tables of the folder.

    Attributes
    ----------
    state
        The last state.
    times
        (s + 1,) the start, and the ends of the steps that have rows [s].
    energies
        Column of the ledger → (s + 1,) [J]; see `Ledger`.
    observed
        Column → (s + 1,): probe paths, mean displacement, sag (greatest fall since the
        start), area, reactions of the pins and obstacles, least distance from each
        obstacle.
    seconds
        Wall seconds by phase.
    solver
        The linear solver and why it was chosen.
    method
        The method of the steps: `Auto`'s choice; `StabilityLimited` for an explicit one
        without dt.
    doubts
        Reasons to doubt the result, such as an energy balance that is off (`Balance`), and
        notes.
    accounts
        What the run accounts for, at its end.
    status
        "done", "failed" or "interrupted".
    folder
        Folder of the run.
    summary
        Content of summary.json.
    error
        The cause of a failure.
    resumes
        Time from which `--resume` goes on [s], or None.
    quantities
        The answer to each quantity of [interest] and [measured], by the text of the
        quantity; without both tables the places of the probes at the end. A run that has not
        reached its end has no answers: {}.
    refining
        The words of the command that refines the scene; () where none can.
    """

    status: str
    folder: Path
    summary: dict
    error: FeclothError | None = None
    resumes: float | None = None
    refining: tuple[str, ...] = ()

    @property
    def ledger(self) -> Ledger:
        """Energies at the last good state."""
        return self.accounts[Ledger]

    def __repr__(self) -> str:
        steps = amount(self.summary["steps"], "step")
        unit = self.summary["unit"]
        at = place_in_words(self.state.t, unit)
        return f"<SceneResult: {self.status} after {steps} at {at}, in {self.folder}>"


def count_sizes(system: System) -> dict:
    """Return the numbers of nodes, triangles and free degrees of freedom, as summary.json."""
    return {
        "nodes": len(system.cloth.X),
        "triangles": len(system.cloth.triangles),
        "free_dofs": system.constraints.count_free(len(system.cloth.X)),
    }


def place_in_words(t: float, unit: str) -> str:
    """Return how far a run is: "t = 0.5 s", or "0.5 of the loads"."""
    if unit == " s":
        return f"t = {t:g}{unit}"
    return f"{t:g}{unit}"


def finished_message(outcome: SceneResult) -> str:
    """Return lines about a finished run: its cost, its quantities, and what is known of errors.

    Below the quantities stand the errors in time and in space (of an equilibrium, whether it is
    stable), and how many warnings there were.
    """
    summary = outcome.summary
    lines = [
        f"{cost_message(outcome)}; open {outcome.folder / summary['open']} in ParaView",
        *list_answers(outcome.quantities, outcome.refining),
        summary["time_error_in_words"],
        summary["space_error_in_words"],
        warning_count(outcome),
    ]
    return "\n".join(filter(None, lines))


def cost_message(outcome: SceneResult) -> str:
    """Return the steps, iterations, seconds and threads of a run, in words."""
    summary = outcome.summary
    steps = amount(summary["steps"], "step")
    iterations = amount(summary["newton"], "Newton iteration")
    cost = f"{steps} and {iterations} in {summary['seconds']['total']:.1f} s"
    threads = summary.get("threads", 1)
    if threads > 1:
        cost += f" on {threads} threads"
    return cost


def list_details(accounts: Accounts, summary: Mapping) -> list[str]:
    """Return lines on the energies, the shape and all accounts of a run, however it ended.

    `summary` is the content of summary.json.
    """
    energies = ledger_lines(accounts[Ledger], summary["unit"])
    return [*energies, _shape_message(summary), *accounts.words()]


def _shape_message(summary: Mapping) -> str:
    """Return in words the stretches of a run, and the triangles turned over or intersecting.

    `summary` is the content of summary.json. Its pairs are None if the scene does not count
    intersections.
    """
    least = summary["least_stretch"]
    largest = summary["largest_stretch"]
    stretch = f"stretch {least:.4g} to {largest:.4g}"
    pairs = summary["intersecting_pairs"]
    inverted = f"at most {amount(summary['inverted_triangles'], 'triangle')} turned over"
    if pairs is None:
        return f"{stretch}, {inverted} in any frame; intersections were not counted"
    return f"{stretch}, {inverted} and {amount(pairs, 'intersecting pair')}, in any frame"


def warning_count(outcome: SceneResult) -> str:
    """Return how many warnings there were and where they are, or ""."""
    count = len(outcome.warnings)
    if not count:
        return ""
    where = outcome.folder / "report.html"
    were = "was" if count == 1 else "were"
    return f"there {were} {amount(count, 'warning')}, see above or {where}"


def failure_message(outcome: SceneResult) -> str:
    """Return in words why a run ended early, what is readable, and where it can go on.

    It can go on if it was interrupted, or if a file could not be written. After another failure
    it would fail again at the same step, so that no restart is offered.
    """
    folder = outcome.folder
    unit = outcome.summary["unit"]
    cause = f"failed: {outcome.error}\n" if outcome.error else "interrupted; "
    if not folder.is_dir():
        return f"{cause}{folder} was removed during the run, and nothing of it is left"
    words = f"{cause}{folder} is readable up to {place_in_words(outcome.summary['t'], unit)}"
    if not outcome.error or isinstance(outcome.error, WriteError):
        if outcome.resumes is None:
            words += "; no restart file was written; restart_steps in [output] writes some"
        else:
            words += f"; --resume {folder} goes on from {place_in_words(outcome.resumes, unit)}"
    return "; ".join(filter(None, (words, warning_count(outcome))))


def ledger_lines(ledger: Ledger, unit: str = " s") -> list[str]:
    """Return the energies of a ledger, a line for each column."""
    row = ledger.row() | {"start": ledger.start}
    shown = {key: value for key, value in row.items() if key not in ("t", "total")}
    lines = (f"  {key:<28} {value: .6e} J" for key, value in shown.items())
    return [f"energy at {place_in_words(ledger.t, unit)}", *lines]
