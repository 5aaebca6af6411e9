"""What the energy of a run does not explain: the one account of it.

The ledger says how much energy is unexplained, and how much the method has made or taken. This
account has the energy that has moved, with which these are compared.
"""

import math
from dataclasses import dataclass

from fecloth.simulation.account import Account, Accounts, Run
from fecloth.simulation.deformation import (
    kinetic_of_deformation,
    negligible_energy,
    stored_by_deformation,
)
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.shorter_steps import name_shorter_steps
from fecloth.simulation.step_failures import explain
from fecloth.simulation.steps import Problem, StepInfo, step_failed
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered
from fecloth.terms.traits import has_kind

MOST_GROWTH = 4.0  # energy that a method may make, over the energy that was supplied
LARGEST_REMAINDER = 0.05  # over the energy that has moved; of what contacts have made, too
FAR_OFF = 0.5  # over the energy of the motion: a remainder that no small error in time excuses
MOST_TAKEN = 0.2  # over that energy: what the method may dissipate without a doubt
# Over the largest kinetic energy and the work: 3 % of a speed do not matter.
SLIGHT_ENERGY = 1e-3
ENERGY_UNSOLVED = 1e-10  # over all amounts in the ledger: what Newton's tolerance leaves


@remembered
@dataclass(frozen=True)
class Balance(Account):
    """The energy that has moved in a run, and the measure of what is not explained.

    Attributes
    ----------
    start
        Time of the start [s].
    deforming
        Kinetic energy of the deformation after the last step [J].
    moved
        Largest energy so far that has moved through the deformation [J]: its kinetic energy, the
        changes of the energies of terms that are no loads, and what inner damping and the method
        have taken. It is the same for every observer.
    kinetic
        Largest kinetic energy so far, with the rigid motion [J].
    lost
        Largest energy so far that damping, the method and impacts have taken in all [J].
    gained
        Largest energy that these have given back after they had taken `lost`: the energy of the
        cloth has grown by it, and no load has done that work [J]. What one of them gives while
        another takes it is no gain.
    supplied
        Largest `Ledger.supplied` so far [J].
    remainder
        The remainder of the ledger after the last step [J].
    growth
        `describe_growth` after the last step.
    first
        What the method made in the first step [J]: a start that does not fit the motion of the
        pins gives energy, which is no growth. None before it.
    """

    name = "balance"
    table = "steps"
    start: float
    deforming: float
    moved: float = 0.0
    kinetic: float = 0.0
    lost: float = 0.0
    gained: float = 0.0
    supplied: float = 0.0
    remainder: float = 0.0
    growth: str = ""
    first: float | None = None

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "Balance":
        return cls.open(run.system, run.start, others[Ledger])

    @classmethod
    def open(cls, system: System, state: State, ledger: Ledger) -> "Balance":
        """Return the record at the start, with the ledger there."""
        _, pin_v = system.constraints.target(state.t, 0.0, state.x)
        deforming = kinetic_of_deformation(system, state, ledger.kinetic, pin_v)
        return cls(ledger.t, deforming, moved=deforming, kinetic=ledger.kinetic)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Balance":
        """Return the record after a step; `StepFailed` after two rows with too much growth.

        One row may have it: forward Euler moves a cloth before its forces have done work.
        """
        ledger = others[Ledger]
        after = self.after(run.system, info.old, info.result.state, ledger)
        if after.first is None:
            is_single = info.skipped is None
            after = after.changed(first=max(0.0, after.made(ledger)) if is_single else 0.0)
        growth = after.describe_growth(run.system, ledger, run.most_growth)
        if growth and self.growth:
            failure = step_failed(run.system, info.old, info.step, info.dt, Problem(growth))
            raise explain(failure, run.system, run.method)
        return after.changed(growth=growth)

    def after(self, system: System, old: State, new: State, ledger: Ledger) -> "Balance":
        """Return the record after a step between two states, with the ledger after it."""
        pin_v = new.v
        if system.movable_pieces:
            pin_v = (new.x - old.x) / (new.t - old.t)
        deforming = kinetic_of_deformation(system, new, ledger.kinetic, pin_v)
        taken = ledger.lost_inside + abs(ledger.numerical)
        moved = deforming + stored_by_deformation(system, ledger) + taken
        lost = max(self.lost, ledger.lost)
        return self.changed(
            deforming=deforming,
            moved=max(self.moved, moved),
            kinetic=max(self.kinetic, ledger.kinetic),
            lost=lost,
            gained=max(self.gained, lost - ledger.lost),
            supplied=max(self.supplied, ledger.supplied),
            remainder=ledger.remainder,
        )

    def describe_growth(self, system: System, ledger: Ledger, most: float) -> str:
        """Return a sentence if the cloth deforms with too much energy that the method has made.

        That is more than `most` times what was supplied and what the first step has made.
        """
        supplied = self.supplied + (self.first or 0.0)
        # What the ledger has now may have grown, too: tolerances are of what was there before.
        before = sum(map(abs, ledger.opening.values())) + self.supplied
        noise = SLIGHT_ENERGY * self.kinetic + ENERGY_UNSOLVED * before
        noise += negligible_energy(system, ledger.t - self.start)
        if ledger.silent or not self.made(ledger) > most * supplied + noise:
            return ""
        return (
            f"the cloth deforms with a kinetic energy of {self.deforming:.3g} J, where its "
            f"start, its loads and its pins have given it {self.supplied:.3g} J at most: the "
            "method has made the rest"
        )

    def made(self, ledger: Ledger) -> float:
        """Return the kinetic energy of the deformation that the method has made [J].

        The method has made what the ledger does not explain without the method's own column. What
        damping has taken of it since makes no motion.
        """
        return min(self.deforming, ledger.remainder - ledger.numerical)

    def noise(self, system: System, ledger: Ledger) -> float:
        """Return the energy [J] that does not matter: round-off, tolerances, slight speeds.

        It is `negligible_energy`, 1e-10 of the amounts in the ledger, and 1e-3 of the largest
        kinetic energy and of the work of loads and pins.
        """
        worked = abs(ledger.pins) + sum(map(abs, ledger.work.values()))
        unsolved = ENERGY_UNSOLVED * sum(map(abs, ledger.amounts()))
        slight = SLIGHT_ENERGY * (self.kinetic + worked)
        return slight + unsolved + negligible_energy(system, ledger.t - self.start)

    def is_off(self, system: System, ledger: Ledger, far: bool = False) -> bool:
        """Return whether the remainder is above 5 % of what has moved.

        Or `far`: above half of it, or of the kinetic energy if that is more. With a term that
        reports neither energy nor work nothing is known, nor before a step.
        """
        if ledger.silent or ledger.t <= self.start:
            return False
        most = LARGEST_REMAINDER * self.moved
        if far:
            most = FAR_OFF * max(self.moved, self.kinetic)
        return not abs(self.remainder) <= most + self.noise(system, ledger)

    def row(self) -> dict[str, float]:
        """Return the remainder over the energy that has moved so far."""
        drift = 0.0
        if self.moved:
            drift = self.remainder / self.moved
        return {"drift": drift}


