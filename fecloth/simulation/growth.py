"""Whether a method makes energy: then the run fails, long before its numbers overflow."""

import math
from dataclasses import dataclass

import numpy as np

from fecloth.simulation.account import Account, Accounts, Run
from fecloth.simulation.deformation import Deformation, negligible_energy
from fecloth.simulation.energy_balance import ENERGY_UNSOLVED
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.step_failures import explain
from fecloth.simulation.steps import Problem, StepInfo, step_failed
from fecloth.system.system import System
from fecloth.terms.records import remembered

MOST_GROWTH = 4.0  # times the energy available: every usable step so far had less
# Times the last step's work: what loads have given as momentum before they did work.
LAG_OF_WORK = 4.0
# Over the largest coordinate: what the sums and differences of a step leave in a position.
ROUND_OFF_OF_POSITION = 64 * np.finfo(float).eps


@remembered
@dataclass(frozen=True)
class Growth(Account):
    """Whether the last step had more energy than was available.

    A single step may: a load switched on transfers momentum before it has done work. `follow`
    raises `StepFailed` if two steps in a row do.

    Attributes
    ----------
    kinetic
        Kinetic energy of the deformation after the last step [J].
    excess
        `describe_growth` there.
    """

    name = "growth"
    kinetic: float
    excess: str

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "Growth":
        deformation = others[Deformation]
        excess = describe_growth(deformation, others[Ledger], run.most_growth)
        return cls(deformation.kinetic, excess)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Growth":
        """Return the record after a step; `StepFailed` after two in a row with an excess."""
        after = self.begin(run, others)
        if self.excess and after.excess:
            noise = _noise(run.system, info, others[Ledger])
            if min(self.kinetic, after.kinetic) > noise:
                problem = Problem(after.excess)
                failure = step_failed(run.system, info.old, info.step, info.dt, problem)
                raise explain(failure, run.system, run.method)
        return after


def describe_growth(deformation: Deformation, ledger: Ledger, most: float) -> str:
    """Return a sentence if a cloth has more than `most` times the available energy, or "".

    A load that sets in has given momentum before work: the last inflow counts several times.
    """
    inflow = deformation.inflow - deformation.last_inflow
    available = deformation.available(ledger) + LAG_OF_WORK * max(0.0, inflow)
    if math.isinf(most) or deformation.kinetic <= most * available:
        return ""
    return (
        f"the cloth deforms with a kinetic energy of {deformation.kinetic:.3g} J, where its "
        f"start, its loads and its pins can have given it {available:.3g} J at most: the "
        "method has made the rest"
    )


def _noise(system: System, info: StepInfo, ledger: Ledger) -> float:
    """Return the kinetic energy [J] below which growth means nothing.

    It is `negligible_energy` or, if that is more, a sum of two parts. One is ½ m (64 ε |x|/dt)²,
    the round-off of positions. The other is `ENERGY_UNSOLVED` of the energies of the whole motion
    and of the loads, now and at the start: an impact may have taken nearly all of them since.
    """
    speed = ROUND_OFF_OF_POSITION * np.abs(info.result.state.x).max() / info.dt
    of_loads = [ledger.potential.get(name, 0.0) for name, term in system.named if term.load]
    energies = [ledger.kinetic, *ledger.opening.values(), *of_loads]
    unsolved = ENERGY_UNSOLVED * sum(abs(energy) for energy in energies)
    rounded = 0.5 * system.total_mass * speed**2 + unsolved
    return max(rounded, negligible_energy(system, info.t - info.memory.start))
