"""How far the gap and the barrier of obstacles keep a cloth from where it would touch them."""

from dataclasses import dataclass

import numpy as np

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True)
class Contact(Account):
    """Where the cloth lies on obstacles at the end.

    Attributes
    ----------
    sentence
        By `describe_contact`, at the end.
    """

    name = "contact"
    sentence: str = ""

    def finish(self, run: Run, end: End, others: Accounts) -> "Contact":
        return self.changed(sentence=describe_contact(run.system, run.start, end.state))

    def summary(self) -> dict[str, object]:
        if self.sentence:
            return {"contact_in_words": self.sentence}
        return {}


def describe_contact(system: System, start: State, end: State) -> str:
    """Return a sentence for each obstacle on which a cloth may lie, or "" without obstacles.

    A cloth that an ideal obstacle carries lies on it. Here it lies at a mean distance, the gap
    less what the barrier gives way: errors of its place, beside the largest displacement.
    """
    moved = float(np.sqrt(((end.x - start.x) ** 2).sum(axis=1).max()))
    sentences = []
    for name, term in system.named:
        mean = term.mean_distance(end.x, end.t)
        if mean is not None:
            sentences.append(_describe_rest(name, term.gap, mean, moved))
    return "; ".join(sentences)


def _describe_rest(name: str, gap: float, mean: float, moved: float) -> str:
    """Return how far from an obstacle the cloth rests.

    `mean` is the mean distance [m], NaN where it does not touch, and `moved` the largest
    displacement [m].
    """
    if np.isnan(mean):
        return f"{name} does not touch the cloth at the end"
    percents = np.full(3, np.inf)
    if moved:
        percents = 100 * np.array([mean, gap, mean - gap]) / moved
    whole, from_gap, from_pressure = percents
    return (
        f"the cloth rests {1e3 * mean:.3g} mm away from {name}, where it should touch: an error "
        f"of {whole:.2g} % of its largest displacement, {from_gap:.2g} % from the gap and "
        f"{from_pressure:.2g} % from the pressure on it"
    )
