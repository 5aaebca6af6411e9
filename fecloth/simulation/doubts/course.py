"""Runs that are likely to disappoint: by their mesh, weight, plane start, or size of steps."""

import math
from collections.abc import Iterator

import numpy as np

from fecloth.integrators.bdf2 import BDF2
from fecloth.integrators.energy_momentum import EnergyMomentum
from fecloth.integrators.newmark import GeneralizedAlpha
from fecloth.linalg import select
from fecloth.linalg.prices import Prices
from fecloth.simulation import dimensionless
from fecloth.simulation.dimensionless import distance_from_pins, gravity_magnitude
from fecloth.simulation.doubts.accepted import accepts_method, accepts_term, join_accepted
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.doubts.units import LARGEST_STEP
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms import PlateBending, TensionField
from fecloth.terms.traits import has_kind, traits_of

LESS_DAMPED = BDF2(), GeneralizedAlpha()  # of order 2, and with dissipation of fast waves only
LEAST_QUALITY = 0.3  # of a triangle without a doubt; 1 is equilateral, 0.87 half a square
EDGES_PER_WRINKLE = 4.0  # fewest edges that resolve a wrinkle: two for each half wave
LEAST_COMPRESSED = 0.2  # part of the area; where less is compressed, wrinkles do not matter
# Of folds over the displacement; lower folds were seen to change no motion.
LEAST_HEIGHT = 0.012
SHALLOW_ANGLE = 0.05  # rad; folds that are shallower must be higher to matter
LEAST_HEIGHT_OF_SHALLOW = 0.03  # of shallow folds over the displacement
# Part of the angles between triangles; where less is rough, the mesh resolves the folds.
LEAST_ROUGHNESS = 0.65
# Of a hanging cloth by its weight; measured constants hold for a few per cent.
LARGEST_STRAIN = 0.2
FAST_STEP = 20.0  # dt over the explicit limit; beyond, fast waves were seen to gain energy
LEAST_LOSS = 0.01  # part of the amplitude that damping must take from fast waves in a step
SHORT_STEP = 0.01  # dt over the explicit limit; an implicit method pays only for longer steps
SLOW_FACTOR = 2.0  # times as long; below, another package is not worth a line
LARGEST_LOSS = 0.1  # part of the amplitude that a method may take in one swing: it can be seen


