"""Problems of contact with a known answer, as functions of h, dt and the gap for `converge`.

Each `Known` has a function that returns cloth, system, method and start, the figure that is
asked for, and its exact value: a closed form, or the solution of a boundary-value problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import fecloth as fc

UP = (0, 0, 1)
FLOOR = fc.shapes.Plane((0, 0, 0), UP)


GAP = 2.5e-4  # m


@dataclass(frozen=True)
class Known:
    """A problem with a known answer: its first h and dt, and its end in time if it moves.

    While dt is refined, the mesh is the one of `fine` [m], or else of h.
    """

    name: str
    problem: Callable
    quantity: str | Callable
    exact: float
    h: float
    dt: float | None = None
    t_end: float | None = None
    gap: float = GAP  # the smallest
    fine: float | None = None


# --- a sheet that bounces, and one that slides to rest -------------------------------------------

BOUNCE, MU, SPEED, FALL = 0.5, 0.4, 0.5, 5e-3  # restitution, friction, speed of the slide, height


def thrown(h: float, dt: float, gap: float = GAP):
    """A sheet without weight is thrown at a plane at 1 m/s."""
    return sheet(h, gap, 0.0113, [0, 0, -1.0], [fc.Obstacle(FLOOR, gap, restitution=BOUNCE)])


def sliding(h: float, dt: float, gap: float = GAP):
    """A sheet falls on a plane while it moves along at `SPEED`, and slides to rest."""
    terms = [fc.Gravity(), fc.Obstacle(FLOOR, gap, friction=MU)]
    return sheet(h, gap, FALL, [SPEED, 0, 0], terms)


def sheet(h: float, gap: float, height: float, velocity, terms):
    cloth = fc.Cloth.rectangle(0.1, 0.1, h)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK(), *terms])
    x = np.column_stack([cloth.X, np.full(len(cloth.X), height + gap)])
    return cloth, system, fc.BDF2(), system.state(x, 0 * x + velocity)


def mean_speed(result) -> float:
    """The speed [m/s] at which the sheet leaves the plane."""
    return float(result.state.v[:, 2].mean())


def way_to_rest() -> float:
    """Way [m] of the sheet: its flight, and its slide after an impact that takes μ v (Coulomb)."""
    down = math.sqrt(2 * 9.81 * FALL)
    return SPEED * down / 9.81 + (SPEED - MU * down) ** 2 / (2 * MU * 9.81)


# --- a strip that is pulled over a cylinder: the capstan equation ---------------------------------

RADIUS, WEIGHT, FREE = 0.05, 0.02, 0.08  # of the cylinder [m], at one end [N], beside it [m]
SLIP = 0.3  # friction


def capstan(h: float, dt: float, gap: float = GAP, mu=SLIP, angle=math.pi / 2, speed=0.1):
    """A strip is wrapped round a cylinder by `angle`, with a weight at one end, and pulled.

    It slides at `speed` [m/s], and has no weight and no stiffness in bending. Without inertia the
    ratio of the forces is e^(μ θ), the capstan equation (Euler and Eytelwein). So it is light: a
    node that leaves the cylinder stops at the end of each step, as impulses give nothing back, and
    that takes a force of mass × speed/dt.
    """
    radius = RADIUS + gap
    cloth = fc.Cloth.rectangle(2 * FREE + radius * angle, 0.01, h, pattern="right")
    along = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    cylinder = fc.shapes.Cylinder((0, 0, 0), (0, 1, 0), RADIUS)
    fabric = fc.Fabric(areal_density=0.005, tensile_stiffness=5e3, poisson_ratio=0.0)
    terms = [
        fc.StVK(),
        fc.StrainRateDamping(time=2e-3),
        fc.PointForce("left", (-WEIGHT, 0, 0)),
        fc.Obstacle(cylinder, gap, friction=mu),
    ]
    formulas = [f"{speed * float(part)!r}*t" for part in along]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin("right", motion=formulas)])
    s = cloth.X[:, 0] - FREE
    on = np.clip(s / radius, 0, angle)
    before, after = np.minimum(s, 0), np.maximum(s - radius * angle, 0)
    x = before + radius * np.sin(on) + after * along[0]
    z = radius * np.cos(on) + after * along[2]
    v = 0.1 * np.column_stack([np.cos(on), 0 * on, -np.sin(on)])
    return (
        cloth,
        system,
        fc.BackwardEuler(),
        system.state(np.column_stack([x, cloth.X[:, 1], z]), v),
    )


PASSAGE = 0.1  # s, in which the strip slides by the first h: a whole number of nodes pass


def pulled(result) -> float:
    """The mean force on the pulled end over the weight, while the last nodes pass (90 degrees)."""
    force = -np.array(result.observed["reaction:right.z"])
    times = np.linspace(result.times[-1] - PASSAGE, result.times[-1], 1001)
    return float(np.interp(times, result.times, force).mean() / WEIGHT)


def capstan_at_rest(mu: float, angle: float, h: float = 0.01, load_steps: int = 10) -> float:
    """The ratio of the same strip in equilibria, while its end is pulled by 20 mm in load steps."""
    cloth, system, _, start = capstan(h, 0.0, 5e-4, mu, angle, speed=0.02)
    end = fc.equilibrium(system, start, load_steps=load_steps)
    f = np.zeros_like(end.x)
    system.bound[0].add_force(end.x, end.v, end.t, f)
    along = [math.cos(angle), 0.0, -math.sin(angle)]
    return float(-f[cloth.nodes("right")].sum(axis=0) @ along / WEIGHT)


# --- a heavy strip, lifted at one end: an elastica that leaves a plane ----------------------------

B, HEAVY, LENGTH, WIDTH, HEIGHT = 1e-4, 0.2 * 9.81, 0.4, 0.04, 0.03  # N m, N/m², m


def lifted(h: float, gap: float = GAP, height: float = HEIGHT):
    """One end of a strip that lies on a plane is lifted, and is free to turn and to move along."""
    cloth = fc.Cloth.rectangle(LENGTH, WIDTH, h)
    pins = [fc.Slide("left", direction=UP), fc.Slide("right", normal=UP, name="lift")]
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), fc.Obstacle(FLOOR, gap)]
    system = fc.System(cloth, fc.Fabric(0.2, 3000.0, 0.0, bending_rigidity=B), terms, pins)
    away = (24 * B * height / HEAVY) ** 0.25  # of a small slope, where it leaves the plane
    part = np.clip((cloth.X[:, 0] - LENGTH + away) / away, 0, 1)
    z = gap + (height - gap) * (2 * part**3 - part**4)
    return cloth, system, None, system.state(np.column_stack([cloth.X, z]))


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


# --- a stretched drum on a ball -------------------------------------------------------------------

RIM, STRETCH, PUSHED, BALL = 0.1, 1.1, 0.01, 0.3  # radius, stretch, way and radius of the ball [m]
Y, NU = 1000.0, 0.3


def drum(h: float, gap: float = 0.1 * GAP):
    """A ball is pushed from below into the middle of a stretched round membrane."""
    cloth = fc.Cloth.disk(RIM / STRETCH, h)
    ball = fc.Obstacle(fc.shapes.Sphere((0, 0, PUSHED - BALL), BALL), gap, stiffness=1e4)
    system = fc.System(cloth, fc.Fabric(0.1, Y, NU), [fc.StVK(), ball], ["boundary"])
    flat = STRETCH * cloth.X
    z = (PUSHED + gap + 5e-4) * (1 - (flat**2).sum(axis=1) / RIM**2)
    z[cloth.nodes("boundary")] = 0.0
    return cloth, system, None, system.state(np.column_stack([flat, z]))


def force_on_ball() -> float:
    """Force [N] that pushes the ball: a membrane of revolution of StVK without friction.

    At the reference radius s are the radius ρ, height z, stretch λ along the meridian and its
    slope θ downwards: ρ′ = λ cos θ, z′ = −λ sin θ, (s P)′ = Q cos θ with the nominal stresses P
    along and Q around. Free, s P θ′ = −Q sin θ; on the ball θ′ = λ/R. Unknown are λ(0) and where
    the ball is left; known are ρ and z at the rim. The force is 2π s P sin θ.
    """
    edge, C = RIM / STRETCH, Y / (1 - NU**2)

    def slopes(s, y, on_ball):
        rho, _, a, theta = y
        b = rho / s  # the stretch around
        P = a * C * 0.5 * (a**2 - 1 + NU * (b**2 - 1))
        Q = b * C * 0.5 * (b**2 - 1 + NU * (a**2 - 1))
        by_a = C * (0.5 * (a**2 - 1 + NU * (b**2 - 1)) + a**2)  # ∂P/∂λ
        by_b = C * NU * a * b
        along, down = math.cos(theta), math.sin(theta)
        grows = (Q * along - P - by_b * (a * along - b)) / (s * by_a)
        turns = a / BALL if on_ball else -Q * down / (s * P)
        return [a * along, -a * down, grows, turns], 2 * math.pi * s * P * down

    def shoot(unknown):
        middle, leaves = unknown
        near = 1e-4 * edge
        y = [middle * near, PUSHED, middle, middle * near / BALL]
        for begin, end, on_ball in ((near, leaves * edge, True), (leaves * edge, edge, False)):
            way = solve_ivp(
                lambda s, y, on_ball=on_ball: slopes(s, y, on_ball)[0],
                (begin, end),
                y,
                rtol=1e-9,
                atol=1e-12,
            )
            y = way.y[:, -1]
        return y

    def misses(unknown):
        y = shoot(unknown)
        return [y[0] / RIM - 1, y[1] / PUSHED]

    solved = fsolve(misses, [STRETCH, 0.5], xtol=1e-10)
    return float(slopes(edge, shoot(solved), False)[1])


# --- a stretched drum, blown against a held sheet -------------------------------------------------


def drum_on_sheet(h: float, gap: float) -> tuple[float, float]:
    """Contact radius [m] of a stretched round membrane under pressure, computed and closed form.

    It is kept from a held sheet of another mesh by SelfContact. The sheet carries the pressure
    where it is touched, so that the radius follows from the force. The closed form is for small
    slopes: the drum stretches by another 0.2 ‰ as it is blown up, which takes about 0.2 % from
    the radius. The height at which the drum touches is the height of its nodes, weighted by the
    force on them.
    """
    height, pressure = 1.5e-3, 120.0
    pieces = fc.Cloth.disk(RIM / STRETCH, h), fc.Cloth.disk(0.4 * RIM, 1.1 * h)
    cloth = fc.Cloth.join(pieces, names=["drum", "sheet"])
    fabric = fc.Fabric(0.1, Y, NU)
    terms = [fc.StVK(), fc.Pressure(pressure), fc.SelfContact(gap=gap, stiffness=1e4)]
    system = fc.System(cloth, fabric, terms, pins=["drum/boundary", "sheet"])
    on = np.isin(np.arange(len(cloth.X)), cloth.nodes("drum"))
    flat = np.column_stack([cloth.X, np.full(len(cloth.X), height + gap)])
    x = np.where(on[:, None], flat * [STRETCH, STRETCH, 0.0], flat)
    state = fc.equilibrium(system, system.state(x), tolerance=1e-8)
    f = system.bound[-1].push(state.x, 0.0)[on, 2]
    at = float(f @ state.x[on, 2] / f.sum())
    tension = Y / (1 - NU) * 0.5 * (STRETCH**2 - 1)  # P = λ S, over λ
    return math.sqrt(-f.sum() / (math.pi * pressure)), contact_radius(RIM, tension, pressure, at)


def contact_radius(radius: float, tension: float, pressure: float, height: float) -> float:
    """c with T (w″ + w′/r) = −p on c < r < radius, w(radius) = 0, w(c) = height, w′(c) = 0."""

    def gap(c):
        free = pressure / (4 * tension) * (radius**2 - c**2)
        return free + pressure * c**2 / (2 * tension) * math.log(c / radius) - height

    return float(brentq(gap, 1e-6 * radius, radius))


def known_answers() -> list[Known]:
    """All problems that are refined."""
    ratio, lift = math.exp(SLIP * math.pi / 2), elastica(B, HEAVY, HEIGHT) * WIDTH
    return [
        Known("speed after a bounce [m/s]", thrown, mean_speed, BOUNCE, 0.05, 4e-3, 0.04),
        Known("way to rest [m]", sliding, "mean_displacement.x", way_to_rest(), 0.05, 4e-3, 0.16),
        Known("capstan: ratio of forces", capstan, pulled, ratio, 0.01, 4e-3, 0.25, fine=0.0025),
        Known("heavy strip: force that lifts [N]", lifted, "reaction.lift.z", lift, 0.02),
        Known(
            "drum: force of a ball [N]",
            drum,
            "reaction.Obstacle.z",
            force_on_ball(),
            0.02,
            gap=0.1 * GAP,
        ),
    ]
