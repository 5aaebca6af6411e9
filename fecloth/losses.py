"""The forces of a step, and what the method itself took of the energy in it."""

from __future__ import annotations

import numpy as np

from .step import Step
from .sums import dot
from .system import State, System


def taken(system: System, old: State, step: Step, theta: float, a: np.ndarray | None = None):
    """Energy [J] that a method itself took in a step; negative where it gave some.

    With v̄ the mean of the old and new velocity, over the free directions where marked °, and the
    mean over the stages of the step,

        M Δv · (Δx/dt − v̄)° − M (Δv/dt − a) · Δx° + (θ − ½) Δx·K Δx − mean of d·(Δx − dt v)

    where M a = f(stage), a = Δv/dt if it is left out, the stage lies at old + θ (new − old), and d
    are the forces whose power at the stage's (x, v) the ledger takes as dissipated or as work.
    Exact for energies quadratic in x and linear damping; on others the ledger's remainder shows
    the rest. It need not grow in every step. Where pins are moved it holds what the damping does
    between dt v and Δx.
    """
    dt, dx, dv = step.state.t - old.t, step.state.x - old.x, step.state.v - old.v
    mass, free = system.scalar_mass, system.constraints.project
    energy = dot(mass @ dv, free(dx / dt - old.v - 0.5 * dv))
    if a is not None:
        energy -= dot(mass @ (dv / dt - a), free(dx.copy()))
    if theta != 0.5:
        energy += (theta - 0.5) * bend(system, old, step.state)
    stages = stages_of(step)
    for at in stages:
        energy -= dot(column_forces(system, at), dx - dt * at.v) / len(stages)
    return energy


def bend(system: System, old: State, new: State) -> float:
    """Δx·K Δx [J] as the change of the conservative force along Δx."""
    return dot(conservative(system, old) - conservative(system, new), new.x - old.x)


def stages_of(step) -> tuple[State, ...]:
    """Where the forces of a step were taken, equal in weight."""
    return getattr(step, "stages", (step.stage,))


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
