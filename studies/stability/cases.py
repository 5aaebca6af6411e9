"""The cases of stability.py: what a run comes to, and what is foretold of it."""

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
from fecloth.scene.problem import Built
from fecloth.scene.scene import load

ALL = {**METHODS, **EXPLICIT}
STABLE, WRONG, NEWTON, BLOWN = "stable", "stable but wrong", "Newton failed", "blew up"
ENERGY = 0.05  # made from nothing, of the energy that moved
ERROR = 0.1  # of the motion
KEYS = ("path", "content", "stiffness", "h", "damping")  # of a scene in the settings of a case
PARTS = 4  # of the time, at whose ends a run is held against the reference
DENSE = 2000  # free directions up to which all eigenvalues are asked for
MOST = 8000  # steps of an explicit reference, and of one by BDF2 a quarter of that
SHEET, TAUT, TINY = 0.5, 1.05, 1e-7  # m; stretch; m, so small that the motion is linear
GROWTH = 1.0  # of the log of noise: what is more than that grows
EXACT = fc.Newton(1e-12)


def outcome(why: str, made: float, error: float) -> str:
    """The class of a run.

    Parameters
    ----------
    why
        How it failed in `StepFailed`'s words, "" if it reached its end.
    made
        Most energy that it had from nothing over the energy that has moved.
    error
        Largest distance from the reference at the quarters of the time, rms over the mass, over
        the reference's largest displacement; NaN where there is no reference.

    Examples
    --------
    >>> outcome("", 0.01, 0.02), outcome("", 0.01, 0.3), outcome("", 0.2, float("nan"))
    ('stable', 'stable but wrong', 'stable but wrong')
    >>> outcome("the cloth moves with 9 J ...: the method has made the rest", 3.0, 1.0)
    'blew up'
    """
    if why:
        grown = ("not finite", "is stretched to", "has made the rest")
        return BLOWN if any(words in why for words in grown) else NEWTON
    return WRONG if made > ENERGY or error > ERROR else STABLE


def method_of(name: str):
    """The method with its defaults; explicit ones take steps beyond their limit."""
    return ALL[name](beyond_limit=True) if name in EXPLICIT else ALL[name]()


# --- scenes ---------------------------------------------------------------------------------------


def digest(path: Path) -> str:
    """A hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]


@cache
def built(path: str, content: str, stiffness: float, h: float | None, damping: float | None):
    """A scene with its stiffness scaled, at another edge length h [m], with more damping [s].

    `content` is `digest` of the file, so that a change of it is another case.
    """
    given = load(path, [f"cloth.h={h}"] if h else []).build()
    whole = given.system
    terms = [_scaled(term, stiffness) for term in whole.terms]
    terms += [fc.StrainRateDamping(damping)] if damping else []
    fabric = _each(whole.fabric, lambda one: _scaled(one, stiffness))
    system = fc.System(given.cloth, fabric, terms, whole.pins, whole.mass_kind, whole.grain)
    start = system.state(given.state.x, given.state.v, given.state.t)
    return replace(given, system=system, state=start)


STIFF = ("tensile_stiffness", "shear_stiffness", "stiffness", "k")


def _scaled(record, factor: float):
    """A fabric or a term, its membrane stiffness times a factor; bending stays as it is."""
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
    """Largest tensile stiffness [N/m]."""
    fabrics = fabric.values() if isinstance(fabric, dict) else [fabric]
    return max(max(one.tensile) for one in fabrics)


def march(scene: Built, method, dt: float | None) -> tuple[list[np.ndarray], fc.march]:
    """The positions at the quarters of the time, and the run."""
    start, end = scene.state.t, scene.t_end
    times, found = np.linspace(start, end, PARTS + 1)[1:], []

    def look(info) -> None:
        study.check_time_limit()
        if info.t in times:
            found.append(info.result.state.x)

    run = (scene.system, method, scene.state, dt, end)
    options = {"solver": scene.linear, "newton": scene.newton, "report": look}
    result = fc.run(*run, stops=times, **options)
    return found, result


@cache
def reference(*key) -> list[np.ndarray] | None:
    """The quarters by short steps; None where even they fail.

    Central differences at 0.9 of their limit; BDF2 at 1/2000 of the time where that is not to be
    had (a consistent mass), or takes more than `MOST` steps.
    """
    scene = built(*key)
    time = scene.t_end - scene.state.t
    limit = fc.critical_dt(scene.system, scene.state, "central_difference")
    explicit = scene.system.mass_kind == "lumped" and time / limit < MOST
    method, dt = (fc.CentralDifference(), None) if explicit else (fc.BDF2(), time / (MOST // 4))
    try:
        return march(scene, method, dt)[0]
    except fc.StepFailed:
        return None


def cell(method: str, steps: int, **scene) -> dict:
    """One run of so many steps: its class, the energy it made, its error."""
    key = tuple(scene[name] for name in KEYS)
    scene = built(*key)
    row = {"dt": (scene.t_end - scene.state.t) / steps, "made": math.inf, "off": math.nan}
    try:
        found, result = march(scene, method_of(method), row["dt"])
    except fc.StepFailed as failure:
        why = str(failure).splitlines()[0]
        return row | {"outcome": outcome(why, 0.0, 0.0), "why": why}
    row |= {"made": made(result.energies), "off": apart(scene, found, reference(*key))}
    return row | {"outcome": outcome("", row["made"], row["off"]), "why": ""}


def made(energies: dict[str, np.ndarray]) -> float:
    """Most energy beyond what start, loads and pins gave, over the energy that has moved.

    What damping took is not counted as made: at large steps its sum over the steps is too much.
    """
    terms = [c for name, c in energies.items() if ":" not in name and name not in SUMS]
    given = energies["pins"] + sum(c for name, c in energies.items() if name.startswith("work:"))
    gain = energies["total"] - energies["total"][0] - given
    moved = abs(given) + sum(abs(c - c[0]) for c in terms)
    return max(0.0, float(gain.max() / max(moved.max(), 1e-300)))


SUMS = ("pins", "numerical", "total", "remainder")


def apart(scene: Built, found: list[np.ndarray], exact: list[np.ndarray] | None) -> float:
    """Largest rms distance at the quarters over the reference's largest displacement."""
    if exact is None:
        return math.nan
    share = scene.system.nodal_mass / scene.system.nodal_mass.sum()

    def rms(u: np.ndarray) -> float:
        return math.sqrt(share @ np.sum(u**2, axis=1))

    moved = max(rms(x - scene.state.x) for x in exact)
    return max(rms(x - y) for x, y in zip(found, exact, strict=True)) / moved


