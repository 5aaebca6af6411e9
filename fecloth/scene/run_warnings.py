"""What a run is about to do, and where it is likely to disappoint, before its first step."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from fecloth.fabric.fabric import Fabric
from fecloth.integrators.newmark import GeneralizedAlpha, Newmark
from fecloth.integrators.one_stage import BackwardEuler, ImplicitMidpoint, LinearlyImplicitEuler
from fecloth.linalg import select
from fecloth.linalg.mkl_pardiso import threads
from fecloth.scene.plausibility import odd
from fecloth.scene.problem import Built
from fecloth.stability.critical_step import element_bound
from fecloth.system.system import State, System

POOR = 0.3  # quality of a triangle; 1 is equilateral, 0.87 half a square
STRAINED = 0.2  # of a cloth that hangs: measured constants hold for a few per cent
RESOLVED = 4.0  # edges that a wrinkle needs at the least
UNRESOLVED = 20.0  # explicit limits: beyond, fast waves were seen to feed on the nonlinearity
DAMPED = 0.1  # of a swing's amplitude, taken in one swing
ELASTIC = ("StVK", "NeoHookean", "TensionField")  # that are as stiff as the fabric says
BENDING = ("HingeBending", "QuadraticBending")
GAINING = (ImplicitMidpoint, LinearlyImplicitEuler, Newmark, GeneralizedAlpha)
FIRST_ORDER = (BackwardEuler, LinearlyImplicitEuler)


def plan(built: Built, why: str) -> list[str]:
    """Sizes, terms, method, solver and why, threads, memory, weight, what explicit steps need."""
    system = built.system
    name = f"{'quadratic ' * (system.cloth.element == 'P2')}triangles"
    lines = [
        f"{len(system.cloth.X)} nodes, {len(system.cloth.triangles)} {name}, "
        f"{system.admissible.shape[1]} free dofs",
        f"terms: {', '.join(system.names) or 'none'}",
        f"{built.method}, {_steps(built)} to t = {built.t_end:g} s",
        f"linear solver: {why}",
        _needs(built),
        *_heavy(system),
    ]
    if built.note:
        lines.append(built.note)
    limit = element_bound(system, "central_difference")
    if np.isfinite(limit):
        fastest = f"fastest wave in the fabric {max(map(wave_speed, _fabrics(system))):.3g} m/s"
        needs = f"an explicit method would need dt <= {limit:.3g} s (bound at rest)"
        if system.mass_kind != "lumped":
            needs = "a consistent mass allows no explicit method"
        lines.append(f"{fastest}; {needs}")
    return lines


def _steps(built: Built) -> str:
    """dt, or how the steps are chosen."""
    if built.dt:
        return f"dt = {built.dt:g} s"
    by = f"rtol = {built.method.rtol:g}" if hasattr(built.method, "rtol") else "stability"
    return f'steps chosen by {by}, as dt is left out or "auto",'


def _needs(built: Built) -> str:
    if _explicit(built):
        return f"one thread, about {memory(built.system, 'explicit'):.0f} MB"
    iterated = memory(built.system, "pcg")
    if built.linear == "pcg":
        return f"one thread, about {iterated:.0f} MB"
    select.direct(built.system.symmetric)  # loads the MKL, if there is one
    factor = f"{threads() or 1} for factorisations, else one"
    return f"threads: {factor}; about {iterated:.0f} MB, with a factor {memory(built.system):.0f}"


def _heavy(system: System) -> Iterator[str]:
    """The number by which README tells whether bending matters."""
    number, length = heaviness(system), reach(system)
    if number:
        yield (
            f"weight over bending stiffness: ρ g L³/B = {number:.3g} with L = {length:.3g} m, "
            + (
                "twice the reach from the pins around"
                if surrounded(system)
                else "the reach from the pins"
            )
        )


def memory(system: System, solver: str = "direct") -> float:
    """About what a run will hold at its peak [MB].

    The program, a node's arrays, a block's, and the factor's, which grows as b log₂ n with b
    blocks on n nodes: fitted to peaks of 441 to 40,401 nodes, P1, with hinges and without, which
    it meets within a tenth.
    """
    n, blocks = len(system.cloth.X), len(system.pattern.indices)
    held = 1500 * n
    if solver != "explicit":
        held += 72 * blocks
    if solver == "direct":
        held += 47 * blocks * math.log2(n) + 23e6
    return 200 + held / 1e6


def wave_speed(fabric: Fabric) -> float:
    """√(Y / ((1 − ν₁₂ ν₂₁) ρ)) [m/s] along the stiffer direction: a wave that stretches it."""
    warp, weft = fabric.tensile
    across = 1 - fabric.poisson_ratio**2 * weft / warp
    return math.sqrt(max(warp, weft) / across / fabric.areal_density)


# --- doubts ---------------------------------------------------------------------------------------


def doubts(built: Built) -> list[str]:
    """A sentence for each thing that is likely to disappoint, with what to do."""
    units = odd(built.system.fabric, built.cloth, built.dt)
    asked = (_mesh, _weight, _wrinkles, _flat, _fast_waves, _damping)
    return [*units, *(sentence for doubt in asked for sentence in doubt(built))]


def _mesh(built: Built) -> Iterator[str]:
    quality = built.cloth.quality
    worst = int(np.argmin(quality))
    if quality[worst] < POOR:
        X, Y = built.cloth.X[built.cloth.triangles[worst]].mean(axis=0)
        yield (
            f"triangle {worst} at ({X:.3g}, {Y:.3g}) m has the quality {quality[worst]:.2g} (1 is "
            f"equilateral), {int((quality < POOR).sum())} are below {POOR}: slivers are stiff in "
            "bending, and explicit steps are as short as the worst one asks; mesh it anew"
        )


def _weight(built: Built) -> Iterator[str]:
    """ρ g L / Y, the strain at the upper end of a strip that hangs."""
    system, pull, length = built.system, gravity(built.system), hanging(built.system)
    if not (pull and length and set(ELASTIC) & set(_kinds(system))):
        return
    load = pull * length * system.nodal_mass.sum() / system.cloth.area
    strain = load / min(min(fabric.tensile) for fabric in _fabrics(system))
    if strain > STRAINED:
        yield (
            f"its own weight will stretch the cloth by about {100 * strain:.0f} % (ρ g L / Y, "
            f"L = {length:.2g} m from the pins): hardly a fabric is that soft; measured woven "
            "ones have Y = 200 to 10,000 N/m"
        )


def _wrinkles(built: Built) -> Iterator[str]:
    """λ = 2√π (B/T)^¼ √L under T = ρ g L.

    Cerda and Mahadevan (2003), Geometry and Physics of Wrinkling, Phys. Rev. Lett. 90, 074302.
    """
    system, length = built.system, hanging(built.system)
    load = gravity(system) * length * system.nodal_mass.sum() / system.cloth.area
    if not load:
        return
    edge = math.sqrt(4 / math.sqrt(3) * system.cloth.area / len(system.cloth.triangles))
    if not set(BENDING) & set(_kinds(system)):
        if "TensionField" not in _kinds(system):
            yield (
                "without bending stiffness the cloth folds as finely as the mesh wherever it is "
                "compressed; what is taut is right. Add HingeBending, or take TensionField"
            )
        return
    rigidity = max(max(fabric.bending) for fabric in _fabrics(system) if fabric.bending)
    wave = 2 * math.sqrt(math.pi) * (rigidity / load) ** 0.25 * math.sqrt(length)
    if wave < RESOLVED * edge:
        yield (
            f"wrinkles under its own weight are about {wave:.2g} m long, and the edges {edge:.2g} "
            f"m: the mesh will shape them; h <= {wave / RESOLVED:.2g} m shows them"
        )


def _flat(built: Built) -> Iterator[str]:
    """What is in a plane, and pushed along it only, stays there: it cannot even buckle."""
    system, state = built.system, built.state
    if not set(BENDING) & set(_kinds(system)):
        return
    _, extents, axes = np.linalg.svd(state.x - state.x.mean(axis=0), full_matrices=False)
    if extents[2] > 1e-9 * extents[0]:
        return
    normal = axes[2]
    if all(np.abs(y @ normal).max() <= 1e-9 * np.abs(y).max() for y in _pushes(built)):
        yield (
            "the cloth starts in a plane, and nothing pushes it out: it will not bend, nor buckle "
            "where it is compressed. Bend it a little, as [start] position = "
            '["X", "0.001 * sin(9 * X)", "Y"] does a sheet that hangs'
        )


def _pushes(built: Built) -> Iterator[np.ndarray]:
    """(n, 3) what moves the cloth as it lies: its velocity, its pins and forces at five times."""
    system, state = built.system, built.state
    yield state.v
    for t in state.t + (built.t_end - state.t) * np.array([0.0, 0.13, 0.37, 0.71, 1.0]):
        x, v = system.constraints.target(state.t, t - state.t, state.x)
        yield from (x - state.x, v, system.force(State(t, state.x, state.v)))


def _fast_waves(built: Built) -> Iterator[str]:
    method, system = built.method, built.system
    gains = isinstance(method, GAINING) and getattr(method, "rho_inf", 1.0) > 0
    damped = any(term.dissipative for term in system.bound)
    if not (gains and built.dt) or damped:
        return
    limit = element_bound(system, "central_difference")
    if built.dt > UNRESOLVED * limit:
        yield (
            f"dt = {built.dt:g} s is {built.dt / limit:.0f} times the explicit limit and nothing "
            f"damps: {type(method).__name__} may gain energy from waves that it does not resolve; "
            "add StrainRateDamping, or take BDF2 or EnergyMomentum"
        )


def _damping(built: Built) -> Iterator[str]:
    """Of the methods of first order, on the slowest motion that there is."""
    pull, length = gravity(built.system), hanging(built.system)
    if not (isinstance(built.method, FIRST_ORDER) and built.dt and pull and length):
        return
    lost = swing_loss(math.sqrt(pull / length) * built.dt)
    if lost > DAMPED:
        yield (
            f"{type(built.method).__name__} takes about {100 * lost:.0f} % of the amplitude of "
            f"a swing over {length:.2g} m in each, by itself: well for who wants it to come to "
            "rest; BDF2 or another method of second order does not"
        )


def swing_loss(angle: float) -> float:
    """Part of the amplitude that backward Euler takes in a period, with ω dt = angle.

    A step keeps 1/√(1 + ω² dt²), and a period has 2π / (ω dt) of them.
    """
    return -math.expm1(-math.pi / angle * math.log1p(angle**2))


def gravity(system: System) -> float:
    """|g| [m/s²] of all `Gravity` terms."""
    given = [t.acceleration for t in system.terms if type(t).__name__ == "Gravity"]
    return float(np.linalg.norm(np.sum(given, axis=0))) if given else 0.0


def hanging(system: System) -> float:
    """The distance on the cloth of the node farthest from the pins [m]; 0 where nothing holds."""
    held = system.constraints.nodes
    if not len(held):
        return 0.0
    distances, _ = cKDTree(system.cloth.X[held]).query(system.cloth.X)
    return float(distances.max())


def heaviness(system: System) -> float:
    """ρ g L³/B, weight over bending stiffness [-]; 0 where one of them or a pin is missing.

    L is the `reach`, B the least of the rigidities. With 8 a cantilever would sink by its
    length, were its deflection in proportion to the load.
    """
    known = [min(fabric.bending) for fabric in _fabrics(system) if fabric.bending]
    if not (known and set(BENDING) & set(_kinds(system))):
        return 0.0
    weight = gravity(system) * system.nodal_mass.sum() / system.cloth.area
    return weight * reach(system) ** 3 / min(known)


def reach(system: System) -> float:
    """How far the cloth reaches from its pins, twice that if they surround its middle [m]."""
    return hanging(system) * (1 + surrounded(system))


def surrounded(system: System) -> bool:
    """Whether the middle of the cloth, the mean of its nodes, lies within the pins' convex hull."""
    X = system.cloth.X
    try:
        hull = ConvexHull(X[system.constraints.nodes])
    except (QhullError, ValueError):  # pins on a line, or too few
        return False
    return bool((hull.equations @ [*X.mean(axis=0), 1.0] <= 1e-12).all())


def _kinds(system: System) -> list[str]:
    return [type(term).__name__ for term in system.terms]


def _fabrics(system: System) -> tuple[Fabric, ...]:
    return system.panel.fabrics


def _explicit(built: Built) -> bool:
    return built.method.traits.explicit