def doubt_balance(run: Run, balance: Balance) -> Doubt:
    """Return the doubt about a balance that is off at the end of a run."""
    by = f"off by {balance.remainder:.3g} J, where {balance.moved:.3g} J have moved"
    if not math.isfinite(balance.remainder):
        by = "not known, because an energy is not finite: the cloth touches an obstacle"
    words = f"the energy balance is {by}: do not trust this motion"
    return Doubt(DoubtKind.MOTION, words, f"take {name_shorter_steps(run.method)}")


def doubt_gain(run: Run, balance: Balance) -> Doubt | None:
    """Return a doubt if the method has made more than 5 % of what moved, as at impacts."""
    moved = max(balance.kinetic, balance.moved)
    if balance.gained <= LARGEST_REMAINDER * moved:
        return None
    words = (
        f"the energy of the cloth has grown by {balance.gained:.3g} J without work, where "
        f"{moved:.3g} J moved: the steps do not resolve how contacts push"
    )
    remedy = f"take BackwardEuler, or {name_shorter_steps(run.method)}"
    return Doubt(DoubtKind.GAIN, words, remedy)


def doubt_dissipation(run: Run, balance: Balance, ledger: Ledger) -> Doubt | None:
    """Return a doubt if the method has dissipated more than 20 % of what moved.

    A cloth that only flies as a rigid body has no such energy, and no doubt.
    """
    if ledger.silent or ledger.t <= balance.start:
        return None
    motion = max(balance.moved, ledger.numerical + sum(ledger.dissipated.values()))
    if not ledger.numerical > MOST_TAKEN * motion + balance.noise(run.system, ledger):
        return None
    shorter = name_shorter_steps(run.method)
    remedy = f"take {shorter}, or a method that dissipates less"
    if has_kind(run.system.terms, "contact"):
        remedy = f"take {shorter}"
        if run.method.traits.order == 1:  # of order 2 BDF2 alone is allowed with contact
            remedy = f"take {shorter}, or BDF2"
        remedy += "; impacts without a bounce lose energy anyway, and count here, too"
    words = (
        f"numerical dissipation has taken {ledger.numerical:.3g} J, "
        f"{100 * ledger.numerical / motion:.0f} % of the energy of the motion"
    )
    return Doubt(DoubtKind.DAMPING, words, remedy)
