"""One case of the stability study: the outcome of a run, and its predicted limits."""

from __future__ import annotations

import hashlib
import math
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import scipy.linalg

import fecloth as fc
from fecloth import study
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.scene.problem import Problem
from fecloth.scene.scene import load_scene

ALL = {**METHODS, **EXPLICIT}
STABLE, WRONG, NEWTON, BLOWN = "stable", "stable but wrong", "Newton failed", "blew up"
ENERGY = 0.05  # energy made by the method, relative to the energy that moved
ERROR = 0.1  # relative to the motion
KEYS = (
    "path",
    "content",
    "stiffness",
    "h",
    "damping",
)  # settings of a scene
PARTS = 4  # parts of the time; runs are compared at their ends
DENSE = 2000  # largest number of free directions for dense eigenvalues
MOST = 8000  # largest number of steps of an explicit reference; a quarter for BDF2
SHEET, TAUT, TINY = 0.5, 1.05, 1e-7  # [m]; stretch; [m], small enough for linear motion
GROWTH = 1.0  # log of the growth of noise above which a run is unstable
EXACT = fc.Newton(1e-12)


def classify(why: str, made: float, error: float) -> str:
    """Classify a run.

    Parameters
    ----------
    why
        Message of `StepFailed`; "" if the run reached its end.
    made
        Largest energy made by the method, over the energy that moved.
    error
        Largest rms distance (by mass) from the reference at the quarters of the time, over the
        reference's largest displacement; NaN without a reference.

    Examples
    --------
    >>> classify("", 0.01, 0.02), classify("", 0.01, 0.3), classify("", 0.2, float("nan"))
    ('stable', 'stable but wrong', 'stable but wrong')
    >>> classify("the cloth moves with 9 J ...: the method has made the rest", 3.0, 1.0)
    'blew up'
    """
    if why:
        messages = ("not finite", "is stretched to", "has made the rest")
        return BLOWN if any(words in why for words in messages) else NEWTON
    return WRONG if made > ENERGY or error > ERROR else STABLE


def make_method(name: str):
    """Return the method with its defaults; explicit methods may exceed their limit."""
    return ALL[name](beyond_limit=True) if name in EXPLICIT else ALL[name]()


# --- scenes ---------------------------------------------------------------------------------------


