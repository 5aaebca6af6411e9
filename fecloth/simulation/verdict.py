"""The one doubt about a motion as a whole, at the end of a run: the cause, not what follows."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.jumps import LEAST_JUMP, Jump
from fecloth.simulation.energy_balance import DISTRUST, Balance
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.time_error import TimeError
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

# Error in time below which energy that is off or dissipated does not matter.
SLIGHT_ERROR = 0.03
LEAST_JUMP_THAT_COUNTS = 0.05  # over the largest displacement: a smaller jump is not the cause
ENERGY_MADE = 0.05  # over the largest energy that moved: what the method may make at impacts
# Over the energy of the motion: what the method may dissipate without a doubt.
ENERGY_TAKEN = 0.2


@remembered
@dataclass(frozen=True)
class Verdict(Account):
    """What an error in time, the energy balance and numerical dissipation say together.

    Energy is a strict measure of a motion: fast waves have much of it and move the cloth little.
    Where the error in time is known and slight, a balance counts if it is far off only. With
    contact, and for steps that do not solve their equations, that error is not known.
    """

    name = "verdict"
    doubt: Doubt | None = None

    def finish(self, run: Run, end: End, others: Accounts) -> "Verdict":
        return Verdict(next(filter(None, _find_causes(run, others)), None))

    def doubts(self) -> list[Doubt]:
        if self.doubt:
            return [self.doubt]
        return []


def _find_causes(run: Run, others: Accounts) -> Iterator[Doubt | None]:
    """Yield what may be said, causes before what follows from them; None where there is nothing.

    The first doubt is what a run says.
    """
    balance = others[Balance]
    estimate = others.get(TimeError)
    error = math.nan
    if estimate:
        error = estimate.relative
    touches = has_kind(run.system.terms, "contact")
    solves = run.method.traits.solves and not touches
    is_slight = error < SLIGHT_ERROR and solves
    if estimate and not (is_slight and not balance.is_far):
        jump = _find_jump(run, estimate, touches)
        if jump:
            if estimate.is_large or not solves:
                yield jump.doubt
            return
    if touches:
        yield doubt_gain(balance)
    if estimate and estimate.is_large:
        if balance.imbalance:
            words = f"{estimate.sentence}; the energy balance is off, too: {DISTRUST}"
            yield Doubt(DoubtKind.MOTION, words)
        yield Doubt(DoubtKind.TIME, estimate.sentence)
    if balance.is_far or not is_slight:
        yield balance.imbalance
    if estimate and not error < SLIGHT_ERROR:
        yield doubt_dissipation(run, balance, others[Ledger])


def _find_jump(run: Run, estimate: TimeError, touches: bool) -> Jump | None:
    """Return the first jump of a pin or an obstacle that is large enough to be the cause.

    With contact any jump is: an obstacle that jumps throws the cloth, however little it jumps.
    """
    least = LEAST_JUMP * run.system.cloth.extent
    if not touches:
        least = max(least, LEAST_JUMP_THAT_COUNTS * estimate.moved)
    return next((jump for jump in estimate.jumps if jump.size > least), None)


def doubt_gain(balance: Balance) -> Doubt | None:
    """Return a doubt if numerical dissipation was below zero by 5 % of what moved."""
    moved = max(balance.kinetic, balance.scale)
    if balance.gained <= ENERGY_MADE * moved:
        return None
    words = (
        f"numerical dissipation was below zero: the method has made {balance.gained:.3g} J, "
        f"where {moved:.3g} J moved, as its steps do not resolve how contacts push"
    )
    return Doubt(DoubtKind.GAIN, words, "take BackwardEuler, or a smaller dt")


def doubt_dissipation(run: Run, balance: Balance, ledger: Ledger) -> Doubt | None:
    """Return a doubt if the method has dissipated more than 20 % of the motion.

    The energy of the motion is the balance's `scale` or, if that is more, all that was
    dissipated: a cloth that loads keep in motion loses more energy than it ever has. A cloth
    that only flies as a rigid body has no such energy, and no doubt. There is none either where
    a term reports neither energy nor work (`Ledger.silent`).
    """
    if ledger.silent or ledger.t <= balance.start:
        return None
    lost = ledger.numerical + sum(ledger.dissipated.values())
    motion = max(balance.scale, lost)
    noise = balance.noise(run.system, ledger)
    if balance.scale <= noise or not ledger.numerical > max(ENERGY_TAKEN * motion, noise):
        return None
    remedy = "take a smaller dt, or a method that dissipates less"
    if has_kind(run.system.terms, "contact"):
        remedy = "take a smaller dt"
        if run.method.traits.order == 1:  # of order 2 BDF2 alone is allowed with contact
            remedy = "take a smaller dt, or BDF2"
        remedy += "; impacts without a bounce lose energy anyway, and count here, too"
    words = (
        f"numerical dissipation has taken {ledger.numerical:.3g} J, "
        f"{100 * ledger.numerical / motion:.0f} % of the energy of the motion"
    )
    return Doubt(DoubtKind.DAMPING, words, remedy)
