"""Whether the energy balance of a run closes, measured by the energy of its deformation."""

import math
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.deformation import Deformation, negligible_energy
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.steps import StepInfo
from fecloth.system.system import System
from fecloth.terms.records import remembered

LARGEST_REMAINDER = 0.05  # over the energy of deformation; a larger remainder causes a doubt
# Of what inner damping dissipates: the error of its power within a step.
ERROR_OF_DISSIPATED = 0.02
DISTRUST = "do not trust this motion"  # what the doubt about a balance says
STEPS_OFF = 10  # steps in a row that a balance must be off, before the end
# Over the energy of the motion: a remainder that no estimate of the error excuses.
FAR_OFF = 0.5
# Over the energies, of the whole motion too: what Newton's tolerance leaves.
ENERGY_UNSOLVED = 1e-10
# Over the kinetic energy, or 3 % of the speed; over the work of obstacles that move.
SLIGHT_ENERGY = 1e-3


@remembered
@dataclass(frozen=True)
class Balance(Account):
    """The energy balance of the steps so far.

    Attributes
    ----------
    start
        Time of the start [s].
    steps
        Number of steps.
    largest
        Largest energy of deformation that three steps in a row have reached [J]. The spike of a
        single step, as where a pin jumps, does not count.
    last, before
        The energy of deformation after the last step and the one before [J].
    off, least
        Number of steps in a row whose remainder was too large, and the least remainder of
        these [J].
    t, remainder
        Time [s] and remainder [J] after the last step.
    kinetic, last_kinetic, kinetic_before
        Kinetic energy with the rigid motion, like `largest`, `last` and `before` [J].
    worked
        Largest work that obstacles had done until then [J].
    gained
        Largest energy that the method had made in all until then [J].
    imbalance
        A doubt if the balance was off; `Verdict` says whether it counts.
    is_far
        Whether it was off by more than FAR_OFF.
    """

    name = "balance"
    table = "steps"
    start: float
    steps: int = 0
    largest: float = 0.0
    last: float = 0.0
    before: float = 0.0
    off: int = 0
    least: float = math.inf
    t: float = 0.0
    remainder: float = 0.0
    kinetic: float = 0.0
    last_kinetic: float = 0.0
    kinetic_before: float = 0.0
    worked: float = 0.0
    gained: float = 0.0
    imbalance: Doubt | None = None
    is_far: bool = False

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "Balance":
        return cls.open(others[Ledger], others[Deformation])

    @classmethod
    def open(cls, ledger: Ledger, deformation: Deformation) -> "Balance":
        """Return the balance at the start, with the ledger and the deformation there."""
        energy = deformation.energy(ledger)
        return cls(
            ledger.t,
            last=energy,
            before=energy,
            t=ledger.t,
            remainder=ledger.remainder,
            last_kinetic=ledger.kinetic,
            kinetic_before=ledger.kinetic,
        )

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Balance":
        return self.after(run.system, others[Ledger], others[Deformation], info.number)

    def after(
        self, system: System, ledger: Ledger, deformation: Deformation, number: int = 1
    ) -> "Balance":
        """Return the balance after a `number` of steps, with the ledger after the last one."""
        now = deformation.energy(ledger)
        remainder = ledger.remainder
        kinetic = min(ledger.kinetic, self.last_kinetic, self.kinetic_before)
        new = self.changed(
            steps=self.steps + number,
            largest=max(self.largest, min(now, self.last, self.before)),
            last=now,
            before=self.last,
            t=ledger.t,
            remainder=remainder,
            kinetic=max(self.kinetic, kinetic),
            last_kinetic=ledger.kinetic,
            kinetic_before=self.last_kinetic,
            worked=max(self.worked, _work_of_obstacles(system, ledger)),
            gained=max(self.gained, -ledger.numerical),
        )
        trusted = new.trusted(system, ledger)
        remainder = abs(remainder)
        if remainder <= trusted:
            if new.off:
                return new.changed(off=0, least=math.inf)
            return new
        if min(self.least, remainder) <= trusted:  # the first of a new row of steps
            return new.changed(off=1, least=remainder)
        new = new.changed(off=self.off + 1, least=min(self.least, remainder))
        if new.off >= STEPS_OFF:
            return new._doubted(new.least)
        return new

    def finish(self, run: Run, end: End, others: Accounts) -> "Balance":
        """At the end of a run one step whose balance is off is enough for a doubt."""
        if self.off:
            return self._doubted(abs(self.remainder))
        return self

    def _doubted(self, off: float) -> "Balance":
        """Return the balance with a doubt, where it is off by so much [J].

        A balance must be off for ten steps in a row, all by more than is trusted at the last of
        them: a load that sets in has moved little in its first steps.
        """
        is_far = self.is_far or off > FAR_OFF * max(self.scale, self.kinetic)
        by = "off by {:.3g} J, where the energy of deformation was {:.3g} J at most"
        if not math.isfinite(self.remainder):
            by = "not known, because an energy is not finite: the cloth touches an obstacle"
        words = (
            f"step {self.steps}, at t = {self.t:g} s: the energy balance is "
            f"{by.format(self.remainder, self.scale)}: {DISTRUST}"
        )
        doubt = Doubt(DoubtKind.MOTION, words, "take a smaller dt")
        return self.changed(imbalance=self.imbalance or doubt, is_far=is_far)

    @property
    def scale(self) -> float:
        """What the remainder is compared with [J]: `largest`, in the first steps the last."""
        return self.largest or self.last

    def trusted(self, system: System, ledger: Ledger) -> float:
        """Return the largest remainder that causes no warning [J].

        It is 5 % of the `scale` and 2 % of what inner damping has dissipated, or the `noise` if
        that is more. With a term that reports neither energy nor work nothing is known.
        """
        if ledger.silent or ledger.t <= self.start:
            return math.inf
        noise = self.noise(system, ledger)
        error_of_dissipated = ERROR_OF_DISSIPATED * ledger.lost_inside
        return max(LARGEST_REMAINDER * self.scale + error_of_dissipated, noise)

    def noise(self, system: System, ledger: Ledger) -> float:
        """Return the energy [J] that does not matter in a balance.

        It is what round-off and Newton's tolerance leave, 1e-10 of the amounts in the
        remainder's difference, and `negligible_energy`; and 1e-3 of the largest kinetic
        energy: given to one direction, it is 3 % of the speed. Where obstacles lift or push a
        cloth, it is 1e-3 of their work, too: Newton's tolerance "auto" is a part of their
        forces.
        """
        amounts = sum(abs(amount) for amount in ledger.amounts())
        unsolved = ENERGY_UNSOLVED * amounts + negligible_energy(system, ledger.t - self.start)
        return unsolved + SLIGHT_ENERGY * (self.kinetic + self.worked)

    def row(self) -> dict[str, float]:
        """Return the remainder relative to the largest energy of deformation so far."""
        drift = 0.0
        if self.scale:
            drift = self.remainder / self.scale
        return {"drift": drift}


def _work_of_obstacles(system: System, ledger: Ledger) -> float:
    """Return the sum of what the contacts have done or taken [J]."""
    contacts = [name for name, term in system.named if term.limits_direction]
    return sum(abs(ledger.work.get(name, 0.0)) for name in contacts)
