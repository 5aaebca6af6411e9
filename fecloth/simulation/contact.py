"""How far the gap and the barrier of obstacles keep a cloth from where it would touch them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.growth import Growth
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

# Steps, of gap/v, that resolve a bounce: its speed is then right to a few per cent.
STEPS_PER_BOUNCE = 50.0


@remembered
@dataclass(frozen=True)
class Contact(Account):
    """Where the cloth lies on obstacles at the end, and whether steps resolved its bounces."""

    name = "contact"
    sentence: str = ""  # by `describe_contact`
    # Of the bounce that steps resolved least: the size of the step over gap/(50 v), and a doubt.
    ratio: float = 0.0
    least: Doubt | None = None
    is_finished: bool = False

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Contact":
        after = self
        new = info.result.state
        for name, term in run.system.named:
            if not term.restitution or Growth.name not in others.records:
                continue  # an equilibrium has no speeds
            v = term.touch_speed(info.old, new.x, new.t)
            ratio = STEPS_PER_BOUNCE * v * info.dt / term.gap
            if ratio > max(1.0, after.ratio):
                after = after.changed(ratio=ratio, least=_unresolved(name, term, v, info.dt))
        return after

    def finish(self, run: Run, end: End, others: Accounts) -> "Contact":
        sentence = describe_contact(run.system, run.start, end.state)
        return self.changed(sentence=sentence, is_finished=True)

    def doubts(self) -> list[Doubt]:
        """Return the doubt about the bounce that was resolved least, at the end."""
        return [self.least] if self.least and self.is_finished else []

    def summary(self) -> dict[str, object]:
        if self.sentence:
            return {"contact_in_words": self.sentence}
        return {}


def describe_contact(system: System, start: State, end: State) -> str:
    """A sentence for each obstacle that touches the cloth at the end, or "" without obstacles.

    A cloth that an ideal obstacle carries lies on it. Here it lies at the mean distance D, the
    gap less what the barrier gives way: errors of its place, beside the largest displacement.
    """
    moved = float(np.sqrt(((end.x - start.x) ** 2).sum(axis=1).max()))
    means = [(name, term, term.mean_distance(end.x, end.t)) for name, term in system.named]
    return "; ".join(_sentence(n, term.gap, D, moved) for n, term, D in means if D is not None)


def _unresolved(name: str, term: Any, v: float, dt: float) -> Doubt:
    """Return the doubt that steps of dt do not resolve a touch with the speed v."""
    words = (
        f"bounces off {name} are not resolved: parts of the cloth touch it with {v:.3g} m/s in "
        f"steps of {dt:.3g} s, so that the speed with which they leave depends on dt"
    )
    resolving = term.gap / (STEPS_PER_BOUNCE * v)
    remedy = f"dt = {resolving:.2g} s resolves them, and restitution = 0 has none"
    return Doubt(DoubtKind.BOUNCE, words, remedy)


def _sentence(name: str, gap: float, mean: float, moved: float) -> str:
    if np.isnan(mean):
        return f"{name} does not touch the cloth at the end"
    parts = [100 * part / moved if moved else np.inf for part in (mean, gap, mean - gap)]
    return (
        f"the cloth rests {1e3 * mean:.3g} mm away from {name}, where it should touch: an error of "
        f"{parts[0]:.2g} % of its largest displacement, {parts[1]:.2g} % from the gap and "
        f"{parts[2]:.2g} % from the pressure on it"
    )
