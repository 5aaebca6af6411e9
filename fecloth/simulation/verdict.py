"""The one doubt about a motion as a whole, at the end of a run: the cause, not what follows."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.jumps import LEAST_JUMP, Jump, find_jumping_motions
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

LARGEST_ACCEPTED = 0.1  # what the error in time is at most without a doubt
# The same for steps that do not solve their equations: it has been 4 times too small.
LARGEST_OF_UNSOLVED = 0.025
LEAST_JUMP_THAT_COUNTS = 0.05  # over the largest displacement: a smaller jump is not the cause


@remembered
@dataclass(frozen=True)
class Verdict(Account):
    """What an error in time, the energy balance and numerical dissipation say together.

    Energy is a strict measure of a motion: fast waves have much of it and move the cloth little.
    Where the error in time is known and accepted, a balance counts if it is far off only. Not so
    with contact: the samples of the error may miss an impact.
    """

    name = "verdict"
    doubt: Doubt | None = None

    def finish(self, run: Run, end: End, others: Accounts) -> "Verdict":
        doubt = next(_find_causes(run, others), None)
        estimate = others.get(TimeError)
        touches = has_kind(run.system.terms, "contact")
        if estimate and (doubt or touches):  # with contact, what jumps throws the cloth
            jump = _find_jump(run, end.state.t, estimate, touches)
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
    if estimate and estimate.relative > accepted:
        yield Doubt(DoubtKind.TIME, estimate.sentence)
    if estimate and not is_small and (taken := doubt_dissipation(run, balance, ledger)):
        yield taken


def _find_jump(run: Run, t_end: float, estimate: TimeError, touches: bool) -> Jump | None:
    """Return the first jump of a pin or an obstacle that is large enough to be the cause.

    With contact any jump is: an obstacle that jumps throws the cloth, however little it jumps.
    """
    least = LEAST_JUMP * run.system.cloth.extent
    if not touches:
        least = max(least, LEAST_JUMP_THAT_COUNTS * estimate.moved)
    start = replace(run.start, t=estimate.start[0])
    jumps = find_jumping_motions(run.system, start, t_end)
    return next((jump for jump in jumps if jump.size > least), None)
