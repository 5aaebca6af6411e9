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

    With v̄ the mean of the old and new velocity, ° the free directions, and the mean over the
    stages of the step,

        M Δv · (Δx/dt − v̄)° + (θ − ½) Δx·K Δx − mean of d·(Δx − dt v)

    where M Δv/dt is the mean force of the stages, whose elastic part is the elastic force at
    old + θ (new − old), and d are the forces whose power at the stages' (x, v) the ledger
    takes as dissipated, or as work of the air; for the other loads without an energy v is v̄.
    Exact for energies quadratic in x and linear damping; on others the ledger's remainder
    shows the rest. It need not grow in every step. Where pins are moved it holds what the
    damping does between dt v and Δx.
    """
    energy = _between_velocities(system, old, step)
    if theta != 0.5:
        energy += (theta - 0.5) * stiffness_product(system, old, step)
    return energy - _unrecorded_work(system, old, step, explicit=True)


def memory_dissipation(system: System, old: State, step: Step) -> float:
    """Numerical dissipation [J] of a method that satisfies M a = f at one stage.

    With f̄ the mean of the old and new force, and d, v̄ and ° as in `explicit_dissipation`,

        M Δv · (Δx/dt − v̄)° + (M a − M Δv/dt + f̄ − f(stage)) · Δx° − mean of d·(Δx − dt v)

    The work of linear forces over the step is f̄ · Δx. The residual M a − f(stage) of the solve
    stays in the ledger's remainder. Added is `work_beyond_dissipation`.
    """
    dt = step.state.t - old.t
    dx = step.state.x - old.x
    dv = step.state.v - old.v
    beyond = system.mass_times(step.a - dv / dt) + step.mean_force(system) - step.solved_force
    unbalanced = system.sums.dot(beyond, system.constraints.project(dx))
    energy = _between_velocities(system, old, step) + unbalanced
    energy += work_beyond_dissipation(system, old, step) + barrier_dissipation(system, old, step)
    return energy - _unrecorded_work(system, old, step, explicit=False)


def work_beyond_dissipation(system: System, old: State, step: Step) -> float:
    """Work −f̄ · Δx [J] against the terms that dissipate over the step, less what they dissipate.

    f̄ is their part of the force that moved the cloth. The work differs from the dissipated
    energy as far as the cloth turns, and its rates change, in one step.
    """
    acting = (step.over or system).bound
    which = [i for i, over in enumerate(acting) if over.dissipates_over_step]
    if not which:
        return 0.0
    before, after, over = (
        each.with_bound(each.bound[i] for i in which)
        for each in (*step.around(system), step.over or system)
    )
    ends = (before, old) if step.ends else None
    f = replace(step, over=over, ends=ends).mean_force(before)
    if any(term.has_energy for term in before.bound):  # as contact has, beside its friction
        places = [(after, step.balanced_at)]
        if step.ends:
            places = [(before, old), (after, step.state)]
        f -= sum(conservative(only, at) for only, at in places) / len(places)
    dissipated: float = sum(term.dissipation(step.state.x) for term in over.bound)
    return -system.sums.dot(f, step.state.x - old.x) - dissipated


def barrier_dissipation(system: System, old: State, step: Step) -> float:
    """Numerical dissipation [J] of some energies, beyond the part of quadratic energies.

    −½ (f₀ + f₁) · Δx − ΔU, plus the work of obstacles and of normals of clamps that move: a
    barrier of contact, and a term whose history yields, are far from quadratic over the way of a
    step. Without these it is 0.
    """
    new = step.state
    total = 0.0
    records = step.history or (None,) * len(system.bound)
    systems = step.over or system, *step.around(system)
    terms = zip(*(each.bound for each in systems), records, strict=True)
    for over, before, after, record in terms:
        if before.needs_end or (record is not None and before.has_energy):
            f = np.zeros_like(old.x)
            still = np.zeros_like(old.v)
            for one, at in ((before, old), (after, new)):
                one.add_force(at.x, still, at.t, f)
                ends = (old.x, old.t), (new.x, new.t)
                total += 0.5 * one.work_of_clamps(*ends, [(at.x, at.t)])
            total -= 0.5 * system.sums.dot(f, new.x - old.x)
            total -= after.energy(new.x, new.t) - before.energy(old.x, old.t)
            if over.works_over_step:
                total += over.work(new.x)
    return total


def _between_velocities(system: System, old: State, step: Step) -> float:
    """M Δv · (Δx/dt − v̄) of the free directions."""
    dt = step.state.t - old.t
    dx = step.state.x - old.x
    dv = step.state.v - old.v
    free = system.constraints.project(dx / dt - old.v - 0.5 * dv)
    return system.sums.dot(system.mass_times(dv), free)


def _unrecorded_work(system: System, old: State, step: Step, explicit: bool) -> float:
    """Work that the ledger's columns do not contain: mean of d·(Δx − dt v)."""
    acting = step.over or system  # what dissipates over the step is not booked by its power
    dt = step.state.t - old.t
    dx = step.state.x - old.x
    works = [0.0]
    if any(map(has_power_column, acting.bound)):
        works = [system.sums.dot(column_forces(acting, at), dx - dt * at.v) for at in step.stages]
    if explicit and any(map(has_work_column, acting.bound)):
        lag = dx - load_displacement(old, step.state, explicit)
        works += [system.sums.dot(load_forces(acting, at), lag) for at in step.stages]
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
    (before, after), new = step.around(system), step.state
    return system.sums.dot(conservative(before, old) - conservative(after, new), new.x - old.x)


def has_power_column(term: BoundTerm) -> bool:
    """Return whether the ledger sums the power of the term's force at the stages of a step."""
    return bool(term.dissipative or (term.has_energy and term.supplies))


def has_work_column(term: BoundTerm) -> bool:
    """Return whether the ledger sums the work of a load's force along a displacement."""
    return bool(term.supplies) and not has_power_column(term)


def column_forces(system: System, state: State) -> np.ndarray:
    """(n, 3) forces [N] whose power the ledger sums."""
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
    f = np.zeros_like(at.x)
    for term in terms:
        term.add_force(at.x, v, at.t, f)
    return f
