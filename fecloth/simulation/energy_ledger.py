"""What a run leaves behind in numbers: the energy ledger."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fecloth.linalg.reductions import dot
from fecloth.records import remembered
from fecloth.system.system import State, System

TRUSTED = 0.05  # of the energy that moved: a larger remainder is told
CREEP = 1e-6  # of its extent in all the time since the start: no motion to speak of
ROUND_OFF = 64 * np.finfo(float).eps


@remembered
@dataclass(frozen=True)
class Ledger:
    """Where the energy is and where it went, all in J, at time t.

    kinetic + Σ potential + Σ dissipated + numerical − Σ work − pins − start = remainder

    Attributes
    ----------
    kinetic, potential
        ½ v·M v, and each term's energy, now.
    dissipated
        Work done against each damping since the start, Σ dt · power at the method's stage, of
        methods with a memory at the mean of both ends of the step.
    work
        Work of each load that has no energy, Σ dt · supply there.
    pins
        Work that the pins did on the cloth: change of the pinned nodes' kinetic energy less the
        work of the other forces on them.
    numerical
        What the method itself takes, by its own formula, its `numerical`: nothing for the midpoint
        rule; exact for energies quadratic in x.
    opening
        The energies at the start, with "kinetic".
    first
        Kinetic energy after the first step.
    silent
        Whether a term tells neither an energy nor what it dissipates or works.
    """

    t: float
    kinetic: float
    potential: Mapping[str, float]
    dissipated: Mapping[str, float]
    work: Mapping[str, float]
    pins: float
    numerical: float
    opening: Mapping[str, float]
    first: float | None = None
    silent: bool = False

    @classmethod
    def open(cls, system: System, state: State) -> Ledger:
        """The ledger before the first step."""
        opening = system.energies(state)
        energies = dict(opening)
        kinetic = energies.pop("kinetic")
        named = list(zip(system.names, system.bound, strict=True))
        dissipated = {name: 0.0 for name, term in named if term.dissipative}
        work = {name: 0.0 for name, term in named if hasattr(term, "supply")}
        told = {*energies, *dissipated, *work}
        silent = any(name not in told for name in system.names)
        return cls(state.t, kinetic, energies, dissipated, work, 0.0, 0.0, opening, silent=silent)

    def after(self, system: System, method, old: State, step) -> Ledger:
        """The ledger after `step`, taken by `method` from the state `old`."""
        new = step.state
        dt, stages = new.t - old.t, step.stages
        energies = system.energies(new)
        kinetic = energies.pop("kinetic")
        inertia = system.scalar_mass @ (new.v - old.v)
        dissipated = {
            name: self.dissipated[name] + dt * _mean(term.power, stages)
            for name, term in zip(system.names, system.bound, strict=True)
            if term.dissipative
        }
        work = {
            name: self.work[name] + dt * _mean(term.supply, stages)
            for name, term in zip(system.names, system.bound, strict=True)
            if name in self.work
        }
        return replace(
            self,
            t=new.t,
            kinetic=kinetic,
            potential=energies,
            dissipated=dissipated,
            work=work,
            pins=self.pins + _pin_work(system, method.traits.theta, old, step, inertia),
            numerical=self.numerical + method.numerical(system, old, step),
            first=kinetic if self.first is None else self.first,
        )

    @property
    def start(self) -> float:
        """kinetic + Σ potential at the start [J]."""
        return sum(self.opening.values())

    @property
    def available(self) -> float:
        """What the cloth can have got as kinetic energy [J].

        What it had, what the terms' energies have fallen by since the start, and what loads and
        pins have worked. A first step may be ahead of that by what it gave: forward Euler's is.
        Unlimited with a term that tells neither an energy nor its work.
        """
        if self.silent:
            return math.inf
        fallen = (self.opening[name] - energy for name, energy in self.potential.items())
        got = (*fallen, *self.work.values(), self.pins)
        return self.opening["kinetic"] + (self.first or 0.0) + sum(max(0.0, g) for g in got)

    def growth(self, most: float) -> str:
        """In words that there is more kinetic energy than so many times the `available`, or ""."""
        if self.kinetic <= most * self.available:
            return ""
        return (
            f"the cloth moves with {self.kinetic:.3g} J, where its start, its loads and its pins "
            f"can have given it {self.available:.3g} J at most: the method has made the rest"
        )

    @property
    def total(self) -> float:
        """kinetic + Σ potential [J]."""
        return self.kinetic + sum(self.potential.values())

    @property
    def remainder(self) -> float:
        """What the other columns do not explain [J]."""
        lost = sum(self.dissipated.values()) + self.numerical
        return self.total + lost - sum(self.work.values()) - self.pins - self.start

    @property
    def turnover(self) -> float:
        """What has moved: kinetic and the amounts of all that was dissipated or worked [J]."""
        flows = *self.dissipated.values(), *self.work.values(), self.pins, self.numerical
        return self.kinetic + sum(map(abs, flows))

    def row(self) -> dict[str, float]:
        """One row of energies.csv."""
        return {
            "t": self.t,
            "kinetic": self.kinetic,
            **self.potential,
            **{f"dissipated:{name}": value for name, value in self.dissipated.items()},
            **{f"work:{name}": value for name, value in self.work.items()},
            "pins": self.pins,
            "numerical": self.numerical,
            "total": self.total,
            "remainder": self.remainder,
        }


def doubt(system: System, ledger: Ledger, turnover: float, start: float) -> str:
    """In words that the energy balance of a run since `start` does not close, or "".

    Its remainder is beyond 5 % of the largest `turnover` [J] that there was, beyond `slight`, and
    beyond 64 ε of the amounts that it is the difference of: Σ |potential|, then and now, and the
    turnover. With a term that tells neither an energy nor its work, nothing can be said.
    """
    remainder, seconds = ledger.remainder, ledger.t - start
    if ledger.silent or not (seconds > 0 and abs(remainder) > TRUSTED * turnover):
        return ""
    amounts = turnover, *ledger.potential.values(), *ledger.opening.values()
    if not abs(remainder) > ROUND_OFF * sum(map(abs, amounts)) + slight(system, seconds):
        return ""
    return (
        f"the energy balance is off by {remainder:.3g} J, where {turnover:.3g} J have "
        "moved: do not trust this motion; take a smaller dt"
    )


def slight(system: System, seconds: float) -> float:
    """Kinetic energy [J] of a cloth that creeps: ½ m (1e-6 L/T)², a millionth of L in the time T.

    m is its mass and L its largest extent; round-off and tolerances make less of one at rest.
    """
    pace = CREEP * float(np.ptp(system.cloth.X, axis=0).max()) / seconds
    return 0.5 * float(system.nodal_mass.sum()) * pace**2


def _mean(function, stages):
    return sum(function(at.x, at.v, at.t) for at in stages) / len(stages)


def _pin_work(system, theta, old, step, inertia):
    """Work of the held directions over a step: Δv·M v_θ − f · Δx on the constrained nodes."""
    constraints = system.constraints
    at = constraints.nodes
    fixed = all(pin.motion is None for pin, _ in constraints.groups.values())
    if not len(at) or (fixed and not constraints.held(old.v).any()):
        return 0.0  # but a start that moves what is fixed is stopped by the pins
    v = old.v + theta * (step.state.v - old.v)
    held_v, held_x = constraints.held(v), constraints.held(step.state.x - old.x)
    f = step.mean_force(system)[at]
    return dot(inertia[at], held_v) - dot(f, held_x)
