"""Warnings before the first step: where a run is likely to disappoint, and what to do."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fecloth.integrators.newmark import GeneralizedAlpha, Newmark
from fecloth.integrators.one_stage import BackwardEuler, ImplicitMidpoint, LinearlyImplicitEuler
from fecloth.scene.dimensionless import BENDING, gravity, hanging, swing_loss, term_types
from fecloth.scene.plausibility import odd
from fecloth.scene.problem import Problem
from fecloth.stability.critical_step import element_bound
from fecloth.system.system import State

POOR = 0.3  # quality of a triangle; 1 is equilateral, 0.87 half a square
STRAINED = 0.2  # of a cloth that hangs: measured constants hold for a few per cent
RESOLVED = 4.0  # edges that a wrinkle needs at the least
UNRESOLVED = 20.0  # explicit limits: beyond, fast waves were seen to feed on the nonlinearity
DAMPED = 0.1  # of a swing's amplitude, taken in one swing
ELASTIC = ("StVK", "NeoHookean", "TensionField")  # that are as stiff as the fabric says
GAINING = (ImplicitMidpoint, LinearlyImplicitEuler, Newmark, GeneralizedAlpha)
FIRST_ORDER = (BackwardEuler, LinearlyImplicitEuler)


def doubts(problem: Problem) -> list[str]:
    """A sentence for each thing that is likely to disappoint, with what to do."""
    units = odd(problem.system.fabric, problem.cloth, problem.dt)
    asked = (_mesh, _weight, _wrinkles, _flat, _fast_waves, _damping)
    return [*units, *(sentence for doubt in asked for sentence in doubt(problem))]


def _mesh(problem: Problem) -> Iterator[str]:
    quality = problem.cloth.quality
    worst = int(np.argmin(quality))
    if quality[worst] < POOR:
        X, Y = problem.cloth.X[problem.cloth.triangles[worst]].mean(axis=0)
        yield (
            f"triangle {worst} at ({X:.3g}, {Y:.3g}) m has the quality {quality[worst]:.2g} (1 is "
            f"equilateral), {int((quality < POOR).sum())} are below {POOR}: slivers are stiff in "
            "bending, and explicit steps are as short as the worst one asks; mesh it anew"
        )


def _weight(problem: Problem) -> Iterator[str]:
    """ρ g L / Y, the strain at the upper end of a strip that hangs."""
    system, pull, length = problem.system, gravity(problem.system), hanging(problem.system)
    if not (pull and length and set(ELASTIC) & set(term_types(system))):
        return
    load = pull * length * system.nodal_mass.sum() / system.cloth.area
    strain = load / min(min(fabric.tensile) for fabric in system.panel.fabrics)
    if strain > STRAINED:
        yield (
            f"its own weight will stretch the cloth by about {100 * strain:.0f} % (ρ g L / Y, "
            f"L = {length:.2g} m from the pins): hardly a fabric is that soft; measured woven "
            "ones have Y = 200 to 10,000 N/m"
        )


def _wrinkles(problem: Problem) -> Iterator[str]:
    """λ = 2√π (B/T)^¼ √L under T = ρ g L.

    Cerda and Mahadevan (2003), Geometry and Physics of Wrinkling, Phys. Rev. Lett. 90, 074302.
    """
    system, length = problem.system, hanging(problem.system)
    load = gravity(system) * length * system.nodal_mass.sum() / system.cloth.area
    if not load:
        return
    edge = math.sqrt(4 / math.sqrt(3) * system.cloth.area / len(system.cloth.triangles))
    if not set(BENDING) & set(term_types(system)):
        if "TensionField" not in term_types(system):
            yield (
                "without bending stiffness the cloth folds as finely as the mesh wherever it is "
                "compressed; what is taut is right. Add HingeBending, or take TensionField"
            )
        return
    rigidity = max(max(fabric.bending) for fabric in system.panel.fabrics if fabric.bending)
    wave = 2 * math.sqrt(math.pi) * (rigidity / load) ** 0.25 * math.sqrt(length)
    if wave < RESOLVED * edge:
        yield (
            f"wrinkles under its own weight are about {wave:.2g} m long, and the edges {edge:.2g} "
            f"m: the mesh will shape them; h <= {wave / RESOLVED:.2g} m shows them"
        )


def _flat(problem: Problem) -> Iterator[str]:
    """What is in a plane, and pushed along it only, stays there: it cannot even buckle."""
    system, state = problem.system, problem.state
    if not set(BENDING) & set(term_types(system)):
        return
    _, extents, axes = np.linalg.svd(state.x - state.x.mean(axis=0), full_matrices=False)
    if extents[2] > 1e-9 * extents[0]:
        return
    normal = axes[2]
    if all(np.abs(y @ normal).max() <= 1e-9 * np.abs(y).max() for y in _pushes(problem)):
        yield (
            "the cloth starts in a plane, and nothing pushes it out: it will not bend, nor buckle "
            "where it is compressed. Bend it a little, as [start] position = "
            '["X", "0.001 * sin(9 * X)", "Y"] does a sheet that hangs'
        )


def _pushes(problem: Problem) -> Iterator[np.ndarray]:
    """(n, 3) what moves the cloth as it lies: its velocity, its pins and forces at five times."""
    system, state = problem.system, problem.state
    yield state.v
    for t in state.t + (problem.t_end - state.t) * np.array([0.0, 0.13, 0.37, 0.71, 1.0]):
        x, v = system.constraints.target(state.t, t - state.t, state.x)
        yield from (x - state.x, v, system.force(State(t, state.x, state.v)))


def _fast_waves(problem: Problem) -> Iterator[str]:
    method, system = problem.method, problem.system
    gains = isinstance(method, GAINING) and getattr(method, "rho_inf", 1.0) > 0
    damped = any(term.dissipative for term in system.bound)
    if not (gains and problem.dt) or damped:
        return
    limit = element_bound(system, "central_difference")
    if problem.dt > UNRESOLVED * limit:
        yield (
            f"dt = {problem.dt:g} s is {problem.dt / limit:.0f} times the explicit limit and "
            f"nothing damps: {type(method).__name__} may gain energy from waves that it does not "
            "resolve; add StrainRateDamping, or take BDF2 or EnergyMomentum"
        )


def _damping(problem: Problem) -> Iterator[str]:
    """Of the methods of first order, on the slowest motion that there is."""
    pull, length = gravity(problem.system), hanging(problem.system)
    if not (isinstance(problem.method, FIRST_ORDER) and problem.dt and pull and length):
        return
    lost = swing_loss(math.sqrt(pull / length) * problem.dt)
    if lost > DAMPED:
        yield (
            f"{type(problem.method).__name__} takes about {100 * lost:.0f} % of the amplitude of "
            f"a swing over {length:.2g} m in each, by itself: well for who wants it to come to "
            "rest; BDF2 or another method of second order does not"
        )
