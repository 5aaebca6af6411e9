"""Problems of contact with a known answer: a rope on a bollard, a lifted sheet, a drum on a plate.

Each function builds a problem, solves it, and returns its figure beside the closed form or the
solution of its boundary-value problem.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import fecloth as fc

UP = (0, 0, 1)
RADIUS, CYLINDER_GAP, WEIGHT = 0.05, 5e-4, 0.02  # of the capstan [m, m, N]


# --- a strip that is pulled over a cylinder: the capstan equation ---------------------------------


def capstan(mu: float, angle: float, h: float = 0.01, dt: float = 2e-3, method=None) -> float:
    """T₂/T₁ of a strip that slides over a cylinder, wrapped round it by `angle` [rad].

    A weight hangs at one end; the other end is pulled at 0.1 m/s. The strip has no weight and no
    stiffness in bending. Without inertia the ratio is e^(μ θ), the capstan equation (Euler and
    Eytelwein).
    """
    speed, free = 0.1, 0.08
    system, start, along = strip_on_cylinder(mu, angle, h, speed, free)
    way = tangents(system.cloth, free, RADIUS + CYLINDER_GAP, angle)
    moving = system.state(start.x, speed * way)
    run = fc.run(system, method or fc.BackwardEuler(), moving, dt, 0.25)
    pulled = np.array([run.observed[f"reaction:right.{c}"] for c in "xyz"]).T @ along
    return float(pulled[-len(pulled) // 4 :].mean() / WEIGHT)


def capstan_at_rest(mu: float, angle: float, h: float = 0.01, load_steps: int = 10) -> float:
    """T₂/T₁ of the same strip in equilibria, while its end is pulled by 20 mm in load steps."""
    system, start, along = strip_on_cylinder(mu, angle, h, 0.02)
    end = fc.equilibrium(system, start, load_steps=load_steps)
    f = np.zeros_like(end.x)
    system.bound[0].add_force(end.x, end.v, end.t, f)
    return float(-f[system.cloth.nodes("right")].sum(axis=0) @ along / WEIGHT)


def strip_on_cylinder(mu: float, angle: float, h: float, speed: float, free: float = 0.08):
    """The system, its start, and the direction (3,) in which its end is pulled."""
    radius, width = RADIUS + CYLINDER_GAP, 0.01
    cloth = fc.Cloth.rectangle(2 * free + radius * angle, width, h, pattern="right")
    along = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    cylinder = fc.shapes.Cylinder((0, 0, 0), (0, 1, 0), RADIUS)
    fabric = fc.Fabric(areal_density=0.05, tensile_stiffness=5e3, poisson_ratio=0.0)
    terms = [
        fc.StVK(),
        fc.StrainRateDamping(time=2e-3),
        fc.PointForce("left", (-WEIGHT, 0, 0)),
        fc.Obstacle(cylinder, gap=CYLINDER_GAP, friction=mu),
    ]
    formulas = [f"{speed * float(part)!r}*t" for part in along]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin("right", motion=formulas)])
    return system, system.state(wrapped(cloth, radius, free, angle)), along


def wrapped(cloth: fc.Cloth, radius: float, free: float, angle: float) -> np.ndarray:
    """Positions of a strip: straight, round an arc from the top on, straight again.

    It leads along −x at its left end, over the top of the cylinder, and bends down.
    """
    s = cloth.X[:, 0] - free
    on = np.clip(s / radius, 0, angle)
    before, after = np.minimum(s, 0), np.maximum(s - radius * angle, 0)
    x = before + radius * np.sin(on) + after * np.cos(angle)
    z = radius * np.cos(on) - after * np.sin(angle)
    return np.column_stack([x, cloth.X[:, 1], z])


def tangents(cloth: fc.Cloth, free: float, radius: float, angle: float) -> np.ndarray:
    """(n, 3) directions of the strip at its nodes."""
    on = np.clip((cloth.X[:, 0] - free) / radius, 0, angle)
    return np.column_stack([np.cos(on), np.zeros(len(on)), -np.sin(on)])


# --- a heavy strip, lifted at one end: an elastica that leaves a plane ----------------------------


def lifted(h: float, gap: float, height: float = 0.03, element: str = "P1") -> tuple[float, float]:
    """Force [N/m] that holds the lifted end of a heavy strip, computed and by its elastica."""
    length, width, B, weight = 0.4, 0.04, 1e-4, 0.2 * 9.81
    cloth = fc.Cloth.rectangle(length, width, h, element=element)
    fabric = fc.Fabric(0.2, 3000.0, 0.0, bending_rigidity=B)
    plane = fc.Obstacle(fc.shapes.Plane((0, 0, 0), UP), gap=gap)
    pins = [fc.Slide("left", direction=UP), fc.Slide("right", normal=UP, name="lift")]
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), plane]
    system = fc.System(cloth, fabric, terms, pins)
    away = (24 * B * height / weight) ** 0.25  # of a small slope, where it leaves the plane
    part = np.clip((cloth.X[:, 0] - length + away) / away, 0, 1)
    z = gap + height * (2 * part**3 - part**4)
    state = fc.equilibrium(system, system.state(np.column_stack([cloth.X, z])), tolerance=1e-8)
    f = -system.force(state)[cloth.nodes("right"), 2].sum() / width
    carried = system.bound[-1].mean_distance(state.x, 0.0)
    return float(f), elastica(B, weight, gap + height - carried)


def elastica(B: float, weight: float, height: float) -> float:
    """Force [N/m] at the lifted end of an inextensible heavy strip on a rigid plane.

    B θ″ = −(F − w (l − s)) cos θ on 0 ≤ s ≤ l with θ = θ′ = 0 where it leaves the plane, θ′ = 0 at
    the end, and ∫ sin θ ds = `height`; l and F are unknown. The end is free to move along.
    """

    def ends(unknown):
        length, force = unknown

        def slope(s, y):
            return [y[1], -(force - weight * (length - s)) * math.cos(y[0]) / B, math.sin(y[0])]

        y = solve_ivp(slope, (0, length), [0.0, 0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
        return [y[1] * length, y[2] / height - 1]

    length = (24 * B * height / weight) ** 0.25
    return float(fsolve(ends, [length, weight * length / 2], xtol=1e-10)[1])


# --- a stretched drum, blown against a plate ------------------------------------------------------


def drum(h: float, gap: float, element: str = "P1") -> tuple[float, float]:
    """Contact radius [m] of a stretched round membrane under pressure, computed and closed form.

    The plate carries the pressure where it touches, so that the radius follows from the reaction.
    """
    radius, stretch, height, pressure = 0.1, 1.1, 1.5e-3, 120.0
    cloth = fc.Cloth.disk(radius / stretch, h, element=element)
    fabric = fc.Fabric(0.1, 1000.0, 0.3)
    plate = fc.Obstacle(fc.shapes.Plane((0, 0, height + gap), (0, 0, -1)), gap=gap, stiffness=1e4)
    terms = [fc.StVK(), fc.Pressure(pressure), plate]
    system = fc.System(cloth, fabric, terms, pins=["boundary"])
    x = np.column_stack([stretch * cloth.X, np.zeros(len(cloth.X))])
    state = fc.equilibrium(system, system.state(x), tolerance=1e-9)
    f = np.zeros_like(state.x)
    system.bound[-1].add_force(state.x, state.v, 0.0, f)
    tension = stretch_tension(fabric, stretch)
    at = height + gap - system.bound[-1].mean_distance(state.x, 0.0)
    return math.sqrt(-f[:, 2].sum() / (math.pi * pressure)), contact_radius(
        radius, tension, pressure, at
    )


def drum_on_sheet(h: float, gap: float) -> tuple[float, float]:
    """The same with a held sheet of another mesh in place of the plate, kept apart by SelfContact.

    The closed form is for small slopes: the drum stretches by another 0.2 ‰ as it is blown up,
    which takes about 0.2 % from the radius. The height at which the drum touches is the height of
    its nodes, weighted by the force on them.
    """
    radius, stretch, height, pressure = 0.1, 1.1, 1.5e-3, 120.0
    pieces = fc.Cloth.disk(radius / stretch, h), fc.Cloth.disk(0.4 * radius, 1.1 * h)
    cloth = fc.Cloth.join(pieces, names=["drum", "sheet"])
    fabric = fc.Fabric(0.1, 1000.0, 0.3)
    terms = [fc.StVK(), fc.Pressure(pressure), fc.SelfContact(gap=gap, stiffness=1e4)]
    system = fc.System(cloth, fabric, terms, pins=["drum/boundary", "sheet"])
    on = np.isin(np.arange(len(cloth.X)), cloth.nodes("drum"))
    flat = np.column_stack([cloth.X, np.full(len(cloth.X), height + gap)])
    x = np.where(on[:, None], flat * [stretch, stretch, 0.0], flat)
    state = fc.equilibrium(system, system.state(x), tolerance=1e-8)
    f = system.bound[-1].push(state.x, 0.0)[on, 2]
    at, tension = float(f @ state.x[on, 2] / f.sum()), stretch_tension(fabric, stretch)
    return math.sqrt(-f.sum() / (math.pi * pressure)), contact_radius(radius, tension, pressure, at)


def stretch_tension(fabric: fc.Fabric, stretch: float) -> float:
    """Force [N/m] of StVK across a line in space, of a sheet stretched alike in all directions."""
    strain = 0.5 * (stretch**2 - 1)
    return fabric.tensile[0] / (1 - fabric.poisson_ratio) * strain  # P = λ S, over λ


def contact_radius(radius: float, tension: float, pressure: float, height: float) -> float:
    """c with T (w″ + w′/r) = −p on c < r < radius, w(radius) = 0, w(c) = height, w′(c) = 0."""

    def gap(c):
        free = pressure / (4 * tension) * (radius**2 - c**2)
        return free + pressure * c**2 / (2 * tension) * math.log(c / radius) - height

    return float(brentq(gap, 1e-6 * radius, radius))
