"""Values that were probably meant in another unit, by comparison with measured cloth.

From the gauzes of silk (3 momme, 13 g/m²) and the fabrics of `presets` (83 to 481 g/m², 33 to
9,785 N/m, 4e-6 to 3e-5 N m) to a coated roof membrane: 1.05 kg/m², 0.82 mm, 1,520 MPa
(Advances in Materials Science and Engineering 2015, 387153, table 3), that is 1.2e6 N/m and,
were it solid, Y h²/12 = 0.07 N m. The limits leave a factor of three or more on either side;
values beyond them are warned of, not refused. Bending is judged by the length (B/(ρ g))^⅓ of
F. T. Peirce, The "handle" of cloth, J. Textile Institute 21, T377 (1930): 0.01 to 0.05 m, for
that membrane 0.19 m.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy.constants import g

from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.rotation import Rotation
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.planned_run import PlannedRun, attempt
from fecloth.terms import Gravity, Wind
from fecloth.terms.kinematics import principal_stretches
from fecloth.terms.traits import traits_of

CENTIMETRES = {"cm": 1e-2, "mm": 1e-3}
Words = tuple[str, str]  # what was noticed, and the remedy

# kg/m², least and most: a third of the lightest gauze, five times the heaviest roof.
DENSITIES = 0.004, 5.0
STIFFNESSES = 10.0, 1e7  # N/m, least and most: a factor 3 below and 8 above any cloth
LARGEST_BENDING_LENGTH = 0.25  # m; the stiffest membrane above has 0.19
LARGEST_HELD_CURVATURE = 500.0  # 1/m, HB/B: eight times the largest of fabrics
SIZES = 0.002, 10.0  # m, least and most: smaller are yarns, larger are roofs
LARGEST_STEP = 0.1  # s; a cloth swings within seconds, fast waves cross it within hundredths
LARGEST_GRAVITY = 50.0  # m/s²; five times the gravity on Earth, a twentieth of it in cm/s²
LARGEST_AIR_SPEED = 100.0  # m/s; three hurricanes
# Times, least and most, to which a start stretches half of the triangles: a run ends at 20.
START_STRETCHES = 0.05, 20.0
LARGEST_MISTAKE = 1e4  # times; a start and a mesh farther apart differ by more than a unit
USUAL_SIZE = 0.5  # m; of the cloths that are simulated
LARGEST_ANGLE = 2 * np.pi  # rad; a pin that turns farther is mostly meant in degrees, or has pi
LARGEST_DAMPING_TIME = 1.0  # s; in measured cloth it is below 0.1


def find_values_in_other_units(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt each value that was probably meant in another unit."""
    for words, remedy in _unlikely_values(run):
        yield Doubt(DoubtKind.UNITS, words, remedy)


def _unlikely_values(run: PlannedRun) -> Iterator[Words]:
    """Yield words and a remedy for each value that is unlikely in SI units."""
    fabric = run.system.fabric
    if isinstance(fabric, Mapping):
        for name, fabric_of_piece in fabric.items():
            for words, remedy in _of_fabric(fabric_of_piece):
                yield f"{name}.{words}", remedy
    else:
        yield from _of_fabric(fabric)
    yield from _of_size(float(np.ptp(run.system.cloth.X, axis=0).max()))
    if run.dt and run.dt > LARGEST_STEP:
        remedy = f"If you meant ms, write {run.dt / 1000:g}, and t_end in s too"
        yield f"dt = {run.dt:g} s is large: cloth swings within a second", remedy
    for term in run.system.terms:
        yield from _of_term(term)
    for name, (pin, _) in run.system.constraints.groups.items():
        if pin.rotate is not None:
            yield from _of_turn(name, pin.rotate, np.linspace(run.state.t, run.t_end, 101))


def _of_fabric(fabric: Fabric) -> Iterator[Words]:
    """Yield what is unlikely of a fabric."""
    density = fabric.areal_density
    least, most = DENSITIES
    if not least <= density <= most:
        remedy = ""
        if density > most:
            remedy = f"If you meant g/m², write {density / 1000:g}"
        yield f"areal_density = {density:g} kg/m²: cloth has 0.01 to 1", remedy
    yield from _of_stiffness(fabric)
    yield from _of_bending(fabric)


def _of_stiffness(fabric: Fabric) -> Iterator[Words]:
    """Yield what is unlikely of the stiffness along warp and weft."""
    least, most = STIFFNESSES
    for Y in dict.fromkeys(fabric.tensile):
        if not least <= Y <= most:
            if least > Y:
                meant = f"kN/m, write {1000 * Y:g}"
            else:
                meant = "Pa, use Fabric.sheet"
            words = f"tensile_stiffness = {Y:g} N/m: cloth has 30 to 1e6"
            yield words, f"If you meant {meant}"


def _of_bending(fabric: Fabric) -> Iterator[Words]:
    """Yield what is unlikely of the bending rigidity, and of its hysteresis beside it."""
    for B in dict.fromkeys(fabric.bending or ()):
        length = bending_length(B, fabric.areal_density)
        if length > LARGEST_BENDING_LENGTH:
            words = (
                f"bending_rigidity = {B:g} N m: it bends under its weight over {length:.2g} m, "
                "cloth over 0.01 to 0.05 m"
            )
            yield words, f"If you meant µN m, write {B * 1e-6:g}"
    for hysteresis, B in zip(fabric.hysteresis or (), fabric.bending or (), strict=False):
        if hysteresis > 2 * LARGEST_HELD_CURVATURE * B:
            meant = f'gf·cm/cm, as KES prints, write "{hysteresis:g} gf*cm/cm"'
            words = (
                f"bending_hysteresis = {hysteresis:g} N: HB/B = {hysteresis / (2 * B):.3g}/m, "
                "in fabrics 5 to 60/m"
            )
            yield words, f"If you meant {meant}"
            break


