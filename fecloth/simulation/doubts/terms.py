"""Terms that cannot be meant so: missing, counted twice, of another fabric, without effect."""

import itertools
import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from fecloth import terms
from fecloth.simulation.doubts.accepted import accepts_term, join_accepted
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.planned_run import PlannedRun, attempt
from fecloth.system.system import System
from fecloth.terms import protocol
from fecloth.terms.contact.advance import slope_at_surface
from fecloth.terms.contact.bound_obstacle import BoundObstacle
from fecloth.terms.contact.inside import cutting_depth
from fecloth.terms.contact.shape import Sdf
from fecloth.terms.traits import has_kind, traits_of

SEVERAL = {  # of a kind, in words
    "membrane": "membranes",
    "bending": "bending terms",
    "drag": "drag terms",
    "damping": "dampings",
    "load": "loads",
    "contact": "contacts",
}
# Strain at which the resistance of a system is measured: small, and far above round-off.
TRIAL_STRETCH = 0.01
LEAST_RESISTANCE = 1e-3  # over the resistance of the fabric; less is no membrane
LARGEST_MISMATCH = 0.1  # relative; a net of springs within it is as stiff as the fabric
ERROR_OF_PATTERN = 0.25  # of its rigidity is what hinges miss by the pattern of the mesh anyway
# Poisson's ratio of bending on equilateral triangles, and nearly on Gmsh's.
POISSON_OF_HINGES = -1 / 3
ROUND_OFF_OF_COUPLING = 1e-12  # relative; less is no lower coupling
# |∇φ| of an `Sdf`, or 1/|∇φ|: beyond this value its gap in metres differs too much from `gap`.
MOST_SLOPE = 3.0
LEAST_PRESSURE = 0.5  # over the ambient pressure; a gas with less lets the cloth collapse


# --- membranes ---------------------------------------------------------------


