"""Problems with known solutions: functions of h and dt for `fc.study.converge`, and exact values.

Membranes, plates, drums, strips of elastica, pressure, pendulums and waves. The exact values are
closed forms, series, or solutions of ordinary differential equations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import jn_zeros

import fecloth as fc
from studies.references import closed_forms, time_problems
from studies.references.elastica import heavy_elastica

STRIP = {"length": 1.0, "tensile_stiffness": 20.0, "areal_density": 0.2}
Y, DENSITY, NU, STRETCH = 100.0, 0.2, 0.3, 1.1
TENSION = (
    Y / (1 - NU) * (STRETCH**2 - 1) / 2
)  # second Piola-Kirchhoff, of the sheet stretched both ways
STRING = Y * (STRETCH**2 - 1) / 2  # of a sheet with ν = 0 that is stretched along X only
RIGIDITY, GAMMA = 1.0, 10.0  # of plates [N m]; of the elastica ρ g L³/B
LOAD = 1.0  # Pa on a strip between two edges


@dataclass(frozen=True)
class Known:
    """A problem, the arguments of `converge`, and the exact value of the quantity."""

    name: str
    function: Callable
    quantity: str
    exact: float
    arguments: dict = field(default_factory=dict)


def make_rectangle(h, pattern, element, width=1.0, height=1.0):
    return fc.Cloth.rectangle(width, height, h, pattern, element)


def make_system(cloth, *parts, **options):
    """Return the system with the mass that its element needs."""
    mass = "lumped" if cloth.element == "P1" else "consistent"
    return fc.System(cloth, *parts, mass=mass, **options)


# --- statics --------------------------------------------------------------------------------------


def hanging_strip(h, pattern, element):
    """A strip that hangs under its own weight."""
    cloth = make_rectangle(h, pattern, element, 1.0, 0.5)
    fabric = fc.Fabric(STRIP["areal_density"], STRIP["tensile_stiffness"])
    system = make_system(cloth, fabric, [fc.StVK(), fc.Gravity((9.81, 0, 0))], ["left"])
    return cloth, system, None, system.rest()


def taut_square(h, pattern, element):
    """A taut square membrane under its small weight."""
    cloth = make_rectangle(h, pattern, element)
    fabric = fc.Fabric(DENSITY, Y, NU)
    system = make_system(cloth, fabric, [fc.StVK(), fc.Gravity((0, 0, -1e-3))], ["boundary"])
    return cloth, system, None, system.state(system.rest().x * [STRETCH, STRETCH, 1])


def plate(h, pattern, element):
    """A square plate, supported on its border, under its small weight."""
    cloth = make_rectangle(h, pattern, element)
    fabric = fc.Fabric(DENSITY, 1.0, NU, bending_rigidity=RIGIDITY)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -0.1))]
    system = make_system(cloth, fabric, terms, ["boundary"])
    return cloth, system, None, system.rest()


def cantilever(h, pattern, element):
    """A strip that is clamped level and bends under its weight: the heavy elastica."""
    cloth = make_rectangle(h, pattern, element, 1.0, 0.25)
    rigidity = DENSITY * 9.81 / GAMMA
    fabric = fc.Fabric(DENSITY, 1e5, bending_rigidity=rigidity)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = make_system(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    x, y = cloth.X.T
    return cloth, system, None, system.state(np.column_stack([x, y, -0.1 * x**2]))


def blown_strip(h, pattern, element):
    """A strip between two fixed edges under a pressure: an arc of a circle."""
    cloth = make_rectangle(h, pattern, element, 1.0, 0.5)
    system = make_system(
        cloth, fc.Fabric(DENSITY, Y), [fc.StVK(), fc.Pressure(LOAD)], ["left", "right"]
    )
    x, y = cloth.X.T
    return cloth, system, None, system.state(np.column_stack([x, y, 0.1 * np.sin(np.pi * x)]))


@cache
def arc_height() -> float:
    """Return the height of the arc: N = p r with N = λ S and λ = r 2φ/L, r sin φ = L/2."""

    def mismatch(angle):
        radius = 0.5 / np.sin(angle)
        stretch = 2 * radius * angle
        return Y * stretch * (stretch**2 - 1) / 2 - LOAD * radius

    angle = brentq(mismatch, 1e-3, 1.5, xtol=1e-14)
    return 0.5 / np.sin(angle) * (1 - np.cos(angle))


@cache
def sine_series(power: int) -> float:
    """Return 16/π² Σ sin(mπ/2) sin(nπ/2)/(m n (π² (m² + n²))^power) over odd m, n: the middle."""
    odd = np.arange(1, 4001, 2)
    sign = np.where(odd % 4 == 1, 1.0, -1.0) / odd
    total = sum(
        s * float(np.sum(sign / (np.pi**2 * (m**2 + odd**2)) ** power))
        for m, s in zip(odd, sign, strict=True)
    )
    return 16 / np.pi**2 * total


# --- frequencies ----------------------------------------------------------------------------------


def square_drum(h, pattern, element):
    cloth = make_rectangle(h, pattern, element)
    return make_drum(cloth)


def round_drum(h, element):
    return make_drum(fc.Cloth.disk(1.0, h, element))


def make_drum(cloth):
    system = make_system(cloth, fc.Fabric(DENSITY, Y, NU), [fc.StVK()], ["boundary"])
    return cloth, system, None, system.state(system.rest().x * [STRETCH, STRETCH, 1])


def string(h, dt, pattern, element, method):
    """A strip, taut along X, that swings in its lowest mode with a small amplitude."""
    cloth = make_rectangle(h, pattern, element, 1.0, 0.25)
    system = make_system(cloth, fc.Fabric(DENSITY, Y), [fc.StVK()], ["left", "right"])
    v = np.column_stack([0 * cloth.X, 1e-3 * np.sin(np.pi * cloth.X[:, 0])])
    start = system.state(system.rest().x * [STRETCH, 1, 1], v)
    return cloth, system, time_problems.CASES[method], start


# --- time -----------------------------------------------------------------------------------------


def pendulum(dt, method):
    task = time_problems.pendulum()
    return task.system.cloth, task.system, time_problems.CASES[method], task.start


def wave(dt, method):
    task = time_problems.wave()
    return task.system.cloth, task.system, time_problems.CASES[method], task.start


# --- the catalogue --------------------------------------------------------------------------------


def statics() -> list[Known]:
    """Return the problems without time, and the frequencies."""
    tip, mean = closed_forms.hanging_strip_tip(**STRIP), closed_forms.hanging_strip_mean(**STRIP)
    at, weights = np.polynomial.legendre.leggauss(40)
    e = closed_forms.hanging_strip_strain((1 + at) / 2, **STRIP)
    energy = 0.5 * weights / 2 @ (STRIP["tensile_stiffness"] / 8 * ((1 + e) ** 2 - 1) ** 2)
    sag = DENSITY * 1e-3 / TENSION * sine_series(1)
    bend = DENSITY * 0.1 / RIGIDITY * sine_series(2)
    _, reach, drop = heavy_elastica(GAMMA)
    speed = np.sqrt(TENSION / DENSITY)
    edge, middle = [fc.Probe("tip", "right")], [fc.Probe("middle", point=(0.5, 0.5))]
    crown = [fc.Probe("crown", point=(0.5, 0.25))]
    strip = {"probes": edge}
    return [
        known("hanging strip", hanging_strip, "tip.x", 1 + tip, "cross", "P1", **strip),
        known("hanging strip", hanging_strip, "tip.x", 1 + tip, "unstructured", "P2", **strip),
        known("hanging strip", hanging_strip, "mean_displacement.x", mean, "equilateral", "P1"),
        known("hanging strip", hanging_strip, "energy.StVK", energy, "right", "P2"),
        known("taut square", taut_square, "middle.z", -sag, "unstructured", "P1", probes=middle),
        known("taut square", taut_square, "sag", sag, "right", "P2"),
        known("plate", plate, "middle.z", -bend, "unstructured", "P1", probes=middle),
        known("plate", plate, "middle.z", -bend, "cross", "P2", probes=middle),
        known("elastica", cantilever, "tip.z", -drop[-1], "unstructured", "P1", **strip),
        known("elastica", cantilever, "tip.x", reach[-1], "equilateral", "P2", **strip),
        known("pressure", blown_strip, "crown.z", arc_height(), "cross", "P1", probes=crown),
        known("pressure", blown_strip, "crown.z", arc_height(), "right", "P2", probes=crown),
        known("square drum", square_drum, "frequency(1)", speed / np.sqrt(2), "right", "P1"),
        known("square drum", square_drum, "frequency(1)", speed / np.sqrt(2), "unstructured", "P2"),
        known(
            "square drum", square_drum, "frequency(2)", speed * np.sqrt(5) / 2, "equilateral", "P1"
        ),
        Known(
            "round drum, P1",
            round_drum,
            "frequency(1)",
            speed * jn_zeros(0, 1)[0] / (2 * np.pi),
            {"h": 0.4, "element": "P1", "ratio": 1.6},
        ),
    ]


def known(name, function, quantity, exact, pattern, element, **more) -> Known:
    """Return a problem that is refined in h from 0.25 m, by 2 or on unstructured meshes by 1.6."""
    ratio = 1.6 if pattern == "unstructured" else 2.0
    settings = {"h": 0.25, "pattern": pattern, "element": element, "ratio": ratio, **more}
    return Known(f"{name}, {pattern}, {element}", function, quantity, float(exact), settings)


def motions() -> list[Known]:
    """Return the problems in time: every method on two, and two that refine h and dt."""
    found, task, chain = [], time_problems.pendulum(), time_problems.wave()
    bob, node = [fc.Probe("bob", [2])], int(np.argmin(np.abs(chain.system.cloth.X[:, 0] - 0.375)))
    probe = [fc.Probe("node", [node])]
    for method in time_problems.CASES:
        for name, function, problem, quantity, probes in (
            ("pendulum", pendulum, task, "bob.z", bob),
            ("wave", wave, chain, "node.x", probe),
        ):
            exact = problem.x[2, 2] if name == "pendulum" else problem.x[node, 0]
            steps = 200 if method == "forward_euler" else 50  # stable from the first level on
            run = {"dt": problem.t_end / steps, "t_end": problem.t_end, "refine": "dt"}
            settings = {**run, "probes": probes, "method": method}
            found.append(Known(f"{name}, {method}", function, quantity, float(exact), settings))
    period = 2 / np.sqrt(STRING / DENSITY)
    for pattern, element, method in (
        ("right", "P1", "central_difference"),
        ("cross", "P1", "bdf2"),
    ):
        run = {"h": 0.125, "dt": period / 120, "t_end": 2.2 * period, "refine": "both"}
        run |= {"probes": [fc.Probe("m", point=(0.5, 0.125))]}
        run |= {"pattern": pattern, "element": element, "method": method, "levels": 3}
        name = f"string, {pattern}, {element}, {method}"
        found.append(Known(name, string, "period of m.z", period, run))
    return found