def _of_size(size: float) -> Iterator[Words]:
    """Yield what is unlikely of the extent of the cloth [m]."""
    least, most = SIZES
    if size > most:
        words = f"the cloth is {size:.4g} m long: few are longer than {most:g} m"
        unit, meant = _nearest(size, CENTIMETRES, USUAL_SIZE)
        scale = f"a mesh file in {unit} needs scale = {CENTIMETRES[unit]:g}"
        remedy = f"If you meant {unit}, write {meant:.4g}; {scale}"
        yield words, remedy
    if size < least:
        words = f"the cloth is {size:.4g} m long: the fabric of so small a piece is its yarns"
        yield words, f"If you meant m in place of mm, write {1000 * size:.4g}"


def refuse_start_in_other_units(cloth: Cloth, x: np.ndarray, where: str) -> None:
    """Raise `InputError` for positions x (n, 3) that were meant in another unit than the cloth.

    Half of the triangles are then stretched beyond `START_STRETCHES`, or below them.
    """
    stretch = float(np.median(principal_stretches(cloth, x).max(axis=1)))
    least, most = START_STRETCHES
    if not (stretch < least or stretch > most):
        return
    ratio = max(stretch, 1 / stretch) if stretch else np.inf
    remedy = "Both are in metres."
    if ratio < LARGEST_MISTAKE:
        larger, smaller = ("start", "mesh") if stretch > most else ("mesh", "start")
        unit, _ = _nearest(ratio, CENTIMETRES, 1.0)
        factor = f"{CENTIMETRES[unit]:g}"
        way = f", as a file by scale = {factor}" if larger == "mesh" else ""
        remedy = (
            f"If the {larger} is in {unit} and the {smaller} in m, "
            f"multiply the {larger} by {factor}{way}."
        )
    what = f"positions that stretch the cloth to {stretch:.4g} times its reference"
    allowed = f"must stretch it to {least:g} to {most:g} times"
    raise InputError(what, allowed, where, remedy)


def _of_term(term: Any) -> Iterator[Words]:
    """Yield what is unlikely of gravity, a damping or a wind."""
    if isinstance(term, Gravity):
        size = float(np.linalg.norm(term.acceleration))
        if size > LARGEST_GRAVITY:
            words = f"Gravity has {size:g} m/s²: on Earth it is 9.81"
            unit, meant = _nearest(size, CENTIMETRES, g)
            yield words, f"If you meant {unit}/s², write {meant:g}"
    if traits_of(term).damps in ("strain", "bending") and term.time > LARGEST_DAMPING_TIME:
        words = f"{type(term).__name__} has time = {term.time:g} s: cloth has less than 0.1"
        yield words, f"If you meant ms, write {term.time / 1000:g}"
    if isinstance(term, Wind):
        speed = _speed(term.velocity)
        if speed > LARGEST_AIR_SPEED:
            words = f"Wind blows at {speed:g} m/s: a hurricane has 33"
            yield words, f"If you meant km/h, write {speed / 3.6:.3g}"


def _of_turn(name: str, rotation: Rotation, times: np.ndarray) -> Iterator[Words]:
    """Yield what is unlikely of a turn of the pin `name` in a run with these times (m,) [s].

    An angle in radians that is no fraction of π, and more than a whole turn, was meant in
    degrees, which are whole numbers.
    """
    angles = np.abs([attempt(rotation.at, float(t), otherwise=0.0) for t in times])
    angle = float(angles.max())
    formula = rotation.angle if isinstance(rotation.angle, str) else ""
    if angle > LARGEST_ANGLE and not re.search(r"\bpi\b", formula):
        turns = angle / (2 * np.pi)
        words = f"pin {name!r} turns by {angle:.4g} rad, {turns:.3g} turns: angles are in radians"
        yield words, f"If you meant degrees, write ({formula or 'angle'}) * pi / 180"


def _nearest(value: float, units: Mapping[str, float], usual: float) -> tuple[str, float]:
    """Return the unit in which a value is nearest to a `usual` one, by ratio; and the value in SI.

    `units` has the value in SI of each unit.
    """
    unit = min(units, key=lambda unit: abs(np.log(value * units[unit] / usual)))
    return unit, value * units[unit]


def _speed(velocity: Any) -> float:
    """Return the speed of a wind of three numbers [m/s], 0 for a function or formulas."""
    if not isinstance(velocity, (tuple, list)) or any(isinstance(v, str) for v in velocity):
        return 0.0
    return float(np.linalg.norm(velocity))


def bending_length(B: float, density: float) -> float:
    """Return Peirce's bending length (B/(ρ g))^⅓ [m], of B [N m] and the density ρ [kg/m²]."""
    return float((B / (density * g)) ** (1 / 3))


def is_stiff(fabric: Fabric) -> bool:
    """Return whether the bending rigidity is beyond any cloth's, and is warned of."""
    lengths = (bending_length(B, fabric.areal_density) for B in fabric.bending or ())
    return any(length > LARGEST_BENDING_LENGTH for length in lengths)