def find_no_terms(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a scene that names no term, so that nothing acts on the cloth."""
    if not run.system.terms:
        words = "no terms are given: nothing acts on the cloth, which has no stiffness either"
        yield Doubt(DoubtKind.TERMS, words, "add StVK and Gravity")


def find_no_membrane(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt the terms if nothing resists a stretch, and they are for more than a free fall."""
    system = run.system
    names = [type(term).__name__ for term in system.terms]
    is_held = len(system.constraints.nodes) or has_kind(system.terms, "bending")
    if not (names and is_held):
        return
    resistance = _resistance(system)
    if resistance > LEAST_RESISTANCE:
        return
    words = (
        f"no membrane is among the terms ({', '.join(names)}): they resist a stretch with "
        f"{100 * resistance:.2g} % of the fabric's stiffness, so the cloth will be drawn out "
        "without limit"
    )
    yield Doubt(DoubtKind.TERMS, words, "add StVK")


def _resistance(system: System) -> float:
    """Return the resistance of the internal forces to a uniform stretch, over the fabric's.

    Both are the virtual work of a stretch on the forces that a small stretch causes. Loads and
    contact are left out: they resist no stretch.
    """
    rest = system.rest().x
    still = np.zeros_like(rest)
    at_rest = np.zeros_like(rest)
    stretched = np.zeros_like(rest)
    for term, bound in zip(system.terms, system.bound, strict=True):
        stencil = protocol.stencil(term, system.cloth)
        is_internal = stencil is not None and stencil.shape[1] > 1
        if is_internal and not (bound.load or bound.limits_direction):
            bound.add_force((1 + TRIAL_STRETCH) * rest, still, 0.0, stretched)
            bound.add_force(rest, still, 0.0, at_rest)
    stiffness = system.panel.each(lambda fabric: fabric.moduli()[[0, 1, 3, 3]].sum())[:, 0]
    of_fabric = TRIAL_STRETCH * float(system.cloth.weights.sum(axis=1) @ stiffness)
    return float(np.vdot(at_rest - stretched, rest)) / of_fabric


def find_counted_twice(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a term that stands twice, and two terms for one thing, such as two membranes."""
    given = [term for term in run.system.terms if not (_is_net(term) and term.stiffness == 0)]
    counts = Counter(map(_identity, given))
    for (name, *_), count in counts.items():
        if count > 1:
            words = f"{name} stands {count} times among the terms, and their forces add up"
            yield Doubt(DoubtKind.TERMS, words, "leave one out, or join them into one")
    of_kind: dict[str, dict[str, None]] = {kind: {} for kind in SEVERAL}
    for term in given:
        if traits_of(term).exclusive:
            of_kind.setdefault(traits_of(term).kind, {})[type(term).__name__] = None
    for kind, names in of_kind.items():
        if len(names) > 1:
            several = f"{len(names)} {SEVERAL.get(kind, 'terms')} act at once"
            words = f"{several} ({', '.join(names)}), and their forces add up"
            yield Doubt(DoubtKind.TERMS, words, f"leave {' or '.join(names)} out")


def _identity(term: object) -> tuple[str, ...]:
    """Return what two terms have in common if they stand for the same thing.

    It is the name of their class and, of terms that may act at several places, all values.
    """
    name = type(term).__name__
    traits = traits_of(term)
    if traits.exclusive or not traits.several_places:
        return (name,)
    return (name, repr(term))


def find_springs_of_another_fabric(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a net in place of a membrane that is stiffer or softer than the fabric."""
    system = run.system
    pairs = zip(system.terms, system.bound, strict=True)
    nets = [bound for term, bound in pairs if _is_net(term)]
    others = [term for term in system.terms if not isinstance(term, terms.Springs)]
    if not nets or has_kind(others, "membrane"):
        return
    fabric = System(system.cloth, system.fabric, [terms.StVK()], grain=system.grain).bound[0]
    ratios = []
    for strain in ([[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]]):
        x = system.rest().x
        x[:, :2] += 1e-4 * system.cloth.X @ np.array(strain)
        ratios.append(sum(net.energy(x, 0.0) for net in nets) / fabric.energy(x, 0.0))
    if max(abs(ratio - 1) for ratio in ratios) > LARGEST_MISMATCH:
        along_x, along_y, in_shear = np.round(ratios, 6)
        words = (
            f"the Springs are {along_x:.3g}, {along_y:.3g} and {in_shear:.3g} times as stiff as "
            "the fabric in a stretch along X, along Y and in shear: a net is a material of its "
            "own, and no finer mesh changes that"
        )
        biquadratic = terms.Springs(kind="biquadratic")
        remedy = join_accepted(
            {"use StVK": True, 'kind = "biquadratic"': accepts_term(system, biquadratic)}
        )
        yield Doubt(DoubtKind.TERMS, words, remedy)


def _is_net(term: object) -> bool:
    """Return whether a term is a net of springs, whose stiffness is its own on any mesh."""
    return isinstance(term, terms.Springs) and term.kind != "biquadratic"


def find_ignored_poisson_ratio(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a Poisson's ratio of the fabric where the incompressible sheet has ½."""
    sheets = [term for term in run.system.terms if isinstance(term, terms.NeoHookean)]
    if not any(sheet.kind == "incompressible" for sheet in sheets):
        return
    given = {fabric.poisson_ratio for fabric in run.system.panel.fabrics} - {0.0}
    for nu in sorted(given):
        if abs(nu - 0.5) <= LARGEST_MISMATCH / 2:
            continue
        words = f"poisson_ratio = {nu:g} has no effect: NeoHookean is incompressible, with 0.5"
        remedy = 'use kind = "compressible", or leave poisson_ratio out'
        yield Doubt(DoubtKind.NO_EFFECT, words, remedy)


def find_lowered_coupling(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a `MembraneTable` that must take a smaller Poisson's ratio than its `poisson`."""
    tables = [term for term in run.system.terms if isinstance(term, terms.MembraneTable)]
    for table, fabric in itertools.product(tables, run.system.panel.fabrics):
        coupling, most = table.coupling(fabric)
        if abs(coupling) > most * (1 + ROUND_OFF_OF_COUPLING):
            words = (
                f"MembraneTable: poisson is lowered by a factor of {most / abs(coupling):.3g}: "
                "with more, W would not be convex where warp and weft are softer than at rest"
            )
            yield Doubt(DoubtKind.NO_EFFECT, words)


def find_unused_bending(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt constants of bending that no term uses.

    There is no doubt about a fabric with a source, where all constants were measured together,
    nor with a term of the user, which may read any of them.
    """
    used = run.system.terms
    if not all(type(term).__module__.startswith("fecloth.") for term in used):
        return
    slides = any(isinstance(term, terms.BendingFriction) for term in used)
    bends = slides or any("bending" in (traits_of(t).kind, traits_of(t).damps) for t in used)
    for fabric in dict.fromkeys(run.system.panel.fabrics):
        given = {
            "bending_rigidity": fabric.bending_rigidity is not None and not bends,
            "bending_poisson_ratio": fabric.bending_poisson_ratio != 0.0 and not bends,
            "bias_rigidity": fabric.bias_rigidity is not None and not bends,
            "bending_hysteresis": any(fabric.hysteresis or ()) and not slides,
        }
        unused = [name for name, is_unused in given.items() if is_unused]
        if unused and not fabric.source:
            have = "has" if len(unused) == 1 else "have"
            words = f"{' and '.join(unused)} of the fabric {have} no effect: no term uses it"
            term = "PlateBending" if not bends else "BendingFriction"
            yield Doubt(DoubtKind.NO_EFFECT, words, f"add {term}, or leave it out")


def find_bending_unknown_to_hinges(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt the terms if the fabric states a plate's constant that hinges do not have."""
    names = [type(term).__name__ for term in run.system.terms if traits_of(term).by_pattern]
    if not names:
        return
    for fabric in dict.fromkeys(run.system.panel.fabrics):
        nu = fabric.bending_poisson_ratio
        bias = fabric.bias_rigidity
        if nu and abs(nu - POISSON_OF_HINGES) > LARGEST_MISMATCH:
            words = (
                f"bending_poisson_ratio = {nu:g} has no effect: {names[0]} on a mesh of nearly "
                "equilateral triangles is a plate of -1/3, on others by the pattern, however "
                "fine"
            )
            yield Doubt(DoubtKind.NO_EFFECT, words, "take PlateBending")
        huber = sum(value**0.5 for value in fabric.bending or ()) ** 2 / 4
        if bias is not None and abs(bias - huber) > ERROR_OF_PATTERN * huber:
            words = (
                f"bias_rigidity = {bias:.3g} N m has no effect: {names[0]} knows warp and weft, "
                f"and bends at 45° with {huber:.3g} N m"
            )
            yield Doubt(DoubtKind.NO_EFFECT, words, "take PlateBending")


def find_damping_of_other_bending(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a plate that is damped as hinges, with another damping ratio."""
    system = run.system
    damping = [term for term in system.terms if isinstance(term, terms.BendingDamping)]
    plates = any(isinstance(term, terms.PlateBending) for term in system.terms)
    default = terms.HingeBending if system.cloth.element == "P1" else terms.PlateBending
    laws = [term.law or default() for term in damping]
    if plates and any(isinstance(law, terms.HingeBending) for law in laws):
        words = (
            "BendingDamping acts on hinges, and PlateBending is a plate: the damping ratio is "
            "not ω τ/2, but 0.8 to 1.3 times that, by the pattern of the mesh"
        )
        remedy = 'give it law = PlateBending(), in a scene law = { type = "PlateBending" }'
        yield Doubt(DoubtKind.TERMS, words, remedy)


def find_friction_without_plate(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt friction inside a fabric whose elastic bending is not a plate's."""
    names = [type(term).__name__ for term in run.system.terms]
    if "BendingFriction" in names and "PlateBending" not in names:
        words = (
            "BendingFriction acts on the curvature of a plate, and PlateBending is not among "
            "the terms, so that nothing bends the cloth back as HB/B says"
        )
        remedy = "take PlateBending, and leave out other bending terms"
        yield Doubt(DoubtKind.TERMS, words, remedy)


# --- loads and contact -------------------------------------------------------


def find_uneven_edges(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt equal forces on the nodes of an edge, whose ends should have less."""
    cloth = run.system.cloth
    for term in run.system.terms:
        if not isinstance(term, terms.PointForce) or isinstance(term.where, tuple):
            continue
        nodes = cloth.nodes(term.where)
        border = cloth.edge_sets.get("boundary", np.empty((0, 2), int))
        # The two ends of a single edge have equal parts of it.
        if len(nodes) <= 2 or not np.isin(border, nodes).all(axis=1).any():
            continue
        words = (
            f"PointForce gives each of {len(nodes)} nodes of an edge the same force, and the "
            "stress beside its ends grows as the mesh becomes finer"
        )
        remedy = "take EdgeForce, a force per length, for a load that is uniform along an edge"
        yield Doubt(DoubtKind.TERMS, words, remedy)


def find_gas_without_pressure(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a gas whose absolute pressure at the start is far below the ambient one."""
    for gas, bound in zip(run.system.terms, run.system.bound, strict=True):
        if not isinstance(gas, terms.Gas):
            continue
        volume = bound.volume(run.state.x)
        p = gas.pressure
        if volume > 0:
            p = bound.absolute_pressure(volume)
        if p < LEAST_PRESSURE * gas.ambient:
            words = (
                f"the Gas has {p:.3g} Pa at the start, {100 * p / gas.ambient:.2g} % of the "
                f"ambient {gas.ambient:.6g} Pa, which crushes the cloth: pressure is absolute"
            )
            remedy = (
                f"If you meant {gas.pressure:g} Pa above the ambient, write "
                f"{gas.ambient + gas.pressure:.10g}"
            )
            yield Doubt(DoubtKind.UNITS, words, remedy)


def find_gravity_upwards(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt a gravity that pulls up, along z."""
    for term in run.system.terms:
        if isinstance(term, terms.Gravity):
            *along, up = term.acceleration
            if up > max(map(abs, along)):
                words = f"Gravity pulls up: its z component is {up:g} m/s²"
                yield Doubt(DoubtKind.TERMS, words, f"write {-up:g} if z points up")


def find_other_gaps(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt an `Sdf` whose formula is far from a distance, as it then acts at another gap."""
    for name, term in run.system.named:
        if not (isinstance(term, BoundObstacle) and isinstance(term.shape, Sdf)):
            continue
        y = term.shape.pose(run.state.t).to_body(run.state.x)
        slope = attempt(slope_at_surface, term.shape, y, run.state.t, otherwise=math.nan)
        if not math.isfinite(slope) or 1 / MOST_SLOPE < slope < MOST_SLOPE:
            continue
        words = (
            f"the formula of {name} has the slope {slope:.3g} at its surface, and a distance has "
            f"1: it acts from {1e3 * term.gap / slope:.2g} mm on, and the gap is "
            f"{1e3 * term.gap:g} mm"
        )
        yield Doubt(DoubtKind.UNITS, words, f"divide the formula by {slope:.3g}")


def find_cutting_edges(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt triangles that an obstacle may cut between the points on which it acts."""
    for name, term in run.system.named:
        if not isinstance(term, BoundObstacle):
            continue
        depth = cutting_depth(term.shape, term.gap, run.system.cloth)
        if not depth:
            continue
        remedy = "or a larger gap"
        if term.shape.radius_of_curvature:
            what = "curves so much that it"
        elif isinstance(term.shape, Sdf):
            what = "has no radius: its edges"
            remedy = "a larger gap, or give its radius"
        else:
            what, remedy = "has edges that", "a larger gap, or install ipctk"
        words = (
            f"{name} {what} may cut up to {1e3 * depth:.2g} mm into triangles, and λ² times as "
            f"much where they are stretched λ times: they are large against its gap of "
            f"{1e3 * term.gap:g} mm"
        )
        yield Doubt(DoubtKind.EDGES, words, f"take a smaller h, {remedy}")