def file_hash(path: Path) -> str:
    """Return the hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


@cache
def build_scene(path: str, content: str, stiffness: float, h: float | None, damping: float | None):
    """Build a scene with scaled stiffness, another edge length h [m] and added damping [s].

    `content` is the hash of the file: it makes an edited scene another case.
    """
    problem = load_scene(path, [f"cloth.h={h}"] if h else []).build()
    whole = problem.system
    terms = [_scale_stiffness(term, stiffness) for term in whole.terms]
    terms += [fc.StrainRateDamping(damping)] if damping else []
    fabric = _each(whole.fabric, lambda one: _scale_stiffness(one, stiffness))
    system = fc.System(problem.cloth, fabric, terms, whole.pins, whole.mass_kind, whole.grain)
    start = system.state(problem.state.x, problem.state.v, problem.state.t)
    return replace(problem, system=system, state=start)


STIFF = ("tensile_stiffness", "shear_stiffness", "stiffness", "k")


def _scale_stiffness(record, factor: float):
    """Return a fabric or a term with its membrane stiffness scaled, without its bending."""
    names = [field.name for field in fields(record) if field.name in STIFF]
    values = {name: getattr(record, name) for name in names}
    values = {name: _times(value, factor) for name, value in values.items() if value is not None}
    return replace(record, **values)


def _times(value, factor: float):
    return tuple(factor * one for one in value) if isinstance(value, tuple) else factor * value


def _each(given, function):
    if isinstance(given, dict):
        return {name: function(one) for name, one in given.items()}
    return function(given)


def _stiffest(fabric) -> float:
    """Return the largest tensile stiffness [N/m]."""
    fabrics = fabric.values() if isinstance(fabric, dict) else [fabric]
    return max(max(one.tensile) for one in fabrics)


def march(scene: Problem, method, dt: float | None) -> tuple[list[np.ndarray], fc.march]:
    """March; return the positions at the quarters of the time, and the run."""
    start, end = scene.state.t, scene.t_end
    times, positions = np.linspace(start, end, PARTS + 1)[1:], []

    def look(info) -> None:
        study.check_time_limit()
        if info.t in times:
            positions.append(info.result.state.x)

    run = (scene.system, method, scene.state, dt, end)
    options = {"solver": scene.linear, "newton": scene.newton, "report": look}
    result = fc.run(*run, stops=times, **options)
    return positions, result


@cache
def reference(*key) -> list[np.ndarray] | None:
    """Return the positions at the quarters with short steps; None if these fail too.

    The method is central differences at 0.9 of their limit; with a consistent mass, or if that
    takes more than `MOST` steps, BDF2 with dt = 1/2000 of the time.
    """
    scene = build_scene(*key)
    time = scene.t_end - scene.state.t
    limit = fc.critical_dt(scene.system, scene.state, "central_difference")
    explicit = scene.system.mass_kind == "lumped" and time / limit < MOST
    method, dt = (fc.CentralDifference(), None) if explicit else (fc.BDF2(), time / (MOST // 4))
    try:
        return march(scene, method, dt)[0]
    except fc.StepFailed:
        return None


def run_cell(method: str, steps: int, **scene) -> dict:
    """Run a method with a number of steps; return its class, the energy made and its error."""
    key = tuple(scene[name] for name in KEYS)
    scene = build_scene(*key)
    row = {"dt": (scene.t_end - scene.state.t) / steps, "made": math.inf, "off": math.nan}
    try:
        positions, result = march(scene, make_method(method), row["dt"])
    except fc.StepFailed as failure:
        why = str(failure).splitlines()[0]
        return row | {"outcome": classify(why, 0.0, 0.0), "why": why}
    row |= {
        "made": energy_made(result.energies),
        "off": relative_error(scene, positions, reference(*key)),
    }
    return row | {"outcome": classify("", row["made"], row["off"]), "why": ""}


def energy_made(energies: dict[str, np.ndarray]) -> float:
    """Return the largest energy above that of start, loads and pins, over the energy that moved.

    Dissipated energy is not added, because its sum over large steps is too large.
    """
    terms = [c for name, c in energies.items() if ":" not in name and name not in SUMS]
    work = energies["pins"] + sum(c for name, c in energies.items() if name.startswith("work:"))
    gain = energies["total"] - energies["total"][0] - work
    moved = abs(work) + sum(abs(c - c[0]) for c in terms)
    return max(0.0, float(gain.max() / max(moved.max(), 1e-300)))


SUMS = ("pins", "numerical", "total", "remainder")


def relative_error(
    scene: Problem, positions: list[np.ndarray], exact: list[np.ndarray] | None
) -> float:
    """Return the largest rms distance at the quarters over the largest displacement."""
    if exact is None:
        return math.nan
    share = scene.system.nodal_mass / scene.system.nodal_mass.sum()

    def rms(u: np.ndarray) -> float:
        return math.sqrt(share @ np.sum(u**2, axis=1))

    moved = max(rms(x - scene.state.x) for x in exact)
    return max(rms(x - y) for x, y in zip(positions, exact, strict=True)) / moved


def predict_limits(**scene) -> dict:
    """Predict limits of dt [s] from the operators at the start.

    For explicit methods they are stability limits. For implicit ones the matrix wa M + wx K turns
    indefinite where wx λ² = wa, with −λ² the least eigenvalue of M⁻¹K.
    """
    scene = build_scene(*(scene[name] for name in KEYS))
    system, state = scene.system, scene.state
    limits = {"time": scene.t_end - state.t, "Y": _stiffest(system.fabric)}
    for name in EXPLICIT:
        limits[name] = fc.critical_dt(system, state, name)
        limits[f"{name} by elements"] = fc.stability.element_bound(system, name)
    least = least_eigenvalue(system, state)
    for name in METHODS:
        wx, _, wa = make_method(name).weights(1.0)
        limits[name] = math.sqrt(wa / (wx * -least)) if least < 0 else math.inf
    return {name: value if math.isfinite(value) else None for name, value in limits.items()}


def least_eigenvalue(system: fc.System, state: fc.State) -> float:
    """Return the least eigenvalue of M⁻¹K over the free directions [1/s²]; 0 for round-off.

    The solver is dense, because Lanczos' method fails for the many zeros of a flat sheet; NaN for
    more than `DENSE` directions.
    """
    Z = system.admissible
    if Z.shape[1] > DENSE:
        return math.nan
    K, M = ((Z.T @ A @ Z).toarray() for A in (system.stiffness(state), system.mass))
    values = scipy.linalg.eigh((K + K.T) / 2, M, eigvals_only=True)
    return float(values[0]) if values[0] < -1e-6 * abs(values[-1]) else 0.0


# --- linear sheets --------------------------------------------------------------------------------


def sheet(h: float, Y: float, damping: float, drag: float = 0.0) -> tuple[fc.System, fc.State]:
    """Return a taut square with a pinned boundary, and its equilibrium."""
    cloth = fc.Cloth.rectangle(SHEET, SHEET, h, "right")
    terms = [fc.StVK()] + ([fc.StrainRateDamping(damping)] if damping else [])
    terms += [fc.MassDamping(drag)] if drag else []
    system = fc.System(cloth, fc.Fabric(0.2, Y, 0.3), terms, pins=["boundary"])
    return system, system.state(TAUT * system.rest().x)


def noise_growth(system: fc.System, rest: fc.State, method, dt: float, steps: int) -> float:
    """Return the log of the growth of noise over the last three quarters of the steps."""
    noise = np.random.default_rng(3).standard_normal(rest.x.shape)
    start = system.state(rest.x + TINY * system.constraints.project(noise))
    sizes, late = [], 1e4 * TINY
    options = {"solver": "direct", "newton": EXACT} if method.traits.stability == (0.0, 0.0) else {}
    for state, _ in fc.march(system, method, start, dt, steps * dt, **options):
        study.check_time_limit()
        sizes.append(np.linalg.norm(state.x - rest.x))
        if sizes[-1] > late:
            return math.inf
    quarter = len(sizes) // 4
    return math.log(max(sizes[-quarter:]) / max(sizes[:quarter]))


def measure_limit(method: str, h: float, Y: float, damping: float, drag: float = 0.0) -> dict:
    """Return the predicted limit of a taut sheet, and the dt above which noise grows, to 1 %."""
    system, rest = sheet(h, Y, damping, drag)
    limit = fc.critical_dt(system, rest, method)
    row = {"predicted": limit, "by elements": fc.stability.element_bound(system, method)}
    if limit == 0:
        dt = 0.2 * fc.critical_dt(system, rest, "central_difference")
        return row | {"growth": noise_growth(system, rest, make_method(method), dt, 2000)}
    low, high = 0.5 * limit, 2.0 * limit
    steps = 2000 if method != "forward_euler" else 8000  # noise grows slowly close to the limit
    while high / low > 1.01:
        middle = math.sqrt(low * high)
        if noise_growth(system, rest, make_method(method), middle, steps) > GROWTH:
            high = middle
        else:
            low = middle
    return row | {"measured": math.sqrt(low * high)}


def measure_growth(method: str, times: float) -> dict:
    """Return the growth of noise on a taut sheet at a multiple of the explicit limit."""
    system, rest = sheet(0.1, 1000.0, 0.0)
    dt = times * fc.critical_dt(system, rest, "central_difference")
    return {"dt": dt, "growth": noise_growth(system, rest, make_method(method), dt, 80)}


def catalogue() -> list[Path]:
    """List the scenes of the failure catalogue."""
    return sorted((Path(__file__).parents[1] / "scenes" / "failures").glob("*.toml"))