def foretold(**scene) -> dict:
    """From the operators at the start [s]: limits, and where implicit matrices turn indefinite.

    The matrix wa M + wx K of a method does where wx λ² = wa, −λ² the least eigenvalue of M⁻¹K.
    """
    scene = built(*(scene[name] for name in KEYS))
    system, state = scene.system, scene.state
    found = {"time": scene.t_end - state.t, "Y": _stiffest(system.fabric)}
    for name in EXPLICIT:
        found[name] = fc.critical_dt(system, state, name)
        found[f"{name} by elements"] = fc.stability.element_bound(system, name)
    least = least_eigenvalue(system, state)
    for name in METHODS:
        wx, _, wa = method_of(name).weights(1.0)
        found[name] = math.sqrt(wa / (wx * -least)) if least < 0 else math.inf
    return {name: value if math.isfinite(value) else None for name, value in found.items()}


def least_eigenvalue(system: fc.System, state: fc.State) -> float:
    """The least eigenvalue of M⁻¹K over the free directions [1/s²]; 0 for one that is round-off.

    From all of them, as Lanczos' method does not tell a flat sheet's many zeros apart; NaN for a
    cloth of many nodes.
    """
    Z = system.admissible
    if Z.shape[1] > DENSE:
        return math.nan
    K, M = ((Z.T @ A @ Z).toarray() for A in (system.stiffness(state), system.mass))
    values = scipy.linalg.eigh((K + K.T) / 2, M, eigvals_only=True)
    return float(values[0]) if values[0] < -1e-6 * abs(values[-1]) else 0.0


# --- linear sheets --------------------------------------------------------------------------------


def sheet(h: float, Y: float, damping: float, drag: float = 0.0) -> tuple[fc.System, fc.State]:
    """A taut square with a held boundary, and it at rest, in equilibrium."""
    cloth = fc.Cloth.rectangle(SHEET, SHEET, h, "right")
    terms = [fc.StVK()] + ([fc.StrainRateDamping(damping)] if damping else [])
    terms += [fc.MassDamping(drag)] if drag else []
    system = fc.System(cloth, fc.Fabric(0.2, Y, 0.3), terms, pins=["boundary"])
    return system, system.state(TAUT * system.rest().x)


def grows(system: fc.System, rest: fc.State, method, dt: float, steps: int) -> float:
    """The log of the growth of noise over the last three quarters of so many steps."""
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


def boundary(method: str, h: float, Y: float, damping: float, drag: float = 0.0) -> dict:
    """The foretold limit of a taut sheet, and the dt beyond which noise does grow, to 1 %."""
    system, rest = sheet(h, Y, damping, drag)
    limit = fc.critical_dt(system, rest, method)
    row = {"foretold": limit, "by elements": fc.stability.element_bound(system, method)}
    if limit == 0:
        dt = 0.2 * fc.critical_dt(system, rest, "central_difference")
        return row | {"growth": grows(system, rest, method_of(method), dt, 2000)}
    low, high = 0.5 * limit, 2.0 * limit
    steps = 2000 if method != "forward_euler" else 8000  # it grows slowly, close to its limit
    while high / low > 1.01:
        middle = math.sqrt(low * high)
        if grows(system, rest, method_of(method), middle, steps) > GROWTH:
            high = middle
        else:
            low = middle
    return row | {"measured": math.sqrt(low * high)}


def unbounded(method: str, times: float) -> dict:
    """An A-stable method on a taut sheet at so many times the explicit limit: its growth."""
    system, rest = sheet(0.1, 1000.0, 0.0)
    dt = times * fc.critical_dt(system, rest, "central_difference")
    return {"dt": dt, "growth": grows(system, rest, method_of(method), dt, 80)}


def catalogue() -> list[Path]:
    """The scenes of the failure catalogue."""
    return sorted((Path(__file__).parents[1] / "scenes" / "failures").glob("*.toml"))