def find_slivers(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt triangles that are far from equilateral."""
    cloth = run.system.cloth
    quality = cloth.quality
    worst = int(np.argmin(quality))
    if quality[worst] < LEAST_QUALITY:
        X, Y = cloth.X[cloth.triangles[worst]].mean(axis=0)
        below = int((quality < LEAST_QUALITY).sum())
        words = (
            f"triangle {worst} at ({X:.3g}, {Y:.3g}) m has the quality {quality[worst]:.2g} "
            f"(1 is equilateral), {below} are below {LEAST_QUALITY}: slivers are stiff in "
            "bending, and the worst one limits explicit steps"
        )
        yield Doubt(DoubtKind.MESH, words, "improve the mesh")


def find_large_weight(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt the fabric if the strain ρ g L / Y at the upper end of a hanging strip is large."""
    system = run.system
    pull = gravity_magnitude(system)
    length = distance_from_pins(system)
    if not (pull and length and any(traits_of(term).as_fabric for term in system.terms)):
        return
    load = pull * length * system.total_mass / system.cloth.area
    strain = load / min(min(fabric.tensile) for fabric in system.panel.fabrics)
    if strain > LARGEST_STRAIN:
        words = (
            f"its own weight will stretch the cloth by about {100 * strain:.0f} % (ρ g L / Y, "
            f"L = {length:.2g} m from the pins): few fabrics are that soft"
        )
        yield Doubt(DoubtKind.WEIGHT, words, "woven ones have Y = 200 to 10,000 N/m")


def find_flat_start(run: PlannedRun) -> Iterator[Doubt]:
    """Note a cloth in a plane with forces in that plane only: it cannot buckle out of it."""
    system = run.system
    state = run.state
    if not has_kind(system.terms, "bending"):
        return
    _, extents, axes = np.linalg.svd(state.x - state.x.mean(axis=0), full_matrices=False)
    if extents[2] > 1e-9 * extents[0]:
        return
    normal = axes[2]
    if all(np.abs(push @ normal).max() <= 1e-9 * np.abs(push).max() for push in _pushes(run)):
        words = (
            "the cloth starts in a plane, and nothing pushes it out of the plane: it can "
            "neither bend nor buckle"
        )
        remedy = (
            "Bend it a little, for example by [start] position = "
            '["X", "0.001 * sin(9 * X)", "Y"] for a hanging sheet'
        )
        yield Doubt(DoubtKind.START, words, remedy)


def _pushes(run: PlannedRun) -> Iterator[np.ndarray]:
    """Yield what may move the cloth, (n, 3) each.

    These are its velocity at the start and, at five times of the run, the displacements and the
    velocities of pins, and the forces on the cloth at its start.
    """
    system = run.system
    state = run.state
    yield state.v
    for t in state.t + (run.t_end - state.t) * np.array([0.0, 0.13, 0.37, 0.71, 1.0]):
        x, v = system.constraints.target(state.t, t - state.t, state.x)
        yield x - state.x
        yield v
        yield system.force(State(t, state.x, state.v))


def find_fast_waves(run: PlannedRun) -> Iterator[Doubt]:
    """Note if steps far beyond the explicit limit may feed undamped fast waves."""
    method = run.method
    dt = run.dt
    if not (method.traits.gains and dt):
        return
    limit = run.explicit_limit
    loss = _loss(run, dt)
    if dt > FAST_STEP * limit and loss < LEAST_LOSS:
        if loss:
            damping = f"damping takes {100 * loss:.1g} % a step from them"
        else:
            damping = "there is no damping"
        words = (
            f"dt = {dt:g} s is {dt / limit:.0f} times the explicit limit, and "
            f"{damping}: {type(method).__name__} may gain energy from waves that it does "
            "not resolve"
        )
        remedy = join_accepted(
            {
                "add StrainRateDamping with a time near dt": True,
                "take BDF2": accepts_method(run.system, BDF2()),
                "take EnergyMomentum": accepts_method(run.system, EnergyMomentum()),
            }
        )
        yield Doubt(DoubtKind.GAIN, words, remedy)


def _loss(run: PlannedRun, dt: float) -> float:
    """Return the part of the amplitude that damping takes in a step, of fast or of all waves.

    The midpoint rule multiplies a wave of ω dt ≫ 2 and damping d = 2 ζ ω by 1 − 4 d/(ω² dt), one
    that it resolves by 1 − d dt/2.
    """
    stiffness, damping = run.rates
    if stiffness:
        return min(1.0, max(4 * damping / (stiffness * dt), damping * dt / 2))
    return 0.0


def find_short_steps(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt an implicit method with shorter steps than an explicit method needs."""
    dt = run.dt
    if not dt or run.method.traits.explicit:
        return
    limit = run.explicit_limit
    if dt < SHORT_STEP * limit < math.inf:
        words = (
            f"dt = {dt:g} s is {limit / dt:.0f} times shorter than even an explicit method "
            f"needs ({limit:.2g} s)"
        )
        remedy = f"If you meant ms, write {1000 * dt:g}; without dt the error determines it"
        yield Doubt(DoubtKind.STEP, words, remedy)


def find_slow_factors(run: PlannedRun) -> Iterator[Doubt]:
    """Yield a doubt if SciPy factorises the matrices of the run, as no faster package is there."""
    if run.method.traits.explicit or select.expected() != "superlu":
        return
    factors = Prices.of(run.system.pattern).factors
    work = {name: prices.factor * prices.entries for name, prices in factors.items()}
    ratio = work["superlu"] / work["rslab"]
    if ratio >= SLOW_FACTOR:
        words = f"a factor by SuperLU takes about {ratio:.0f} times as long as by rslab"
        yield Doubt(DoubtKind.SPEED, words, "pip install rslab")


def find_step_beyond_end(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt dt if a single step is longer than the whole run, and is not called large anyway."""
    span = run.t_end - run.state.t
    if run.dt and span * (1 + 1e-9) < run.dt <= LARGEST_STEP:
        words = (
            f"dt = {run.dt:g} s is longer than the run of {span:g} s, which is a single shorter "
            "step"
        )
        yield Doubt(DoubtKind.STEP, words, "make dt shorter than t_end")


def find_numerical_damping(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt the method if a first-order method will visibly damp the slowest swing."""
    pull = gravity_magnitude(run.system)
    length = distance_from_pins(run.system)
    traits = run.method.traits
    damped = traits.order == 1 and traits.at_infinity < 1
    if not (damped and run.dt and pull and length):
        return
    frequency = math.sqrt(pull / length)  # of a pendulum [rad/s]
    lost = dimensionless.swing_loss(frequency * run.dt)
    rates = [term.rate for term in run.system.terms if traits_of(term).damps == "motion"]
    lost_to_terms = -math.expm1(-sum(rates) * math.pi / frequency)  # in a period
    if lost > max(LARGEST_LOSS, lost_to_terms):
        words = (
            f"numerical damping of {type(run.method).__name__} removes about "
            f"{100 * lost:.0f} % of the amplitude of a swing over {length:.2g} m per period"
        )
        others = join_accepted(
            {type(method).__name__: accepts_method(run.system, method) for method in LESS_DAMPED}
            | {"a smaller dt": True}
        )
        remedy = f"Fine if the cloth should settle; otherwise take {others}"
        yield Doubt(DoubtKind.DAMPING, words, remedy)


def doubt_wrinkles(
    system: System, compressed: float, rough: float, angle: float, height: float
) -> Doubt | None:
    """Return a doubt if a compressed cloth is folded as finely as its triangles.

    Parameters
    ----------
    system
        The cloth and its terms. With a `TensionField` there is no doubt: it has no folds.
    compressed
        Part of the area that is compressed at the end; see `compressed_share`.
    rough
        Part of the angles between triangles that no curvature explains; see `roughness`.
    angle
        Root mean square of these angles [rad].
    height
        Height of the folds over the largest rms displacement: low folds change no motion.
    """
    if any(isinstance(term, TensionField) for term in system.terms):
        return None
    least_height = LEAST_HEIGHT
    if not angle > SHALLOW_ANGLE:
        least_height = LEAST_HEIGHT_OF_SHALLOW
    is_folded = rough > LEAST_ROUGHNESS and height > least_height
    if not (compressed > LEAST_COMPRESSED and is_folded):
        return None
    words = (
        f"wrinkles as fine as the mesh: {100 * compressed:.0f} % of the cloth is compressed, "
        "and its triangles decide how it folds"
    )
    if not has_kind(system.terms, "bending"):
        rigidity = ""
        if not accepts_term(system, PlateBending()):
            rigidity = " and give the fabric a bending_rigidity"
        field = "use TensionField where only taut regions matter"
        remedy = join_accepted(
            {
                f"add PlateBending{rigidity}": True,
                field: accepts_term(system, TensionField()),
            }
        )
        return Doubt(DoubtKind.WRINKLES, words, remedy)
    wave = dimensionless.wrinkle_length(system) / EDGES_PER_WRINKLE
    edge = dimensionless.mean_edge(system)
    if 0 < wave < edge:
        size = f"<= {wave:.2g} m"
    else:
        size = "below half of the present one"
    return Doubt(DoubtKind.WRINKLES, words, f"take h {size}")
