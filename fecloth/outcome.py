"""How a run ended."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .errors import FeclothError
from .record import Ledger
from .system import System

DONE, FAILED, INTERRUPTED = "done", "failed", "interrupted"


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    status
        "done", "failed" or "interrupted".
    folder, summary
        Where everything lies, and what summary.json says.
    ledger
        At the last good state.
    error
        Why it failed.
    warning
        What to doubt, "" for nothing.
    resumes
        From where `--resume` goes on [s]; None from nowhere.
    """

    status: str
    folder: Path
    summary: dict
    ledger: Ledger
    error: FeclothError | None = None
    warning: str = ""
    resumes: float | None = None


def sizes_of(system: System) -> dict:
    """What there is of nodes, triangles and free dofs."""
    return {
        "nodes": len(system.cloth.X),
        "triangles": len(system.cloth.triangles),
        "free_dofs": system.admissible.shape[1],
    }
