"""The energy ledger of a run: energies, dissipation and work."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.integrators.fused_steps import Flows
from fecloth.integrators.numerical_dissipation import has_power_column, load_displacement
from fecloth.linalg.reductions import dot
from fecloth.simulation.account import Account, Accounts, Run
from fecloth.simulation.closing_work import closing_work
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

NO_POWER = 1e-12  # W; round-off of an inner damping at 1 m/s


@remembered
@dataclass(frozen=True)
class Ledger(Account):
    """Energies, dissipation and work since the start, all in J, at time t.

    kinetic + Σ potential + Σ dissipated + impacts + numerical − Σ work − pins − start = remainder

    Attributes
    ----------
    t
        Time of the last step [s].
    kinetic
        ½ v·M v, now.
    potential
        Each term's energy, now.
    dissipated
        Work done against each damping since the start, Σ dt · power at the method's
        stage, of methods with a memory at the mean of both ends of the step; Σ dt Ė:S_v
        with Ė = (E₁ − E₀)/dt for strain-rate damping over the step.
    work
        Work of each load that has no energy: its mean force there times the displacement
        (`load_displacement`); of loads that also dissipate, Σ dt · supply there.
    pins
        Work that the pins did on the cloth: change of the pinned nodes' kinetic energy
        less the work of the other forces on them.
    numerical
        Numerical dissipation by the method's own formula, `numerical`: zero for the
        midpoint rule; exact for energies quadratic in x.
    impacts
        With contact, the kinetic energy that the impulses of impacts have taken at the ends
        of steps. Where steps do not resolve an impact, its force has taken too much within
        the step, as numerical dissipation, and the impulses give a part of it back.
    opening
        The energies at the start, with "kinetic".
    resisting
        Terms that dissipate also in a rigid motion, such as drag.
    silent
        Whether a term reports neither an energy nor its dissipation or work.
    """

    name = "ledger"
    table = "energies"
    t: float
    kinetic: float
    potential: Mapping[str, float]
    dissipated: Mapping[str, float]
    work: Mapping[str, float]
    pins: float
    numerical: float
    opening: Mapping[str, float]
    resisting: tuple[str, ...] = ()
    silent: bool = False
    impacts: float | None = None

    @classmethod
    def open(cls, system: System, state: State) -> "Ledger":
        """Return the ledger before the first step."""
        opening = system.energies(state)
        energies = dict(opening)
        kinetic = energies.pop("kinetic")
        dissipated = {name: 0.0 for name, term in system.named if term.dissipative}
        work = {name: 0.0 for name, term in system.named if term.supplies}
        if system.constraints.followers.closes:
            work["seams"] = 0.0
        reported = {*energies, *dissipated, *work}
        silent = any(name not in reported for name in system.names)
        resisting = _resisting(system, state, dissipated)
        return cls(
            t=state.t,
            kinetic=kinetic,
            potential=energies,
            dissipated=dissipated,
            work=work,
            pins=0.0,
            numerical=0.0,
            opening=opening,
            resisting=resisting,
            silent=silent,
            impacts=0.0 if any(term.needs_end for term in system.bound) else None,
        )

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Ledger":
        """Return the ledger after a step and the steps without a row before it."""
        after = self.after
        if info.skipped is None:
            return after(run.system, run.method, info.old, info.result)
        flows = info.skipped.flows
        if info.skipped.step:  # the flows of the step are among them
            return after(run.system, run.method, info.old, info.result, flows)
        return after(run.system, run.method, info.old, info.result).with_flows(flows)

    def after(
        self, system: System, method, old: State, step, flows: Flows | None = None
    ) -> "Ledger":
        """Return the ledger after a `step` by `method` from the state `old`.

        `flows` are those of the step and of steps without a row before it, where they are known.
        """
        energies = system.with_history(step.history).energies(step.state)
        kinetic = energies.pop("kinetic")
        flows = flows or self._flows(system, method, old, step.before_impacts, step.state)
        after = self.with_flows(flows)
        return after.changed(t=step.state.t, kinetic=kinetic, potential=energies)

    def release(self, run: Run, info: StepInfo, others: Accounts) -> "Ledger":
        """Return the ledger where pins let go.

        What a clamp that lets go takes with it counts as work of the pins: the energy of the
        bending along its edge.
        """
        step = info.result
        energies = run.system.with_history(step.history).energies(step.state)
        change = sum(energies.values()) - self.total
        kinetic = energies.pop("kinetic")
        return self.changed(kinetic=kinetic, potential=energies, pins=self.pins + change)

    def _flows(self, system: System, method, old: State, step, new: State) -> Flows:
        """Return what a step dissipates, what loads and pins do in it, and what impacts take.

        `step` is the step before impacts, and `new` is the state after them.
        """
        dt = step.state.t - old.t
        acting = (step.over or system).bound
        dissipated = dict[str, float]()
        work = dict[str, float]()
        for name, term, acting_term in zip(system.names, system.bound, acting, strict=True):
            if term.dissipative:
                dissipated[name] = _dissipation(term, acting_term, step, dt)
            if name in self.work:
                work[name] = _work(term, acting_term, old, step, method.traits.explicit)
        if "seams" in self.work:
            work["seams"] = closing_work(system, old, step)
        pins = _pin_work(system, method.traits.theta, old, step)
        pins += _clamp_work(system, method.traits.theta, old, step)
        jump = new.v - step.state.v
        impacts = -system.sums.dot(jump, system.mass_times(step.state.v + 0.5 * jump))
        for name, more in zip(system.names, step.works, strict=False):
            if name in work:
                work[name] += more
                impacts += more
        return Flows(dissipated, work, pins, method.numerical(system, old, step), impacts)

    def with_flows(self, flows: Flows) -> "Ledger":
        """Return the ledger with the flows of steps without rows."""
        return self.changed(
            dissipated={
                name: lost + flows.dissipated.get(name, 0.0)
                for name, lost in self.dissipated.items()
            },
            work={name: done + flows.work.get(name, 0.0) for name, done in self.work.items()},
            pins=self.pins + flows.pins,
            numerical=self.numerical + flows.numerical,
            impacts=None if self.impacts is None else self.impacts + flows.impacts,
        )

    @property
    def start(self) -> float:
        """kinetic + Σ potential at the start [J]."""
        return sum(self.opening.values())

    @property
    def lost(self) -> float:
        """What damping, the method and impacts have taken since the start [J]."""
        return sum(self.dissipated.values()) + self.numerical + (self.impacts or 0.0)

    @property
    def lost_outside(self) -> float:
        """Dissipation by what also resists a rigid motion [J]."""
        return sum(self.dissipated[name] for name in self.resisting)

    @property
    def lost_inside(self) -> float:
        """Dissipation by damping that a rigid motion does not feel [J]."""
        return sum(self.dissipated.values()) - self.lost_outside

    @property
    def supplied(self) -> float:
        """What the start, the loads and the pins have given the cloth [J].

        The kinetic energy of the start, what the terms' energies are below the start, and the
        size of the work of each load and of the pins.
        """
        released = sum(
            max(0.0, self.opening[name] - energy) for name, energy in self.potential.items()
        )
        work = abs(self.pins) + sum(map(abs, self.work.values()))
        return self.opening["kinetic"] + released + work

    @property
    def total(self) -> float:
        """kinetic + Σ potential [J]."""
        return self.kinetic + sum(self.potential.values())

    @property
    def remainder(self) -> float:
        """Energy that the other columns do not explain [J]."""
        return self.total + self.lost - sum(self.work.values()) - self.pins - self.start

    def amounts(self) -> list[float]:
        """Return all terms of the remainder's difference [J]."""
        then_and_now = *self.opening.values(), self.kinetic, *self.potential.values()
        flows = *self.dissipated.values(), *self.work.values(), self.pins, self.numerical
        return [*then_and_now, *flows, self.impacts or 0.0]

    def row(self) -> dict[str, float]:
        """Return a row of energies.csv."""
        return {
            "t": self.t,
            "kinetic": self.kinetic,
            **self.potential,
            **{f"dissipated:{name}": value for name, value in self.dissipated.items()},
            **{f"work:{name}": value for name, value in self.work.items()},
            "pins": self.pins,
            "numerical": self.numerical,
            **({} if self.impacts is None else {"impacts": self.impacts}),
            "total": self.total,
            "remainder": self.remainder,
        }

    def summary(self) -> dict[str, object]:
        return {"ledger": self.row()}


