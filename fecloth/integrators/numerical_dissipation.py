"""The forces of a step, and what the method itself took of the energy in it."""

from __future__ import annotations

import numpy as np

from fecloth.integrators.step import Step
from fecloth.system.state import State
from fecloth.system.system import System


def taken(system: System, old: State, step: Step, theta: float) -> float:
    """Energy [J] that an explicit method itself took in a step; negative where it gave some.

    With v̄ the mean of the old and new velocity, ° the free directions, and the mean over the
    stages of the step,

        M Δv · (Δx/dt − v̄)° + (θ − ½) Δx·K Δx − mean of d·(Δx − dt v)

    where M Δv/dt is the mean force of the stages, of which the elastic part is that at
    old + θ (new − old), and d are the forces whose power at the stages' (x, v) the ledger takes
    as dissipated or as work. Exact for energies quadratic in x and linear damping; on others the
    ledger's remainder shows the rest. It need not grow in every step. Where pins are moved it
    holds what the damping does between dt v and Δx.
    """
    energy = _between_velocities(system, old, step)
    if theta != 0.5:
        energy += (theta - 0.5) * bend(system, old, step.state)
    return energy - _columns_miss(system, old, step)


def taken_beyond(system: System, old: State, step: Step) -> float:
    """Energy [J] that a method itself took which solved M a = f(stage), not for the mean force.

    With f̄ the mean of the old and new force, and d, v̄ and ° as in `taken`,

        M Δv · (Δx/dt − v̄)° + (M a − M Δv/dt + f̄ − f(stage)) · Δx° − mean of d·(Δx − dt v)

    The forces' work over the step is f̄ · Δx where they are linear, and all of M a − f(stage) that
    is left unsolved stays in the ledger's remainder.
    """
    dt, dx, dv = step.state.t - old.t, step.state.x - old.x, step.state.v - old.v
    beyond = system.scalar_mass @ (step.a - dv / dt) + step.mean_force(system) - step.solved_force
    unbalanced = system.sums.dot(beyond, system.constraints.project(dx))
    energy = _between_velocities(system, old, step) + unbalanced
    return energy - _columns_miss(system, old, step)


def _between_velocities(system, old, step):
    """M Δv · (Δx/dt − v̄) of the free directions."""
    dt, dx, dv = step.state.t - old.t, step.state.x - old.x, step.state.v - old.v
    free = system.constraints.project(dx / dt - old.v - 0.5 * dv)
    return system.sums.dot(system.scalar_mass @ dv, free)


def _columns_miss(system, old, step):
    """What the ledger's columns miss of the work of their forces: mean of d·(Δx − dt v)."""
    dt, dx, stages = step.state.t - old.t, step.state.x - old.x, step.stages
    works = (system.sums.dot(column_forces(system, at), dx - dt * at.v) for at in stages)
    return sum(works) / len(stages)


def bend(system: System, old: State, new: State) -> float:
    """Δx·K Δx [J] as the change of the conservative force along Δx."""
    return system.sums.dot(conservative(system, old) - conservative(system, new), new.x - old.x)


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
