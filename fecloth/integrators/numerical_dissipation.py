"""Numerical dissipation of a step, and the forces that it depends on."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from fecloth.integrators.step import Step
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.protocol import BoundTerm


def explicit_dissipation(system: System, old: State, step: Step, theta: float) -> float:
    """Numerical dissipation [J] of a step of an explicit method; negative for a gain.

        M Δv · (Δx/dt − v̄)° + (θ − ½) Δx·K Δx − mean of d·(Δx − dt v)

    v̄ is the mean of the old and the new velocity, ° means the free directions, and the mean is
    over the stages of the step. M Δv/dt is the mean force of the stages, whose elastic part is
    the elastic force at old + θ (new − old). d are the forces whose power at the (x, v) of the
    stages is, in the ledger, dissipation or work of the air. For the other loads without an
    energy v is v̄.

    It is exact for energies quadratic in x and linear damping. For others the remainder of the
    ledger shows the rest. It may be negative in single steps. Where pins are moved it contains
    the work of the damping along Δx − dt v.
    """
    energy = _between_velocities(system, old, step)
    if theta != 0.5:
        energy += (theta - 0.5) * stiffness_product(system, old, step)
    return energy - _unrecorded_work(system, old, step, explicit=True)


def memory_dissipation(system: System, old: State, step: Step) -> float:
    """Numerical dissipation [J] of a method that satisfies M a = f at one stage.

        M Δv · (Δx/dt − v̄)° + (M a − M Δv/dt + f̄ − f(stage)) · Δx° − mean of d·(Δx − dt v)

    f̄ is the mean of the old and the new force; d, v̄ and ° are as in `explicit_dissipation`. The
    work of linear forces over the step is f̄ · Δx. The residual M a − f(stage) of the solve
    remains in the remainder of the ledger. `work_beyond_dissipation` and `barrier_dissipation`
    are added.
    """
    dt = step.state.t - old.t
    dx = step.state.x - old.x
    dv = step.state.v - old.v
    # M a − M Δv/dt + f̄ − f(stage)
    unbalanced = system.mass_times(step.a - dv / dt) + step.mean_force(system)
    unbalanced = unbalanced - step.solved_force
    work = system.sums.dot(unbalanced, system.constraints.project(dx))
    energy = _between_velocities(system, old, step) + work
    energy += work_beyond_dissipation(system, old, step) + barrier_dissipation(system, old, step)
    return energy - _unrecorded_work(system, old, step, explicit=False)


def work_beyond_dissipation(system: System, old: State, step: Step) -> float:
    """The work −f̄ · Δx [J] against the damping over the step, beyond what it dissipates.

    f̄ is the part of the force that moved the cloth which comes from the terms that dissipate
    over the step, without their conservative force. Its work differs from the dissipated energy
    where the cloth turns, and its rates change, within one step.
    """
    over = step.over or system
    dissipating = [i for i, term in enumerate(over.bound) if term.dissipates_over_step]
    if not dissipating:
        return 0.0

    def with_dissipating(whole: System) -> System:
        return whole.with_bound(whole.bound[i] for i in dissipating).loose()

    before, after = map(with_dissipating, step.around(system))
    over = with_dissipating(over)
    ends = (before, old) if step.ends else None
    f = replace(step, over=over, ends=ends, new_force=None).mean_force(before)
    if any(term.has_energy for term in before.bound):  # as contact has, beside its friction
        # their conservative force, where `mean_force` has evaluated the whole force
        places = [(after, step.balanced_at)]
        if step.ends:
            places = [(before, old), (after, step.state)]
        f -= sum(conservative(part, at) for part, at in places) / len(places)
    dissipated: float = sum(term.dissipation(step.state.x) for term in over.bound)
    return -system.sums.dot(f, step.state.x - old.x) - dissipated


def barrier_dissipation(system: System, old: State, step: Step) -> float:
    """Numerical dissipation [J] of some energies, beyond the part of quadratic energies.

    −½ (f₀ + f₁) · Δx − ΔU, plus the work of moving obstacles and of moving normals of clamps. It
    counts for a barrier of contact, and for a term with a record and an energy, which may yield:
    both are far from quadratic over the displacement of a step. Without such terms it is 0.
    """
    new = step.state
    start = (old.x, old.t)
    end = (new.x, new.t)
    still = np.zeros_like(old.v)
    total = 0.0
    records = step.history or (None,) * len(system.bound)
    systems = step.over or system, *step.around(system)
    terms = zip(*(at_time.bound for at_time in systems), records, strict=True)
    for over, before, after, record in terms:
        is_contact = before.needs_end
        may_yield = record is not None and before.has_energy
        if not is_contact and not may_yield:
            continue
        f = np.zeros_like(old.x)  # f₀ + f₁, without damping as the velocities are 0
        for term, at in ((before, old), (after, new)):
            term.add_force(at.x, still, at.t, f)
            total += 0.5 * term.work_of_clamps(start, end, [(at.x, at.t)])
        total -= 0.5 * system.sums.dot(f, new.x - old.x)
        total -= after.energy(new.x, new.t) - before.energy(old.x, old.t)
        if over.works_over_step:  # a moving obstacle
            total += over.work(new.x)
    return total


def _between_velocities(system: System, old: State, step: Step) -> float:
    """M Δv · (Δx/dt − v̄) of the free directions [J]."""
    dt = step.state.t - old.t
    dx = step.state.x - old.x
    dv = step.state.v - old.v
    free = system.constraints.project(dx / dt - old.v - 0.5 * dv)
    return system.sums.dot(system.mass_times(dv), free)


def _unrecorded_work(system: System, old: State, step: Step, explicit: bool) -> float:
    """Return the work that the ledger's columns do not contain: mean of d·(Δx − dt v) [J].

    d and v are as in `explicit_dissipation`; `explicit` says whether the method is explicit.
    Other methods have the full work of the loads in their columns.
    """
    acting = step.over or system  # damping over the step has no column of power
    dt = step.state.t - old.t
    dx = step.state.x - old.x
    dot = system.sums.dot
    works = [0.0]
    if any(map(has_power_column, acting.bound)):
        works = [dot(column_forces(acting, at), dx - dt * at.v) for at in step.stages]
    if explicit and any(map(has_work_column, acting.bound)):
        lag = dx - load_displacement(old, step.state, explicit)  # Δx − dt v̄
        works += [dot(load_forces(acting, at), lag) for at in step.stages]
    return sum(works) / len(step.stages)


def load_displacement(old: State, new: State, explicit: bool) -> np.ndarray:
    """(n, 3) displacement [m] along which loads without an energy do their work in a step.

    It is Δx. In a step of an explicit method, M Δv = dt f, it is dt v̄ with the mean v̄ of both
    velocities: then the work is the kinetic energy that the load gives.
    """
    moved: np.ndarray = new.x - old.x
    if explicit:
        moved = 0.5 * (new.t - old.t) * (old.v + new.v)
    return moved


def stiffness_product(system: System, old: State, step: Step) -> float:
    """Δx·K Δx [J] as the change of the conservative force along Δx."""
    before, after = step.around(system)
    new = step.state
    change = conservative(before, old) - conservative(after, new)
    return system.sums.dot(change, new.x - old.x)


def has_power_column(term: BoundTerm) -> bool:
    """Return whether the ledger sums the power of the term's force at the stages of a step."""
    return bool(term.dissipative or (term.has_energy and term.supplies))