def _resisting(system: System, state: State, dissipated) -> tuple[str, ...]:
    """Return the names of the terms that dissipate at a velocity of 1 m/s along each axis."""
    v = np.ones_like(state.v)
    return tuple(
        name
        for name, term in system.named
        if name in dissipated and (term.supplies or term.power(state.x, v, state.t) > NO_POWER)
    )


def _dissipation(term, acting, step, dt):
    """Return the energy [J] that a term dissipates in a step of dt [s].

    The term `acting` over the step may know it; else it is the power at the method's stages.
    """
    if acting.dissipates_over_step:
        return acting.dissipation(step.state.x)
    return dt * _mean(term.power, step.stages)


def _work(term, acting, old, step, explicit):
    """Return the work [J] of a load in a step: its mean force times `load_displacement`.

    The force is the mean of the stages. A contact, `acting` over the step, knows its own work.
    The work of the air, whose force also dissipates, is its power at the stages. A tether has a
    quadratic energy U(x, t): its work is the change of U from t to t + dt, as a mean over both
    ends of the step.
    """
    new = step.state
    if acting.works_over_step:
        return acting.work(new.x)
    if has_power_column(term):
        work = (new.t - old.t) * _mean(term.supply, step.stages)
        if term.conserves:  # a mean of the rate of U would not see a jump
            changes = (term.energy(at.x, new.t) - term.energy(at.x, old.t) for at in (old, new))
            work += sum(changes) / 2
        return work
    force = np.zeros_like(old.x)
    for stage in step.stages:
        term.add_force(stage.x, stage.v, stage.t, force)
    return dot(force, load_displacement(old, step.state, explicit)) / len(step.stages)


