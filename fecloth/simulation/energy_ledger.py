"""The energy ledger of a run: energies, dissipation and work."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fecloth.integrators.fused_steps import Flows
from fecloth.integrators.numerical_dissipation import has_power_column, load_displacement
from fecloth.linalg.reductions import dot
from fecloth.simulation.rigid_motion import rms_without_rigid
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

OWN_ERROR = 0.05  # of the work of loads, with which a ledger whose balance closes may err
CREEP = 1e-6  # mean motion since the start, in extents of the cloth, that counts as rest
NO_POWER = 1e-12  # W; round-off of an inner damping at 1 m/s
LAG = 4.0  # times the last step's work: what loads have given as momentum before they did work


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
        Work of each load that has no energy: its mean force there times the displacement
        (`load_displacement`); of loads that also dissipate, Σ dt · supply there.
    pins
        Work that the pins did on the cloth: change of the pinned nodes' kinetic energy less the
        work of the other forces on them.
    numerical
        Numerical dissipation by the method's own formula, `numerical`: zero for the midpoint rule;
        exact for energies quadratic in x.
    opening
        The energies at the start, with "kinetic".
    deforming
        Kinetic energy of the motion relative to the rigid motion of each movable piece, of the
        free directions: ½ w·M w with w = P (v − u − ω × r), see `Piece.rigid_velocity`.
    in_place
        Energies of the loads now, with each movable piece moved back by its mean displacement.
    opening_deforming, first_deforming
        `deforming` at the start and after the first step.
    places
        Place of each movable piece at the start (`Piece.place`) [m].
    last_inflow
        `inflow` before the last step, or before those without a row.
    resisting
        Names of the terms that dissipate also in a rigid motion, such as drag.
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
    deforming: float
    in_place: Mapping[str, float]
    opening_deforming: float
    first_deforming: float | None = None
    places: tuple[tuple[float, ...], ...] = ()
    last_inflow: float = 0.0
    resisting: tuple[str, ...] = ()
    silent: bool = False

    @classmethod
    def open(cls, system: System, state: State) -> Ledger:
        """Return the ledger before the first step."""
        opening = system.energies(state)
        energies = dict(opening)
        kinetic = energies.pop("kinetic")
        named = list(zip(system.names, system.bound, strict=True))
        dissipated = {name: 0.0 for name, term in named if term.dissipative}
        work = {name: 0.0 for name, term in named if term.supplies}
        reported = {*energies, *dissipated, *work}
        silent = any(name not in reported for name in system.names)
        places = tuple(tuple(place.tolist()) for place in _places(system, state))
        _, pin_v = system.constraints.target(state.t, 0.0, state.x)
        deforming = _deforming_kinetic(system, state, kinetic, pin_v)
        flows = dissipated, work, 0.0, 0.0
        in_place = _energies_in_place(system, state, energies, places)
        ledger = cls(state.t, kinetic, energies, *flows, opening, deforming, in_place, deforming)
        resisting = _resisting(system, state, dissipated)
        return replace(ledger, places=places, resisting=resisting, silent=silent)

    def after(self, system: System, method, old: State, step, flows: Flows | None = None) -> Ledger:
        """Return the ledger after `step`, taken by `method` from the state `old`.

        `flows` are those since this ledger, where they are known; otherwise those of the step.
        """
        new = step.state
        dt = new.t - old.t
        energies = system.with_history(step.history).energies(new)
        kinetic = energies.pop("kinetic")
        pin_v = (new.x - old.x) / dt if system.movable_pieces else new.v
        deforming = _deforming_kinetic(system, new, kinetic, pin_v)
        flows = flows or self._flows(system, method, old, step)
        return replace(
            self.with_flows(flows),
            t=new.t,
            kinetic=kinetic,
            potential=energies,
            last_inflow=self.inflow,
            deforming=deforming,
            in_place=_energies_in_place(system, new, energies, self.places),
            first_deforming=deforming if self.first_deforming is None else self.first_deforming,
        )

    def _flows(self, system: System, method, old: State, step) -> Flows:
        """Return dissipation and work of a step."""
        dt, acting = step.state.t - old.t, (step.over or system).bound
        inertia = system.scalar_mass @ (step.state.v - old.v)
        dissipated = {
            name: _dissipation(term, over, step, dt)
            for name, term, over in zip(system.names, system.bound, acting, strict=True)
            if term.dissipative
        }
        work = {
            name: _work(term, old, step, method.traits.explicit)
            for name, term in zip(system.names, system.bound, strict=True)
            if name in self.work
        }
        pins = _pin_work(system, method.traits.theta, old, step, inertia)
        pins += _clamp_work(system, method.traits.theta, old, step)
        return Flows(dissipated, work, pins, method.numerical(system, old, step))

    def with_flows(self, flows: Flows) -> Ledger:
        """Return the ledger with the flows of steps of which it has no rows."""
        dissipated = {n: e + flows.dissipated.get(n, 0.0) for n, e in self.dissipated.items()}
        return replace(
            self,
            dissipated=dissipated,
            work={name: done + flows.work.get(name, 0.0) for name, done in self.work.items()},
            pins=self.pins + flows.pins,
            numerical=self.numerical + flows.numerical,
        )

    @property
    def start(self) -> float:
        """kinetic + Σ potential at the start [J]."""
        return sum(self.opening.values())

    @property
    def deformation(self) -> float:
        """Energy of deformation [J]: the measure of what has moved.

        It is the kinetic energy of the motion relative to the rigid motion of each piece or, if
        that is more, the largest change of a term's energy since the start, of loads without the
        mean displacement. It neither depends on the observer nor grows with what loads bring in
        and dampings carry off.
        """
        return max([self.deforming, *(abs(change) for change in self._changes())])

    def _changes(self) -> list[float]:
        """Changes of the terms' energies since the start, loads in place [J]."""
        now = {**self.potential, **self.in_place}
        return [energy - self.opening[name] for name, energy in now.items()]

    @property
    def inflow(self) -> float:
        """Work of loads without an energy, and of pins, on the deformation since the start [J].

        The change of the rigid motion's energy, kinetic and in the loads with an energy, is
        subtracted, and what a load itself dissipates, such as the air.
        """
        rigid = self.kinetic - self.deforming
        rigid -= self.opening["kinetic"] - self.opening_deforming
        rigid += sum(self.potential[name] - energy for name, energy in self.in_place.items())
        return sum(self.work.values()) + self.pins - self.lost_outside - rigid

    @property
    def available(self) -> float:
        """Upper bound of the `deforming` energy that the cloth can have received [J].

        What it had at the start, the decrease of the terms' energies since, the `inflow` with 5 %
        of its parts for their own error, and `deforming` after the first step, in which forward
        Euler is ahead of the work. Unlimited with a term that reports neither an energy nor its
        work.
        """
        if self.silent:
            return math.inf
        gains = sum(max(0.0, -change) for change in self._changes()) + max(0.0, self.inflow)
        own = OWN_ERROR * (self.lost_outside + sum(map(abs, self.work.values())))
        return self.opening_deforming + (self.first_deforming or 0.0) + gains + own

    @property
    def lost_outside(self) -> float:
        """Dissipation by what also resists a rigid motion [J]."""
        return sum(self.dissipated[name] for name in self.resisting)

    @property
    def lost_inside(self) -> float:
        """Dissipation by damping that a rigid motion does not feel [J]."""
        return sum(self.dissipated.values()) - self.lost_outside

    def growth(self, most: float) -> str:
        """Return a sentence if `deforming` exceeds `most` times the `available` energy, or "".

        A load that sets in has given momentum before it has done work, so the inflow of the last
        step counts several times.
        """
        available = self.available + LAG * max(0.0, self.inflow - self.last_inflow)
        if math.isinf(most) or self.deforming <= most * available:
            return ""
        return (
            f"the cloth deforms with a kinetic energy of {self.deforming:.3g} J, where its start, "
            f"its loads and its pins can have given it {available:.3g} J at most: the method has "
            "made the rest"
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

    def amounts(self) -> list[float]:
        """All terms of the remainder's difference [J]."""
        then_and_now = *self.opening.values(), self.kinetic, *self.potential.values()
        flows = *self.dissipated.values(), *self.work.values(), self.pins, self.numerical
        return [*then_and_now, *flows]

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


def negligible_energy(system: System, seconds: float) -> float:
    """Return the kinetic energy [J] below which a cloth is at rest: ½ m (1e-6 L/T)².

    m is its mass, L its largest extent and T the time; round-off and tolerances stay below.
    """
    pace = CREEP * system.cloth.extent / seconds
    return 0.5 * float(system.nodal_mass.sum()) * pace**2


def _resisting(system: System, state: State, dissipated) -> tuple[str, ...]:
    """Return the names of the terms that dissipate at a velocity of 1 m/s along each axis."""
    v, named = np.ones_like(state.v), zip(system.names, system.bound, strict=True)
    return tuple(
        name
        for name, term in named
        if name in dissipated and (term.supplies or term.power(state.x, v, state.t) > NO_POWER)
    )


def _deforming_kinetic(system: System, state: State, kinetic: float, pin_v) -> float:
    """Return `Ledger.deforming`; `pin_v` (n, 3) are the velocities of the pins."""
    if not system.movable_pieces:
        return kinetic
    M, m = system.scalar_mass, system.nodal_mass
    if _is_one_free_body(system):
        return 0.5 * system.total_mass * rms_without_rigid(m, state.x, state.v) ** 2
    p, mass_x, w = M @ state.v, M @ state.x, state.v.copy()
    for piece in system.movable_pieces:
        w[piece.nodes] -= piece.rigid_velocity(state.x, p, m, mass_x, pin_v)
    system.constraints.project(w)
    return 0.5 * system.sums.dot(w, M @ w)


def _is_one_free_body(system: System) -> bool:
    """Return whether one compiled loop, for lumped masses, gives the kinetic energy."""
    pieces = system.movable_pieces
    is_whole = len(pieces) == 1 and isinstance(pieces[0].nodes, slice)
    return is_whole and not len(pieces[0].held) and system.mass_kind == "lumped"


def _places(system: System, state: State) -> list[np.ndarray]:
    return [piece.place(state.x, system.nodal_mass) for piece in system.movable_pieces]


def _energies_in_place(system: System, state: State, energies, start) -> dict[str, float]:
    """Return `Ledger.in_place` with the places at the start; no entries if no piece can move."""
    if not start:
        return {}
    x = state.x.copy()
    for piece, now, then in zip(system.movable_pieces, _places(system, state), start, strict=True):
        x[piece.nodes] -= now - then
    loads = zip(system.names, system.bound, strict=True)
    return {name: term.energy(x, state.t) for name, term in loads if name in energies and term.load}


def _dissipation(term, over, step, dt):
    """Energy [J] dissipated in a step: over it, or else the power at the method's stages."""
    if over.dissipates_over_step:
        return over.dissipation(step.state.x)
    return dt * _mean(term.power, step.stages)


def _work(term, old, step, explicit):
    """Work [J] of a load in a step: its mean force at the stages times `load_displacement`.

    The air's, whose force also dissipates, is its power at the stages.
    """
    if has_power_column(term):
        return (step.state.t - old.t) * _mean(term.supply, step.stages)
    f = np.zeros_like(old.x)
    for at in step.stages:
        term.add_force(at.x, at.v, at.t, f)
    return dot(f, load_displacement(old, step.state, explicit)) / len(step.stages)


def _mean(function, stages):
    return sum(function(at.x, at.v, at.t) for at in stages) / len(stages)


def _clamp_work(system, theta, old, step):
    """Work that moves the normals of clamps over a step; part of the work of the pins.

    Its forces act where those of `_pin_work` do, so that the two cancel in a translation.
    """
    at_stages = theta == 0.5 and not step.ends
    states = step.stages if at_stages else (old, step.state)
    old, new, *stages = ((at.x, at.t) for at in (old, step.state, *states))
    return sum(term.work_of_clamps(old, new, stages) for term in (step.over or system).bound)


def _pin_work(system, theta, old, step, inertia):
    """Work of the held directions over a step: Δv·M v_θ − f · Δx on the constrained nodes."""
    constraints = system.constraints
    at = constraints.nodes
    fixed = not any(pin.moves for pin, _ in constraints.groups.values())
    if not len(at) or (fixed and not constraints.held_part(old.v).any()):
        return 0.0  # otherwise pins stop an initial motion of fixed nodes
    v = old.v + theta * (step.state.v - old.v)
    held_v, held_x = constraints.held_part(v), constraints.held_part(step.state.x - old.x)
    f = step.mean_force(system)[at]
    return system.sums.dot(inertia[at], held_v) - system.sums.dot(f, held_x)
