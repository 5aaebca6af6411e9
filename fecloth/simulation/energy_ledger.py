"""The energy ledger of a run: energies, dissipation and work."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fecloth.system.records import remembered
from fecloth.system.state import State
from fecloth.system.system import System

TRUSTED = 0.05  # fraction of the turnover; a larger remainder causes a warning
CREEP = 1e-6  # mean motion since the start, in extents of the cloth, that counts as rest
ROUND_OFF = 64 * np.finfo(float).eps


@remembered
@dataclass(frozen=True)
class Ledger:
    """Energies, dissipation and work since the start, all in J, at time t.

    kinetic + Σ potential + Σ dissipated + numerical − Σ work − pins − start = remainder

    Attributes
    ----------
    kinetic, potential
        ½ v·M v, and each term's energy, now.
    dissipated
        Work done against each damping since the start, Σ dt · power at the method's stage, of
        methods with a memory at the mean of both ends of the step; Σ dt Ė:S_v with
        Ė = (E₁ − E₀)/dt for strain-rate damping over the step.
    work
        Work of each load that has no energy, Σ dt · supply there.
    pins
        Work that the pins did on the cloth: change of the pinned nodes' kinetic energy less the
        work of the other forces on them.
    numerical
        Numerical dissipation by the method's own formula, `numerical`: zero for the midpoint rule;
        exact for energies quadratic in x.
    opening
        The energies at the start, with "kinetic".
    first
        Kinetic energy after the first step.
    silent
        Whether a term reports neither an energy nor its dissipation or work.
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
        """Return the ledger before the first step."""
        opening = system.energies(state)
        energies = dict(opening)
        kinetic = energies.pop("kinetic")
        named = list(zip(system.names, system.bound, strict=True))
        dissipated = {name: 0.0 for name, term in named if term.dissipative}
        work = {name: 0.0 for name, term in named if hasattr(term, "supply")}
        reported = {*energies, *dissipated, *work}
        silent = any(name not in reported for name in system.names)
        return cls(state.t, kinetic, energies, dissipated, work, 0.0, 0.0, opening, silent=silent)

    def after(self, system: System, method, old: State, step) -> Ledger:
        """Return the ledger after `step`, taken by `method` from the state `old`."""
        new = step.state
        dt, stages, acting = new.t - old.t, step.stages, (step.over or system).bound
        energies = system.energies(new)
        kinetic = energies.pop("kinetic")
        inertia = system.scalar_mass @ (new.v - old.v)
        dissipated = {
            name: self.dissipated[name] + _dissipation(term, over, step, dt)
            for name, term, over in zip(system.names, system.bound, acting, strict=True)
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
        """Upper bound of the kinetic energy that the cloth can have received [J].

        The kinetic energy at the start, the decrease of the terms' energies since, the work of
        loads and pins, and the kinetic energy after the first step, in which forward Euler is
        ahead of the work. Unlimited with a term that reports neither an energy nor its work.
        """
        if self.silent:
            return math.inf
        fallen = (self.opening[name] - energy for name, energy in self.potential.items())
        gains = (*fallen, *self.work.values(), self.pins)
        return self.opening["kinetic"] + (self.first or 0.0) + sum(max(0.0, g) for g in gains)

    def growth(self, most: float) -> str:
        """Return a sentence if the kinetic energy exceeds `most` times the `available`, or ""."""
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
        """Energy that the other columns do not explain [J]."""
        lost = sum(self.dissipated.values()) + self.numerical
        return self.total + lost - sum(self.work.values()) - self.pins - self.start

    @property
    def turnover(self) -> float:
        """Sum of the kinetic energy and the amounts of all dissipated energy and work [J]."""
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


def imbalance_warning(system: System, ledger: Ledger, turnover: float, start: float) -> str:
    """Return a sentence if the energy balance of a run since `start` does not close, or "".

    It does not close if the remainder exceeds 5 % of the largest `turnover` [J] so far,
    `negligible_energy`, and 64 ε of the amounts in its difference: Σ |potential|, then and now,
    and the turnover. With a term that reports neither an energy nor its work it is not known.
    """
    remainder, seconds = ledger.remainder, ledger.t - start
    if ledger.silent or not (seconds > 0 and abs(remainder) > TRUSTED * turnover):
        return ""
    amounts = turnover, *ledger.potential.values(), *ledger.opening.values()
    if not abs(remainder) > ROUND_OFF * sum(map(abs, amounts)) + negligible_energy(system, seconds):
        return ""
    return (
        f"the energy balance is off by {remainder:.3g} J, where {turnover:.3g} J have "
        "moved: do not trust this motion; take a smaller dt"
    )


def negligible_energy(system: System, seconds: float) -> float:
    """Return the kinetic energy [J] below which a cloth is at rest: ½ m (1e-6 L/T)².

    m is its mass, L its largest extent and T the time; round-off and tolerances stay below.
    """
    pace = CREEP * float(np.ptp(system.cloth.X, axis=0).max()) / seconds
    return 0.5 * float(system.nodal_mass.sum()) * pace**2


def _dissipation(term, over, step, dt):
    """Energy [J] dissipated in a step: over it, or else the power at the method's stages."""
    if hasattr(over, "dissipation"):
        return over.dissipation(step.state.x)
    return dt * _mean(term.power, step.stages)


def _mean(function, stages):
    return sum(function(at.x, at.v, at.t) for at in stages) / len(stages)


def _pin_work(system, theta, old, step, inertia):
    """Work of the held directions over a step: Δv·M v_θ − f · Δx on the constrained nodes."""
    constraints = system.constraints
    at = constraints.nodes
    fixed = all(pin.motion is None for pin, _ in constraints.groups.values())
    if not len(at) or (fixed and not constraints.held(old.v).any()):
        return 0.0  # otherwise pins stop an initial motion of fixed nodes
    v = old.v + theta * (step.state.v - old.v)
    held_v, held_x = constraints.held(v), constraints.held(step.state.x - old.x)
    f = step.mean_force(system)[at]
    return system.sums.dot(inertia[at], held_v) - system.sums.dot(f, held_x)
