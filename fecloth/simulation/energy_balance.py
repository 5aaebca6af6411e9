"""Whether the energy balance of a run closes, measured by the energy of its deformation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fecloth.simulation.energy_ledger import Ledger, negligible_energy
from fecloth.system.system import System
from fecloth.terms.records import remembered

EATEN = 0.2  # fraction of the motion that the method may dissipate without a warning
TRUSTED = 0.05  # fraction of the energy of deformation; a larger remainder causes a warning
OF_DISSIPATED = 0.02  # of what inner damping dissipates: the error of its power within a step
LASTING = 10  # steps after which a balance that stays off is reported
ROUND_OFF = 64 * np.finfo(float).eps
UNSOLVED = 1e-10  # of the energies, of the whole motion too: what Newton's tolerance leaves


@remembered
@dataclass(frozen=True)
class Balance:
    """The energy balance of the steps so far."""

    # Time of the start [s], and number of steps.
    start: float
    steps: int = 0
    # Largest `Ledger.deformation` that three steps in a row have reached [J]. One step's spike,
    # such as that of a pin that jumps, does not count.
    largest: float = 0.0
    # `Ledger.deformation` after the last step and the one before [J].
    last: float = 0.0
    before: float = 0.0
    # Number of steps in a row whose remainder was too large, and the least of these [J].
    off: int = 0
    least: float = math.inf

    @classmethod
    def open(cls, ledger: Ledger) -> Balance:
        """Return the balance before the first step."""
        return cls(ledger.t, last=ledger.deformation, before=ledger.deformation)

    def after(self, system: System, ledger: Ledger, number: int = 1) -> Balance:
        """Return the balance after a `number` of steps, with the ledger after the last of them."""
        now, remainder = ledger.deformation, abs(ledger.remainder)
        largest = max(self.largest, min(now, self.last, self.before))
        steps = self.steps + number
        new = replace(self, steps=steps, largest=largest, last=now, before=self.last)
        trusted = new.trusted(system, ledger)
        if remainder <= trusted:
            return replace(new, off=0, least=math.inf)
        if min(self.least, remainder) <= trusted:  # the first of a new row of steps
            return replace(new, off=1, least=remainder)
        return replace(new, off=self.off + 1, least=min(self.least, remainder))

    @property
    def scale(self) -> float:
        """What the remainder is compared with [J]: `largest`, in the first steps the last."""
        return self.largest or self.last

    def trusted(self, system: System, ledger: Ledger) -> float:
        """Largest remainder that causes no warning [J].

        It is 5 % of the `scale` and 2 % of what inner damping has dissipated, or what round-off
        and Newton's tolerance leave if that is more.
        With a term that reports neither an energy nor its work nothing is known, and it is
        infinite.
        """
        if ledger.silent or ledger.t <= self.start:
            return math.inf
        noise = self.noise(system, ledger)
        return max(TRUSTED * self.scale + OF_DISSIPATED * ledger.lost_inside, noise)

    def noise(self, system: System, ledger: Ledger) -> float:
        """Return the energy [J] that round-off and Newton's tolerance leave in a balance.

        It is 1e-10 of the amounts in the remainder's difference, and `negligible_energy`.
        """
        amounts = sum(abs(amount) for amount in ledger.amounts())
        return UNSOLVED * amounts + negligible_energy(system, ledger.t - self.start)

    def warning(self, ledger: Ledger, ended: bool = False) -> str:
        """Return a sentence if the balance does not close, or "".

        It must be off for ten steps in a row, all by more than is trusted at the last of them: a
        load that sets in has moved little in its first steps. At the end of a run one is enough.
        """
        if self.off < (1 if ended else LASTING):
            return ""
        when = f"step {self.steps}, at t = {ledger.t:g} s"
        return (
            f"{when}: the energy balance is off by {ledger.remainder:.3g} J, where the energy of "
            f"deformation was {self.scale:.3g} J at most: do not trust this motion; take a "
            "smaller dt"
        )

    def dissipation_warning(self, system: System, ledger: Ledger) -> str:
        """Return a sentence if the method has dissipated more than 20 % of the motion, or "".

        The motion is the `scale` or, if that is more, all that was dissipated: a cloth that loads
        keep in motion loses more than it ever has. A cloth that only flies has none.
        """
        if ledger.silent or ledger.t <= self.start:
            return ""
        lost = ledger.numerical + sum(ledger.dissipated.values())
        motion = max(self.scale, lost)
        noise = self.noise(system, ledger)
        if self.scale <= noise or not ledger.numerical > max(EATEN * motion, noise):
            return ""
        return (
            f"numerical dissipation has taken {ledger.numerical:.3g} J, "
            f"{100 * ledger.numerical / motion:.0f} % of the energy of the motion: take a smaller "
            "dt, or a method that dissipates less"
        )
