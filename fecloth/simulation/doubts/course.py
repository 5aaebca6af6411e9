"""Warnings before the first step: where a run is likely to disappoint, and what to do."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fecloth.integrators.one_stage import BackwardEuler
from fecloth.scene.dimensionless import (
    distance_from_pins,
    gravity_magnitude,
    swing_loss,
)
from fecloth.scene.problem import Problem
from fecloth.simulation.set_up_warnings import find_set_up_warnings
from fecloth.simulation.short_pulses import find_short_pulses
from fecloth.stability.critical_step import element_bound
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms import MassDamping
from fecloth.terms.traits import has_kind, traits_of

POOR = 0.3  # quality of a triangle; 1 is equilateral, 0.87 half a square
STRAINED = 0.2  # strain of a hanging cloth; measured constants hold for a few per cent
UNRESOLVED = 20.0  # explicit limits; beyond, fast waves were seen to gain energy
LOST = 0.01  # part of the amplitude in a step that damping must take from waves
SHORT = 0.01  # of the explicit limit
DAMPED = 0.1  # part of the amplitude lost in one swing


def find_warnings(problem: Problem) -> list[str]:
    """Return a sentence for each likely problem of the run, with its remedy."""
    dt = None if _is_static(problem) else problem.dt
    set_up = find_set_up_warnings(problem.system, problem.state, dt, problem.t_end)
    ends = np.append(problem.stops, problem.t_end)
    pulses = find_short_pulses(problem.system, problem.state, problem.steps, ends)
    checks = (_mesh, _weight, _flat, _fast_waves, _short_steps, _damping)
    return [*set_up, *pulses, *(sentence for check in checks for sentence in check(problem))]


def _mesh(problem: Problem) -> Iterator[str]:
    quality = problem.cloth.quality
    worst = int(np.argmin(quality))
    if quality[worst] < POOR:
        X, Y = problem.cloth.X[problem.cloth.triangles[worst]].mean(axis=0)
        yield (
            f"triangle {worst} at ({X:.3g}, {Y:.3g}) m has the quality {quality[worst]:.2g} (1 is "
            f"equilateral), {int((quality < POOR).sum())} are below {POOR}: slivers are stiff in "
            "bending, and the worst one limits explicit steps; improve the mesh"
        )


def _weight(problem: Problem) -> Iterator[str]:
    """Warn if the strain ρ g L / Y at the upper end of a hanging strip is large."""
    system, pull, length = (
        problem.system,
        gravity_magnitude(problem.system),
        distance_from_pins(problem.system),
    )
    if not (pull and length and any(traits_of(term).as_fabric for term in system.terms)):
        return
    load = pull * length * system.total_mass / system.cloth.area
    strain = load / min(min(fabric.tensile) for fabric in system.panel.fabrics)
    if strain > STRAINED:
        yield (
            f"its own weight will stretch the cloth by about {100 * strain:.0f} % (ρ g L / Y, "
            f"L = {length:.2g} m from the pins): few fabrics are that soft; woven ones "
            "have Y = 200 to 10,000 N/m"
        )


def _flat(problem: Problem) -> Iterator[str]:
    """Warn of a cloth in a plane with forces in that plane only: it cannot buckle out of it."""
    system, state = problem.system, problem.state
    if not has_kind(system.terms, "bending"):
        return
    _, extents, axes = np.linalg.svd(state.x - state.x.mean(axis=0), full_matrices=False)
    if extents[2] > 1e-9 * extents[0]:
        return
    normal = axes[2]
    if all(np.abs(y @ normal).max() <= 1e-9 * np.abs(y).max() for y in _pushes(problem)):
        yield (
            "the cloth starts in a plane, and nothing pushes it out of the plane: it can neither "
            "bend nor buckle. Bend it a little, for example by [start] position = "
            '["X", "0.001 * sin(9 * X)", "Y"] for a hanging sheet'
        )


def _pushes(problem: Problem) -> Iterator[np.ndarray]:
    """Yield (n, 3) arrays that move the cloth: velocity, pin motions and forces at five times."""
    system, state = problem.system, problem.state
    yield state.v
    for t in state.t + (problem.t_end - state.t) * np.array([0.0, 0.13, 0.37, 0.71, 1.0]):
        x, v = system.constraints.target(state.t, t - state.t, state.x)
        yield from (x - state.x, v, system.force(State(t, state.x, state.v)))


def _fast_waves(problem: Problem) -> Iterator[str]:
    """Warn if steps far beyond the explicit limit may feed undamped fast waves."""
    method, system = problem.method, problem.system
    if not (method.traits.gains and problem.dt):
        return
    limit, loss = element_bound(system, "central_difference"), _loss(system, problem.dt)
    if problem.dt > UNRESOLVED * limit and loss < LOST:
        damping = (
            f"damping takes {100 * loss:.1g} % a step from them" if loss else "there is no damping"
        )
        yield (
            f"dt = {problem.dt:g} s is {problem.dt / limit:.0f} times the explicit limit, and "
            f"{damping}: {type(method).__name__} may gain energy from waves that it does "
            "not resolve; add StrainRateDamping with a time near dt, or use BDF2 or EnergyMomentum"
        )


def _loss(system: System, dt: float) -> float:
    """Return the part of the amplitude that damping takes in a step, of fast or of all waves.

    The midpoint rule multiplies a wave of ω dt ≫ 2 and damping d = 2 ζ ω by 1 − 4 d/(ω² dt), one
    that it resolves by 1 − d dt/2.
    """
    stiffness, damping = system.rate_bounds()
    return min(1.0, max(4 * damping / (stiffness * dt), damping * dt / 2)) if stiffness else 0.0


def _is_static(problem: Problem) -> bool:
    """Return whether a few steps of backward Euler, minutes long, seek a state of rest."""
    if problem.is_static:
        return True
    steps = (problem.t_end - problem.state.t) / problem.dt if problem.dt else math.inf
    return isinstance(problem.method, BackwardEuler) and steps <= 10 and (problem.dt or 0) >= 100


def _short_steps(problem: Problem) -> Iterator[str]:
    """Warn of an implicit method with steps so short that an explicit one needs longer ones."""
    method, dt = problem.method, problem.dt
    if not dt or method.traits.explicit or problem.is_static:
        return
    limit = element_bound(problem.system, "central_difference")
    if dt < SHORT * limit < math.inf:
        yield (
            f"dt = {dt:g} s is {limit / dt:.0f} times shorter than even an explicit method needs "
            f"({limit:.2g} s). If you meant ms, write {1000 * dt:g}; without dt the error "
            "determines it"
        )


def _damping(problem: Problem) -> Iterator[str]:
    """Warn if a first-order method will visibly damp the slowest swing."""
    pull, length = gravity_magnitude(problem.system), distance_from_pins(problem.system)
    traits = problem.method.traits
    damped = traits.order == 1 and traits.at_infinity < 1
    if not (damped and problem.dt and pull and length):
        return
    rate = math.sqrt(pull / length)
    lost = swing_loss(rate * problem.dt)
    rates = [term.rate for term in problem.system.terms if isinstance(term, MassDamping)]
    meant = -math.expm1(-sum(rates) * math.pi / rate)  # what the terms take in a period
    if lost > max(DAMPED, meant) and not _is_static(problem):
        yield (
            f"numerical damping of {type(problem.method).__name__} removes about "
            f"{100 * lost:.0f} % of the amplitude of a swing over {length:.2g} m per period. Fine "
            "if the cloth should settle; otherwise use BDF2 or another method of second order"
        )