def _mean(function, stages):
    """Return the mean of a function of x, v and t over the stages of a step."""
    return sum(function(stage.x, stage.v, stage.t) for stage in stages) / len(stages)


def _clamp_work(system, theta, old, step):
    """Return the work that moves the normals of clamps over a step, a part of that of the pins.

    Its forces act where the forces of `_pin_work` do, so that both cancel in a translation.
    """
    states = (old, step.state)
    if theta == 0.5 and not step.ends:
        states = step.stages
    begin = (old.x, old.t)
    end = (step.state.x, step.state.t)
    stages = [(state.x, state.t) for state in states]
    return sum(term.work_of_clamps(begin, end, stages) for term in (step.over or system).bound)


def _pin_work(system, theta, old, step):
    """Return the work [J] of the held directions over a step.

    It is Δv·M v_θ − f · Δx on the constrained nodes. Pins that do not move have one in the first
    step, where they stop an initial motion of their nodes.
    """
    constraints = system.constraints
    nodes = constraints.nodes
    are_fixed = not any(pin.moves for pin, _ in constraints.groups.values())
    if not len(nodes) or (are_fixed and not constraints.held_part(old.v).any()):
        return 0.0
    dv = step.state.v - old.v
    force = step.force_on_pins(system)[nodes]
    held_v = constraints.held_part(old.v + theta * dv)
    held_x = constraints.held_part(step.state.x - old.x)
    inertia = system.mass_times(dv)[nodes]
    return system.sums.dot(inertia, held_v) - system.sums.dot(force, held_x)
