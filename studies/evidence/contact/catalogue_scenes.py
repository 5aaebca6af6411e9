"""Scenes of the catalogue: kinds that a seed draws.

A scene is drawn in a frame whose z axis is up, and then turned by a random rotation W, together
with gravity: x = x′ W.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import fecloth as fc
from fecloth.mesh.surface import Surface
from studies.evidence.contact import catalogue_bodies as bodies
from studies.evidence.contact.catalogue_bodies import Body, Motion

BENT = [name for name in fc.Fabric.presets() if fc.Fabric.preset(name).bending]
CLEAR = 4e-3  # least distance at the start [m]
QUADRATIC = 0.25  # part of the scenes with P2 triangles
PLACES, TIMES = 15, 200  # on held edges and in a run, at which a body may not be
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Scene:
    """A cloth before it moves, and all that a run needs.

    Attributes
    ----------
    system, start, method, dt, t_end, newton
        The arguments of a run.
    bodies
        The obstacles, by formulas of their own.
    """

    system: fc.System
    start: fc.State
    method: Any
    dt: float
    t_end: float
    bodies: tuple[Body, ...]
    newton: fc.Newton | None = None


@dataclass(frozen=True)
class Sketch:
    """What a kind draws; positions and directions are in the frame whose z axis is up."""

    cloth: fc.Cloth
    x: np.ndarray  # (n, 3) at the start [m]
    bodies: Sequence[Body]
    v: np.ndarray = field(default_factory=lambda: np.zeros(3))  # (n, 3) or (3,) [m/s]
    pins: Sequence[str] = ()  # node sets that are held
    t_end: float = 0.1
    rises: bool = False  # whether the cloth is moved up until it is clear of the bodies
    gaps: float = 1.0  # mm


def draw(kind: str, seed: int, number: int) -> Scene:
    """The scene of a kind with this number, of a seed; drawn again if no cloth can be so."""
    rng = np.random.default_rng((seed, number, *kind.encode()))
    while True:
        scene = finish(KINDS[kind](rng), rng, number)
        if not meets_held_edges(scene):
            return scene


def meets_held_edges(scene: Scene) -> bool:
    """Whether a body enters an edge between two held nodes, which cannot give way."""
    triangles = Surface.from_cloth(scene.system.cloth).triangles
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends = scene.start.x[edges[np.isin(edges, scene.system.constraints.nodes).all(axis=1)]]
    parts = np.linspace(0, 1, PLACES)[:, None, None]
    places = ((1 - parts) * ends[:, 0] + parts * ends[:, 1]).reshape(-1, 3)
    bodies_with_depth = [body for body in scene.bodies if body.depth is not None]
    times = np.linspace(0, scene.t_end, TIMES)
    return bool(len(places)) and any(
        body.deep(places, t).max() > 0 for body in bodies_with_depth for t in times
    )


def finish(sketch: Sketch, rng: np.random.Generator, number: int) -> Scene:
    """The scene of a sketch, with what is drawn alike for all kinds."""
    W = draw_turn(rng)
    moved = [turned(body, W) for body in sketch.bodies]
    x = sketch.x @ W
    if sketch.rises:
        x = clear_of(x, sketch.cloth.triangles, moved, W[2])
    friction = float(rng.choice([0.0, 0.3, 0.6]))
    restitution = float(rng.choice([1.0, 1.0, 0.0, 0.5])) if all(map(is_wide, moved)) else 1.0
    gap = sketch.gaps * 1e-3
    contacts: list = [
        body.term(gap=gap, friction=friction, restitution=restitution) for body in moved
    ]
    contacts.insert(int(rng.integers(len(contacts) + 1)), fc.SelfContact(gap, friction=friction))
    inner = [fc.StVK(), fc.PlateBending(), fc.Gravity(tuple(-9.81 * W[2]))]
    if rng.random() < 0.5:
        inner.append(fc.StrainRateDamping(time=1e-3))
    fabric = fc.Fabric.preset(BENT[rng.integers(len(BENT))])
    system = fc.System(sketch.cloth, fabric, [*inner, *contacts], sketch.pins)
    v = np.zeros_like(x) + sketch.v @ W
    method = (fc.BackwardEuler(), fc.BDF2())[number % 2]
    dt = float(rng.choice([2e-3, 5e-3, 5e-3, 5e-3, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2]))
    newton = fc.Newton(tolerance=1e-6) if restitution < 1 else None
    given = system, system.state(x, v), method, dt, sketch.t_end, tuple(moved)
    return Scene(*given, newton)


def is_wide(body: Body) -> bool:
    return body.depth is not None and not len(body.lines)


def turned(body: Body, W: np.ndarray) -> Body:
    """The body in space; one whose term cannot be turned keeps its direction."""
    motion = replace(body.motion, way=body.motion.way @ W, axis=body.motion.axis @ W)
    return body.at(body.centre @ W, W.T @ body.Q, motion)


def clear_of(x, triangles, obstacles: Sequence[Body], up: np.ndarray) -> np.ndarray:
    """x, moved up so far that the cloth is about `CLEAR` above all bodies."""
    height = 1.0
    while True:
        points = inner_points(x + height * up, triangles)
        room = -max(body.deep(points, 0.0).max() for body in obstacles)
        if room < CLEAR + 1e-3:
            return x + height * up
        height -= room - CLEAR  # no point comes nearer to an obstacle than by its way


def inner_points(x: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(15 s, 3) points of all triangles: corners, and others between them."""
    i, j = np.array([(i, j) for i in range(5) for j in range(5 - i)]).T
    weights = np.column_stack([i, j, 4 - i - j]) / 4
    points: np.ndarray = np.einsum("pk,skc->spc", weights, x[triangles]).reshape(-1, 3)
    return points


