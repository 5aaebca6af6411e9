"""The one doubt about a motion as a whole, at the end of a run: the cause, not what follows."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.jumps import SMALL
from fecloth.simulation.energy_balance import DISTRUST, Balance
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.time_error import TimeError
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

SLIGHT = 0.03  # error in time below which energy that is off or dissipated does not matter
SHARE = 0.05  # of the largest displacement: a smaller jump is not the cause
MADE = 0.05  # of the largest energy that moved: what the method may make at impacts
EATEN = 0.2  # fraction of the motion that the method may dissipate without a warning


@remembered
@dataclass(frozen=True)
class Verdict(Account):
    """What an error in time, the energy balance and numerical dissipation say together.

    Energy is a strict measure of a motion: fast waves have much of it and move the cloth little.
    Where the error in time is known and slight, a balance counts if it is far off only. With
    contact, and for steps that do not solve their equations, that error is not known.
    """

    name = "verdict"
    doubt: str = ""

    def finish(self, run: Run, end: End, others: Accounts) -> "Verdict":
        return Verdict(next(filter(None, _doubts(run, end, others)), ""))


def _doubts(run: Run, end: End, others: Accounts) -> Iterator[str]:
    """Yield what may be said, what is a cause first; "" for none."""
    balance = others[Balance]
    estimate = others.get(TimeError)
    error = estimate.relative if estimate else math.nan
    solves = run.method.traits.solves and not has_kind(run.system.terms, "contact")
    is_slight = error < SLIGHT and solves
    if estimate and not (is_slight and not balance.is_far):
        hits = has_kind(run.system.terms, "contact")  # an obstacle that jumps throws the cloth
        least = max(SMALL * run.system.cloth.extent, 0.0 if hits else SHARE * estimate.moved)
        jump = next((words for size, words in estimate.jumps if size > least), "")
        if jump:
            yield jump if estimate.is_large or not solves else ""
            return
    if has_kind(run.system.terms, "contact"):
        yield warn_of_gain(balance)
    if estimate and estimate.is_large:
        if balance.imbalance:
            too = f"; the energy balance is off, too: {DISTRUST}"
        else:
            too = ""
        yield f"{estimate.sentence}{too}"
    if balance.is_far or not is_slight:
        yield balance.imbalance
    if estimate and not error < SLIGHT:
        yield warn_of_dissipation(run, balance, others[Ledger])


def warn_of_gain(balance: Balance) -> str:
    """Return a sentence if numerical dissipation was below zero by 5 % of what moved, or ""."""
    moved = max(balance.kinetic, balance.scale)
    if balance.gained <= MADE * moved:
        return ""
    return (
        f"numerical dissipation was below zero: the method has made {balance.gained:.3g} J, where "
        f"{moved:.3g} J moved, as its steps do not resolve how contacts push: take BackwardEuler, "
        "or a smaller dt"
    )


def warn_of_dissipation(run: Run, balance: Balance, ledger: Ledger) -> str:
    """Return a sentence if the method has dissipated more than 20 % of the motion, or "".

    The motion is the balance's `scale` or, if that is more, all that was dissipated: a cloth
    that loads keep in motion loses more than it ever has. A cloth that only flies has none.
    """
    if ledger.silent or ledger.t <= balance.start:
        return ""
    lost = ledger.numerical + sum(ledger.dissipated.values())
    motion = max(balance.scale, lost)
    noise = balance.noise(run.system, ledger)
    if balance.scale <= noise or not ledger.numerical > max(EATEN * motion, noise):
        return ""
    remedy = "dt, or a method that dissipates less"
    if has_kind(run.system.terms, "contact"):  # all other methods are refused
        remedy = "dt, or BDF2" if run.method.traits.order == 1 else "dt"
        remedy += "; impacts without a bounce lose energy anyway, and count here, too"
    return (
        f"numerical dissipation has taken {ledger.numerical:.3g} J, "
        f"{100 * ledger.numerical / motion:.0f} % of the energy of the motion: take a smaller "
        f"{remedy}"
    )