def has_work_column(term: BoundTerm) -> bool:
    """Return whether the ledger sums the work of a load's force along a displacement."""
    return bool(term.supplies) and not has_power_column(term)


def column_forces(system: System, state: State) -> np.ndarray:
    """Return the forces (n, 3) [N] whose power the ledger sums: d of `explicit_dissipation`.

    Of a term with an energy it is the force less its elastic force, which is its force at v = 0.
    """
    f = np.zeros_like(state.x)
    still = np.zeros_like(state.v)
    for term in filter(has_power_column, system.bound):
        term.add_force(state.x, state.v, state.t, f)
        if term.has_energy:
            elastic = np.zeros_like(f)
            term.add_force(state.x, still, state.t, elastic)
            f -= elastic
    return f


def load_forces(system: System, state: State) -> np.ndarray:
    """(n, 3) forces [N] of the loads whose work along a displacement the ledger has."""
    return _sum(filter(has_work_column, system.bound), state, state.v)


def conservative(system: System, state: State) -> np.ndarray:
    """(n, 3) force of the terms that have an energy, without the damping that they may have."""
    terms = (term for term in system.bound if term.has_energy)
    return _sum(terms, state, np.zeros_like(state.v))


def _sum(terms: Iterable[BoundTerm], at: State, v: np.ndarray) -> np.ndarray:
    """(n, 3) force [N] of the terms at the positions of a state and at velocities v."""
    f = np.zeros_like(at.x)
    for term in terms:
        term.add_force(at.x, v, at.t, f)
    return f