# --- cloths ---------------------------------------------------------------------------------------


def edge(area: float, triangles: float) -> float:
    """The edge length [m] of this many triangles of equal sides."""
    return math.sqrt(4 * area / (math.sqrt(3) * triangles))


def draw_cloth(rng, extent: float, most: float = 100, element: str = "", round_too=True):
    """A square or a disk of this extent [m], with about `most` flat triangles, or half as many."""
    element = element or draw_element(rng)
    triangles = rng.uniform(0.6 * most, most) / (4 if element == "P2" else 1)
    if round_too and rng.random() < 0.5:
        h = min(edge(math.pi * extent**2 / 4, triangles), extent / 2)  # at most the radius
        return fc.Cloth.disk(extent / 2, h, element=element)
    return fc.Cloth.rectangle(extent, extent, edge(extent**2, triangles), element=element)


def draw_element(rng) -> str:
    return "P2" if rng.random() < QUADRATIC else "P1"


def flat(cloth: fc.Cloth, height: float = 0.0, piece: str = "") -> np.ndarray:
    """Positions in the plane, of a piece or of all, with their middle over the origin."""
    X = cloth.X[cloth.nodes(piece)] if piece else cloth.X
    middle = (X.min(axis=0) + X.max(axis=0)) / 2
    return np.column_stack([X - middle, np.full(len(X), height)])


def tilted(rng, x: np.ndarray, most: float = 0.7) -> np.ndarray:
    turn = bodies.turn_about(np.append(rng.standard_normal(2), 0.0), rng.uniform(0, most))
    return x @ turn


def draw_turn(rng) -> np.ndarray:
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def draw_wide(rng) -> Body:
    """A shape of 2 to 20 cm."""
    kind = rng.integers(7)
    body = (
        lambda: bodies.ball(rng.uniform(0.02, 0.1)),
        lambda: bodies.cylinder(rng.uniform(0.015, 0.06)),
        lambda: bodies.rod(rng.uniform(0.03, 0.1), rng.uniform(0.01, 0.05)),
        lambda: bodies.plate(rng.uniform(0.04, 0.1), rng.uniform(0.008, 0.04)),
        lambda: bodies.box(*rng.uniform(0.03, 0.2, 3)),
        lambda: bodies.ring(rng.uniform(0.05, 0.1), rng.uniform(0.02, 0.04)),
        bodies.plane,
    )[kind]()
    return body.at(np.zeros(3), np.eye(3) if kind == 6 else draw_turn(rng))


