"""The outcome of a run, and messages about it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fecloth.errors import FeclothError
from fecloth.output.atomic_files import WriteError
from fecloth.runs.folder import FolderMoved
from fecloth.runs.shape_watch import shape_message
from fecloth.simulation.energy_ledger import Ledger
from fecloth.system.system import System

DONE, FAILED, INTERRUPTED = "done", "failed", "interrupted"


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    status
        "done", "failed" or "interrupted".
    folder, summary
        Folder of the run, and the content of summary.json.
    ledger
        Energies at the last good state.
    error
        The cause of a failure.
    warnings
        All that the run warned of, before its first step and since.
    resumes
        Time from which `--resume` goes on [s], or None.
    """

    status: str
    folder: Path
    summary: dict
    ledger: Ledger
    error: FeclothError | None = None
    warnings: tuple[str, ...] = ()
    resumes: float | None = None


def count_sizes(system: System) -> dict:
    """Return the numbers of nodes, triangles and free dofs."""
    return {
        "nodes": len(system.cloth.X),
        "triangles": len(system.cloth.triangles),
        "free_dofs": system.admissible.shape[1],
    }


def place_in_words(t: float, unit: str) -> str:
    """Return how far a run is: "t = 0.5 s", or "0.5 of the loads"."""
    return f"t = {t:g}{unit}" if unit == " s" else f"{t:g}{unit}"


def finished_message(outcome: Outcome) -> str:
    """Return how wrong a run is in time, what it has cost, the file to open, and its warnings."""
    counts, seconds = outcome.summary, outcome.summary["seconds"]
    return (
        f"{shape_message(counts)}\n"
        f"{counts['time_error_in_words']}\n"
        f"{counts['steps']} steps and {counts['newton']} Newton iterations in "
        f"{seconds['total']:.1f} s; open {outcome.folder / counts['open']} in ParaView"
        f"{warning_count(outcome)}"
    )


def warning_count(outcome: Outcome) -> str:
    """Return the end of the last line if there were warnings, or ""."""
    if not outcome.warnings:
        return ""
    where = outcome.folder / "report.html"
    return f"; there were {len(outcome.warnings)} warnings, see above or {where}".replace(
        "were 1 warnings", "was 1 warning"
    )


def failure_message(outcome: Outcome) -> str:
    """Return why a run ended early, what is readable, and from where it can go on."""
    folder, t, unit = outcome.folder, outcome.summary["t"], outcome.summary["unit"]
    readable = f"{folder} is readable up to {place_in_words(t, unit)}"
    again = f"--resume {folder} goes on from"
    if isinstance(outcome.error, FolderMoved):
        return f"failed: {outcome.error}"
    if outcome.error and not isinstance(outcome.error, WriteError):
        return f"failed: {outcome.error}\n{readable}{warning_count(outcome)}"
    if outcome.resumes is None:
        goes = "no restart file was written; set restart_steps in [output] to have them"
    elif outcome.error:
        goes = f"{again} its last restart file, at {place_in_words(outcome.resumes, unit)}"
    elif outcome.resumes < t:
        place = place_in_words(outcome.resumes, unit)
        goes = f"{again} {place}, the last restart that continues bit for bit"
    else:
        goes = f"{again} there"
    cause = f"failed: {outcome.error}\n" if outcome.error else "interrupted; "
    return f"{cause}{readable}; {goes}{warning_count(outcome)}"


def ledger_text(ledger: Ledger, unit: str = " s") -> str:
    """Return the ledger, a line for each column."""
    row = ledger.row() | {"start": ledger.start}
    shown = {key: value for key, value in row.items() if key not in ("t", "total")}
    lines = [f"  {key:<28} {value: .6e} J" for key, value in shown.items()]
    return "\n".join([f"energy at {place_in_words(ledger.t, unit)}", *lines])
