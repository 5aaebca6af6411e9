"""Whether the method itself has dissipated much of the motion."""

from __future__ import annotations

from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.energy_balance import Balance
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.time_error import TimeError
from fecloth.system.system import System
from fecloth.terms.records import remembered

EATEN = 0.2  # fraction of the motion that the method may dissipate without a warning
SLIGHT = 0.02  # error in time below which what was dissipated did not matter


@remembered
@dataclass(frozen=True)
class MethodDissipation(Account):
    """Numerical dissipation at the end of a run."""

    name = "method_dissipation"
    doubt: str = ""

    def finish(self, run: Run, end: End, others: Accounts) -> MethodDissipation:
        if others[TimeError].relative < SLIGHT:
            return MethodDissipation()
        return MethodDissipation(warn_of_dissipation(run.system, others[Balance], others[Ledger]))

    def warnings(self) -> tuple[str, ...]:
        return (self.doubt,)


def warn_of_dissipation(system: System, balance: Balance, ledger: Ledger) -> str:
    """Return a sentence if the method has dissipated more than 20 % of the motion, or "".

    The motion is the balance's `scale` or, if that is more, all that was dissipated: a cloth that
    loads keep in motion loses more than it ever has. A cloth that only flies has none.
    """
    if ledger.silent or ledger.t <= balance.start:
        return ""
    lost = ledger.numerical + sum(ledger.dissipated.values())
    motion = max(balance.scale, lost)
    noise = balance.noise(system, ledger)
    if balance.scale <= noise or not ledger.numerical > max(EATEN * motion, noise):
        return ""
    return (
        f"numerical dissipation has taken {ledger.numerical:.3g} J, "
        f"{100 * ledger.numerical / motion:.0f} % of the energy of the motion: take a smaller "
        "dt, or a method that dissipates less"
    )