def draw_thin(rng) -> Body:
    """A needle, a rod of 1 mm, a thin box, a small coin, or a needle of triangles."""
    length, width = rng.uniform(0.04, 0.2), rng.uniform(1e-3, 2e-3)
    body = (
        lambda: bodies.rod(length / 2, width / 2),
        lambda: bodies.rod(length / 2, 5e-4),
        lambda: bodies.box(width, rng.uniform(1e-3, 2e-3), length),
        lambda: bodies.box(width, rng.uniform(0.02, 0.1), length),
        lambda: bodies.plate(rng.uniform(4e-3, 1e-2), 1e-3),
        lambda: bodies.spike(length / 2, width / 2),
    )[rng.integers(6)]()
    return body


# --- kinds ----------------------------------------------------------------------------------------


def sideways(rng, most: float = 0.5) -> np.ndarray:
    return rng.uniform(-most, most, 3)


def throw(rng) -> Sketch:
    """A cloth is thrown against an obstacle at 5 to 20 m/s."""
    cloth = draw_cloth(rng, rng.uniform(0.15, 0.35))
    x, v = tilted(rng, flat(cloth)), -rng.uniform(5.0, 20.0) * UP + sideways(rng)
    return Sketch(cloth, x, [draw_wide(rng)], v, rises=True)


HELD = ((), ("boundary",), ("left", "right"), ("left",))


def hold(rng, cloth: fc.Cloth) -> list[str]:
    """Pins at rest: none, the boundary, or one or two sides of a rectangle."""
    wanted = HELD[rng.integers(len(HELD))]
    return [name for name in wanted if name in cloth.node_sets]


def swing(rng, slowest: float, fastest: float, amplitude: float) -> Motion:
    """Up and down through the start, with this speed at first."""
    speed = rng.uniform(slowest, fastest)
    return Motion(amplitude * UP, float(speed / amplitude))


def projectile(rng) -> Sketch:
    """A body at 5 to 20 m/s hits a cloth, which may be held."""
    extent = rng.uniform(0.15, 0.35)
    cloth = draw_cloth(rng, extent)
    body = (
        lambda: bodies.ball(rng.uniform(0.02, 0.06)),
        lambda: bodies.rod(rng.uniform(0.02, 0.05), rng.uniform(0.01, 0.02)),
        lambda: bodies.box(*rng.uniform(0.03, 0.08, 3)),
        lambda: bodies.plate(rng.uniform(0.03, 0.06), rng.uniform(0.01, 0.02)),
    )[rng.integers(4)]()
    motion = swing(rng, 5, 20, extent * rng.uniform(0.2, 0.5))
    body = body.at(np.append(rng.uniform(-0.2, 0.2, 2) * extent, 0.0), draw_turn(rng), motion)
    return Sketch(cloth, flat(cloth), [body], pins=hold(rng, cloth), rises=True, t_end=0.1)


def spin(rng) -> Sketch:
    """A cloth falls on a body that turns at 5 to 20 rad/s, or is held above it."""
    cloth = draw_cloth(rng, rng.uniform(0.15, 0.3))
    body = (
        lambda: bodies.box(*rng.uniform(0.04, 0.15, 3)),
        lambda: bodies.plate(rng.uniform(0.04, 0.08), rng.uniform(0.01, 0.02)),
        lambda: bodies.rod(rng.uniform(0.03, 0.08), rng.uniform(0.01, 0.02)),
        lambda: bodies.star(5, 0.03, 0.07, 0.04),
    )[rng.integers(4)]()
    motion = Motion(axis=rng.standard_normal(3), spin=float(rng.uniform(5, 20)))
    body = body.at(np.zeros(3), draw_turn(rng), motion)
    pins = hold(rng, cloth) if rng.random() < 0.5 else []
    return Sketch(cloth, flat(cloth), [body], -rng.uniform(0, 2) * UP, pins, rises=True)


