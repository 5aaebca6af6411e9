"""How far the gap and the barrier of obstacles keep a cloth from where it would touch them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.shorter_steps import key_of_step
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

# Steps, of gap/v, that resolve a bounce: its speed is then right to a few per cent.
STEPS_PER_BOUNCE = 50.0


@remembered
@dataclass(frozen=True)
class Contact(Account):
    """Where the cloth lies on obstacles at the end, and whether steps resolved its bounces.

    Attributes
    ----------
    sentence
        By `describe_contact`, at the end.
    ratio, least
        Of the bounce that steps resolved least: the size of the step over gap/(50 v), and the
        doubt about it.
    is_finished
        Whether the run has ended: only then there is a doubt.
    """

    name = "contact"
    sentence: str = ""
    ratio: float = 0.0
    least: Doubt | None = None
    is_finished: bool = False

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Contact":
        """Return the record after a step, with the bounce that steps resolved least so far."""
        after = self
        new = info.result.state
        if isinstance(run.method, LoadSteps):  # an equilibrium has no speeds
            return after
        for name, term in run.system.named:
            if not term.restitution:
                continue
            v = term.touch_speed(info.old, new.x, new.t)
            ratio = STEPS_PER_BOUNCE * v * info.dt / term.gap
            if ratio > max(1.0, after.ratio):
                unresolved = _unresolved(name, term, v, info.dt, key_of_step(run.method))
                after = after.changed(ratio=ratio, least=unresolved)
        return after

    def finish(self, run: Run, end: End, others: Accounts) -> "Contact":
        sentence = describe_contact(run.system, run.start, end.state)
        return self.changed(sentence=sentence, is_finished=True)

    def doubts(self) -> list[Doubt]:
        """Return the doubt about the bounce that was resolved least, at the end."""
        if self.least and self.is_finished:
            return [self.least]
        return []

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


def _unresolved(name: str, term: Any, v: float, dt: float, key: str) -> Doubt:
    """Return the doubt that steps of dt do not resolve a touch with the speed v.

    `key` is what bounds the steps of the run.
    """
    words = (
        f"bounces off {name} are not resolved: parts of the cloth touch it with {v:.3g} m/s in "
        f"steps of {dt:.3g} s, so that the speed with which they leave depends on dt"
    )
    resolving = term.gap / (STEPS_PER_BOUNCE * v)
    remedy = f"{key} = {resolving:.2g} s resolves them, and restitution = 0 has none"
    return Doubt(DoubtKind.BOUNCE, words, remedy)


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
