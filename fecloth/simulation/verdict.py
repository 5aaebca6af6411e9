"""The one doubt about a motion as a whole, at the end of a run: the cause, not what follows."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.jumps import LEAST_JUMP, Jump
from fecloth.simulation.energy_balance import (
    Balance,
    doubt_balance,
    doubt_dissipation,
    doubt_gain,
)
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.time_error import TimeError
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

# Error in time without a doubt: half of what is wrong, as an estimate may be half of the error.
LARGEST_ACCEPTED = 0.05
# The same for steps that do not solve their equations: it has been 12 times too small.
LARGEST_OF_UNSOLVED = 0.01
LEAST_JUMP_THAT_COUNTS = 0.05  # over the largest displacement: a smaller jump is not the cause


@remembered
@dataclass(frozen=True)
class Verdict(Account):
    """What an error in time, the energy balance and numerical dissipation say together.

    Energy is a strict measure of a motion: fast waves have much of it and move the cloth little.
    Where the error in time is known and accepted, a balance counts if it is far off only. With
    contact, that error is not known.
    """

    name = "verdict"
    doubt: Doubt | None = None

    def finish(self, run: Run, end: End, others: Accounts) -> "Verdict":
        doubt = next(_find_causes(run, others), None)
        estimate = others.get(TimeError)
        touches = has_kind(run.system.terms, "contact")
        if estimate and (doubt or touches):  # with contact, what jumps throws the cloth
            jump = _find_jump(run, estimate, touches)
            doubt = jump.doubt if jump else doubt
        return Verdict(doubt)

    def doubts(self) -> list[Doubt]:
        if self.doubt:
            return [self.doubt]
        return []


def _find_causes(run: Run, others: Accounts) -> Iterator[Doubt]:
    """Yield what may be said of a motion; the first doubt is what a run says."""
    balance = others[Balance]
    ledger = others[Ledger]
    estimate = others.get(TimeError)
    touches = has_kind(run.system.terms, "contact")
    accepted = LARGEST_ACCEPTED if run.method.traits.solves else LARGEST_OF_UNSOLVED
    is_small = estimate is not None and estimate.relative < accepted
    if touches and (gain := doubt_gain(run, balance)):
        yield gain
    if balance.is_off(run.system, ledger, far=is_small and not touches):
        yield doubt_balance(run, balance)
    if estimate and known_error(estimate) > accepted:
        yield Doubt(DoubtKind.TIME, estimate.sentence)
    if estimate and not is_small and (taken := doubt_dissipation(run, balance, ledger)):
        yield taken


def known_error(estimate: TimeError) -> float:
    """Return the relative error in time, or what is known of one that is not stated.

    That is the geometric mean of the sum of errors and the error that was carried, over the
    largest displacement, as where it is stated; of explicit methods, the sum.
    """
    if not estimate.unknown or not estimate.moved:
        return estimate.relative
    known = estimate.largest
    if estimate.carried:
        known = math.sqrt(estimate.largest * estimate.carried)
    return known / estimate.moved


def _find_jump(run: Run, estimate: TimeError, touches: bool) -> Jump | None:
    """Return the first jump of a pin or an obstacle that is large enough to be the cause.

    With contact any jump is: an obstacle that jumps throws the cloth, however little it jumps.
    """
    least = LEAST_JUMP * run.system.cloth.extent
    if not touches:
        least = max(least, LEAST_JUMP_THAT_COUNTS * estimate.moved)
    return next((jump for jump in estimate.jumps if jump.size > least), None)