def pieces(rng) -> Sketch:
    """Two or three pieces fall on an obstacle and on each other, at up to 5 m/s."""
    count, element = int(rng.integers(2, 4)), draw_element(rng)
    extents = rng.uniform(0.1, 0.2, count)
    parts = [draw_cloth(rng, extent, 120 / count, element) for extent in extents]
    names = [f"piece{i}" for i in range(count)]
    cloth = fc.Cloth.join(parts, names)
    apart, x = rng.uniform(4e-3, 1e-2), np.zeros((len(cloth.X), 3))
    v = np.zeros_like(x)
    for i, name in enumerate(names):
        nodes = cloth.nodes(name)
        x[nodes] = flat(cloth, apart * i, name) + sideways(rng, 0.04) * [1, 1, 0]
        v[nodes, 2] = -rng.uniform(0, 5)
    return Sketch(cloth, tilted(rng, x, 0.4), [draw_wide(rng)], v, rises=True)


def pierce(rng) -> Sketch:
    """A needle is led through where a cloth is held around."""
    extent = rng.uniform(0.12, 0.25)
    cloth, body = draw_cloth(rng, extent), draw_thin(rng)
    turn = bodies.turn_about(np.append(rng.standard_normal(2), 0.0), rng.uniform(0, 0.4))
    motion = swing(rng, 0.5, 8, extent * rng.uniform(0.1, 0.3))
    body = body.at(np.append(rng.uniform(-0.2, 0.2, 2) * extent, 0.0), turn, motion)
    pins = ["boundary"]
    return Sketch(cloth, flat(cloth), [body], np.zeros(3), pins, 0.1, rises=True, gaps=0.5)


def squeeze(rng) -> Sketch:
    """A cloth between two bodies, or between four walls, that come nearer at up to 1 m/s."""
    extent = rng.uniform(0.15, 0.25)
    if rng.random() < 0.5:
        return walls(rng, extent)
    cloth = draw_cloth(rng, extent)
    radius, speed = rng.uniform(0.03, 0.06), rng.uniform(0.1, 1)
    kind = (bodies.ball, bodies.cylinder, lambda r: bodies.rod(0.05, r))[rng.integers(3)]
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # its axis lies
    away, pair = radius + CLEAR, []
    for side in (-1, 1):
        motion = Motion(-side * rng.uniform(0.0, 0.5) * CLEAR * UP, float(speed / CLEAR))
        pair.append(kind(radius).at([0.01 * side, 0, side * away], turn, motion))
    return Sketch(cloth, flat(cloth), pair, pins=hold(rng, cloth), t_end=0.1)


def walls(rng, extent: float) -> Sketch:
    """Four walls crumple a cloth over a ground."""
    cloth = draw_cloth(rng, extent, round_too=False)
    x = flat(cloth, CLEAR)
    x[:, 2] += 2e-3 * np.sin(20 * x[:, 0]) * np.cos(17 * x[:, 1])
    way, speed = extent * rng.uniform(0.1, 0.25), rng.uniform(0.1, 1)
    sides = [bodies.plane().at(0 * UP)]
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        n = -sign * np.eye(3)[axis]
        Q = np.column_stack([np.cross(UP, n), UP, n])
        motion = Motion(way * n, float(speed / way))
        sides.append(bodies.plane().at(-n * (extent / 2 + CLEAR), Q, motion))
    return Sketch(cloth, x, sides, t_end=min(0.15, 0.5 * math.pi * way / speed))


def mesh(rng) -> Sketch:
    """A cloth falls on a mesh with spikes, ridges and grooves, which may move."""
    cloth = draw_cloth(rng, rng.uniform(0.15, 0.3))
    if rng.random() < 0.5:
        body = bodies.star(int(rng.integers(3, 8)), rng.uniform(0.02, 0.03), 0.08, 0.04)
        body = body.at(np.zeros(3), draw_turn(rng), swing(rng, 0, 5, 0.1))
    else:
        body = bodies.zigzag(8, rng.uniform(0.03, 0.05), rng.uniform(0.01, 0.05), 0.5)
        body = body.at(np.zeros(3))
    v = -rng.uniform(0, 5) * UP + sideways(rng)
    return Sketch(cloth, tilted(rng, flat(cloth), 0.3), [body], v, rises=True)


KINDS: dict[str, Callable] = {
    "throw": throw,
    "projectile": projectile,
    "spin": spin,
    "pieces": pieces,
    "pierce": pierce,
    "squeeze": squeeze,
    "mesh": mesh,
}
