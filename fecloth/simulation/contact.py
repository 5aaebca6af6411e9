"""How far the gap and the barrier of obstacles keep a cloth from where it would touch them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True)
class Contact(Account):
    """Where the cloth lies on obstacles at the end."""

    name = "contact"
    sentence: str = ""  # by `describe_contact`

    def finish(self, run: Run, end: End, others: Accounts) -> Contact:
        return Contact(describe_contact(run.system, run.start, end.state))

    def words(self) -> str:
        return self.sentence

    def summary(self) -> dict[str, object]:
        return {"contact_in_words": self.sentence} if self.sentence else {}


def describe_contact(system: System, start: State, end: State) -> str:
    """A sentence for each obstacle that touches the cloth at the end, or "" without obstacles.

    A cloth that an ideal obstacle carries lies on it. Here it lies at the mean distance D, which is
    the gap less what the barrier gives way. Both are errors of its place, and are compared with the
    largest displacement since the start.
    """
    moved = float(np.sqrt(((end.x - start.x) ** 2).sum(axis=1).max()))
    lines = []
    for name, term in zip(system.names, system.bound, strict=True):
        mean = term.mean_distance(end.x, end.t)
        if mean is not None:
            lines.append(_sentence(name, term.gap, mean, moved))
    return "; ".join(lines)


def _sentence(name: str, gap: float, mean: float, moved: float) -> str:
    if np.isnan(mean):
        return f"{name} does not touch the cloth at the end"
    parts = [100 * part / moved if moved else np.inf for part in (mean, gap, mean - gap)]
    return (
        f"the cloth rests {1e3 * mean:.3g} mm away from {name}, where it should touch: an error of "
        f"{parts[0]:.2g} % of its largest displacement, {parts[1]:.2g} % from the gap and "
        f"{parts[2]:.2g} % from the pressure on it"
    )
