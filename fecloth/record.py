"""What a run leaves behind in numbers: the energy ledger, reactions and probes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .cloth import Cloth, Where
from .compiled import kernel
from .errors import InputError
from .sums import dot, mean
from .system import State, System
from .terms.membrane import gradient


@dataclass(frozen=True)
class Ledger:
    """Where the energy is and where it went, all in J, at time t.

    kinetic + Σ potential + Σ dissipated + numerical − Σ work − pins − start = remainder

    Attributes
    ----------
    kinetic, potential
        ½ v·M v, and each term's energy, now.
    dissipated
        Work done against each damping since the start, Σ dt · power at the method's stage.
    work
        Work of each load that has no energy, Σ dt · supply at the method's stage.
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
        dt, stages = new.t - old.t, stages_of(step)
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
            pins=self.pins + _pin_work(system, method.theta, old, step, inertia),
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
            f"the cloth moves with {self.kinetic:.3g} J, where its loads and its start can have "
            f"given it {self.available:.3g} J at most: the method has made the rest"
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


def stages_of(step) -> tuple[State, ...]:
    """Where the forces of a step were taken, equal in weight."""
    return getattr(step, "stages", (step.stage,))


def _mean(function, stages):
    return sum(function(at.x, at.v, at.t) for at in stages) / len(stages)


def mean_force(system: System, step) -> np.ndarray:
    """(n, 3) force [N] that moved the cloth over a step: its own, or the mean of its stages'."""
    if hasattr(step, "force"):
        return step.force
    stages = stages_of(step)
    return sum(system.force(at) for at in stages) / len(stages)


def column_forces(system: System, state: State) -> np.ndarray:
    """(n, 3) forces [N] whose power the ledger sums as dissipated or as work."""
    f, still = np.zeros_like(state.x), np.zeros_like(state.v)
    for term in system.bound:
        if term.dissipative or hasattr(term, "supply"):
            term.add_force(state.x, state.v, state.t, f)
            if term.has_energy:
                elastic = np.zeros_like(f)
                term.add_force(state.x, still, state.t, elastic)
                f -= elastic
    return f


def conservative(system: System, state: State) -> np.ndarray:
    """(n, 3) force of the terms that have an energy, without the damping that they may have."""
    f, still = np.zeros_like(state.x), np.zeros_like(state.v)
    for term in system.bound:
        if term.has_energy:
            term.add_force(state.x, still, state.t, f)
    return f


def _pin_work(system, theta, old, step, inertia):
    """Work of the held directions over a step: Δv·M v_θ − f · Δx on the constrained nodes."""
    constraints = system.constraints
    at = constraints.nodes
    fixed = all(pin.motion is None for pin, _ in constraints.groups.values())
    if not len(at) or (fixed and not constraints.held(old.v).any()):
        return 0.0  # but a start that moves what is fixed is stopped by the pins
    v = old.v + theta * (step.state.v - old.v)
    held_v, held_x = constraints.held(v), constraints.held(step.state.x - old.x)
    f = mean_force(system, step)[at]
    return dot(inertia[at], held_v) - dot(f, held_x)


def reactions(system: System, old: State, step) -> dict[str, np.ndarray]:
    """Pin group → force (3,) [N] with which it holds the cloth over a step, M Δv/dt − f summed.

    A step with an acceleration `a` of its own, at which it balanced the forces, is taken by that.
    Only the held directions count: a slide has no reaction along its line or plane.
    """
    if not system.constraints.groups:
        return {}
    dt = step.state.t - old.t
    constraints = system.constraints
    a = getattr(step, "a", (step.state.v - old.v) / dt)
    residual = system.scalar_mass @ a - mean_force(system, step)
    residual[constraints.nodes] = constraints.held(residual)
    return {name: residual[nodes].sum(axis=0) for name, (_, nodes) in constraints.groups.items()}


@dataclass(frozen=True)
class Probe:
    """The path of a named node set (its mean), of nodes, or of a material point (X, Y).

    Parameters
    ----------
    name
        Column name.
    where
        A node set's name, node indices or a predicate: the mean position of those nodes.
    point
        Material coordinates (X, Y) [m]; give this or `where`.
    """

    name: str
    where: Where | None = None
    point: tuple[float, float] | None = None

    def __post_init__(self):
        if (self.where is None) == (self.point is None):
            raise InputError(f"probe {self.name!r}", "needs either `where` or `point`", "Probe")

    def weights(self, cloth: Cloth):
        """(1, n) matrix that takes nodal positions to the probe's."""
        if self.point is not None:
            return cloth.interpolator(np.array([self.point]))
        nodes = cloth.nodes(self.where)
        row = np.zeros((1, len(cloth.X)))
        row[0, nodes] = 1.0 / len(nodes)
        return row


@dataclass(frozen=True, eq=False)
class Observer:
    """The quantities recorded at every step, bound to a system and its start."""

    system: System
    start: State
    probes: Mapping[str, object]

    @classmethod
    def bind(cls, system: System, start: State, probes=()) -> Observer:
        probes = _distinct(probes)
        return cls(system, start, {p.name: p.weights(system.cloth) for p in probes})

    def row(self, old: State | None, step) -> dict[str, float]:
        """Probe paths, displacement, sag, area, and reactions over the step (none at the start)."""
        state = self.start if step is None else step.state
        mass = self.system.nodal_mass
        moved = state.x - self.start.x
        row = {"t": state.t}
        for name, weights in self.probes.items():
            row |= _components(name, np.ravel(weights @ state.x))
        row |= _components("mean_displacement", mean(mass, moved))
        row["sag"] = float(-moved[:, 2].min())
        row["area"] = area(self.system.cloth, state.x)
        held = reactions(self.system, old, step) if step is not None else {}
        for name in self.system.constraints.groups:
            row |= _components(f"reaction:{name}", held.get(name, np.full(3, np.nan)))
        return row


def _distinct(probes) -> tuple[Probe, ...]:
    """The probes, if they are some and their columns their own."""
    if isinstance(probes, Probe) or not all(isinstance(p, Probe) for p in probes):
        raise InputError(f"probes = {probes!r}", "must be a list of Probe", "Observer")
    names = [probe.name for probe in probes]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"probe {name!r} stands twice", "needs a name of its own", "Observer")
        if name in ("mean_displacement", "sag", "area") or name.startswith("reaction:"):
            raise InputError(f"probe {name!r}", "is the name of a column of every run", "Observer")
    return tuple(probes)


def area(cloth: Cloth, x: np.ndarray) -> float:
    """Deformed area Σ w √det(FᵀF) [m²], of P2 triangles by the 6 points of their energy."""
    return _area(*cloth.shape, cloth.stencil, cloth.gradients, cloth.weights, x)


@kernel
def _area(K, Q, nodes, G, w, x):
    """Σ w |F₁ × F₂|."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F11, F21, F31, F12, F22, F32 = gradient(K, nodes, G, e, q, x)
            n1, n2, n3 = F21 * F32 - F31 * F22, F31 * F12 - F11 * F32, F11 * F22 - F21 * F12
            total += w[e, q] * math.sqrt(n1 * n1 + n2 * n2 + n3 * n3)
    return total


def _components(name, vector):
    return {f"{name}.{c}": float(value) for c, value in zip("xyz", vector, strict=True)}
