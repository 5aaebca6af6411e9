"""Scenes of the catalogue: six that are named, and drops that a seed draws.

Each obstacle stands at the origin. Beside it stands a function that says how deep points are inside
it, written without the code of the term.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import fecloth as fc

GAP = 1e-3  # of all obstacles, and between layers [m]
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
BENT = [name for name in fc.Fabric.presets() if fc.Fabric.preset(name).bending]
CLEAR = 5e-3  # least distance at the start [m]


@dataclass(frozen=True)
class Scene:
    """A cloth before it falls.

    Attributes
    ----------
    system, start
        The cloth with its terms, and its state at the start.
    depth
        (m, 3) points → (m,) how deep they are inside the obstacle [m]; None without one.
    """

    system: fc.System
    start: fc.State
    depth: Callable[[np.ndarray], np.ndarray] | None


# --- obstacles: how deep points are inside --------------------------------------------------------


def in_ball(x, radius):
    return radius - np.linalg.norm(x, axis=1)


def in_cylinder(x, radius):
    return radius - np.hypot(x[:, 0], x[:, 1])


def in_rod(x, half, radius):
    return radius - np.linalg.norm(x - np.outer(np.clip(x[:, 2], -half, half), [0, 0, 1]), axis=1)


def in_plate(x, radius, thickness):
    return np.minimum(in_cylinder(x, radius), thickness / 2 - abs(x[:, 2]))


def in_box(x, *size):
    return (np.array(size) / 2 - abs(x)).min(axis=1)


def in_ring(x, radius, thickness):
    return thickness / 2 - np.hypot(np.hypot(x[:, 0], x[:, 1]) - radius, x[:, 2])


def shape(kind: str, *size: float) -> tuple[fc.shapes.Shape, Callable]:
    """The obstacle of these sizes, and how deep points are inside it."""
    origin, axis = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    ring = "sqrt((sqrt(x**2 + y**2) - {!r})**2 + z**2) - {!r}"
    make, depth = {
        "ball": (lambda r: fc.shapes.Sphere(origin, r), in_ball),
        "cylinder": (lambda r: fc.shapes.Cylinder(origin, axis, r), in_cylinder),
        "rod": (lambda a, r: fc.shapes.Capsule((0, 0, -a), (0, 0, a), r), in_rod),
        "plate": (lambda r, d: fc.shapes.Disk(origin, axis, r, d), in_plate),
        "box": (lambda *s: fc.shapes.Box(origin, s), in_box),
        "ring": (lambda r, d: fc.shapes.Sdf(ring.format(r, d / 2), radius=d / 2), in_ring),
    }[kind]
    return make(*size), lambda x: depth(x, *size)


# --- named scenes ---------------------------------------------------------------------------------


def flat(cloth: fc.Cloth, height: float) -> np.ndarray:
    """Positions in the plane, with the middle of the cloth over the origin."""
    middle = (cloth.X.min(axis=0) + cloth.X.max(axis=0)) / 2
    return np.column_stack([cloth.X - middle, np.full(len(cloth.X), height)])


def terms_with(*contact) -> list:
    inner = [fc.StVK(), fc.PlateBending(), fc.Gravity(), fc.StrainRateDamping(time=1e-3)]
    return [*inner, fc.SelfContact(GAP, friction=0.3), *contact]


def edge(area: float, triangles: int) -> float:
    """The edge length [m] of this many triangles of equal sides."""
    return math.sqrt(4 * area / (math.sqrt(3) * triangles))


def named(case: str, triangles: int) -> Scene:
    """One of `NAMED`."""
    return {"layers": layers, "rope": rope}.get(case, lambda n: on(case, n))(triangles)


ON = {  # case: the obstacle, its sizes [m], where its top is, the extent of the sheet
    "sphere": ("ball", (0.1,), 0.1, 0.4),
    "table": ("box", (0.2, 0.2, 0.1), 0.05, 0.4),
    "disk": ("plate", (0.09, 0.01), 0.005, 0.3),
    "ring": ("ring", (0.08, 0.02), 0.01, 0.3),
}


def on(case: str, triangles: int) -> Scene:
    """A sheet, round over the disk, that falls from 5 mm above the obstacle."""
    kind, size, top, extent = ON[case]
    body, depth = shape(kind, *size)
    if case == "disk":
        cloth = fc.Cloth.disk(extent / 2, edge(math.pi * extent**2 / 4, triangles))
    else:
        cloth = fc.Cloth.rectangle(extent, extent, edge(extent**2, triangles))
    system = fc.System(cloth, FABRIC, terms_with(fc.Obstacle(body, GAP, friction=0.3)))
    return Scene(system, system.state(flat(cloth, top + CLEAR)), depth)


def layers(triangles: int) -> Scene:
    """A strip that is folded into ten layers of 0.1 m, 2 cm apart, and falls on a plane."""
    count, long, width, apart = 10, 0.1, 0.06, 0.02
    turn = math.pi * apart / 2
    length = count * long + (count - 1) * turn
    cloth = fc.Cloth.rectangle(length, width, math.sqrt(2 * length * width / triangles), "right")
    layer, s = np.divmod(cloth.X[:, 0], long + turn)
    on_turn = np.clip((s - long) / turn, 0, 1)
    along = np.minimum(s, long) + apart / 2 * np.sin(math.pi * on_turn)
    x = np.where(layer % 2 == 0, along, long - along)
    z = CLEAR + apart * (layer + (1 - np.cos(math.pi * on_turn)) / 2)
    floor = fc.Obstacle(fc.shapes.Plane((0, 0, 0), (0, 0, 1)), GAP, friction=0.3)
    system = fc.System(cloth, FABRIC, terms_with(floor))
    return Scene(system, system.state(np.column_stack([x, cloth.X[:, 1], z])), lambda x: -x[:, 2])


def rope(triangles: int) -> Scene:
    """A strip whose ends turn against each other, three turns in 1 s, and come 0.1 m nearer."""
    length, width = 0.4, 0.05
    cloth = fc.Cloth.rectangle(length, width, edge(length * width, triangles))
    pins = [
        fc.Pin(end, motion=(f"{way}*t", 0, 0), rotate=fc.Rotation((0, 0, 0), (1, 0, 0), angle))
        for end, way, angle in (("left", 0.05, "3*pi*t"), ("right", -0.05, "-3*pi*t"))
    ]
    system = fc.System(cloth, FABRIC, terms_with(), pins)
    return Scene(system, system.state(flat(cloth, 0.0)), None)


NAMED = (*ON, "layers", "rope")


# --- drops that a seed draws ----------------------------------------------------------------------


def drawn(seed: int, triangles: int) -> Scene:
    """A sheet or a round cloth that falls, tilted, on an obstacle that is turned, at 0 to 2 m/s."""
    rng = np.random.default_rng(seed)
    body, depth = shape(*draw_shape(rng))
    extent = rng.uniform(0.2, 0.4)
    if rng.random() < 0.5:
        cloth = fc.Cloth.disk(extent / 2, edge(math.pi * extent**2 / 4, triangles))
    else:
        cloth = fc.Cloth.rectangle(extent, extent, edge(extent**2, triangles))
    turned = np.linalg.qr(rng.standard_normal((3, 3)))[0]  # the last row is up, for the obstacle
    tilt = turn_about(rng.standard_normal(3), rng.uniform(0, 0.7))
    friction, speed = rng.choice([0.0, 0.3, 0.6]), rng.uniform(0, 2)
    x = place(flat(cloth, 0.0) @ tilt @ turned, cloth.triangles, depth, turned[2])
    system = fc.System(
        cloth,
        fc.Fabric.preset(BENT[rng.integers(len(BENT))]),
        [
            fc.StVK(),
            fc.PlateBending(),
            fc.Gravity(tuple(-9.81 * turned[2])),
            fc.StrainRateDamping(time=1e-3),
            fc.SelfContact(GAP, friction=friction),
            fc.Obstacle(body, GAP, friction=friction),
        ],
    )
    v = np.tile(-speed * turned[2] + rng.uniform(-0.5, 0.5, 3), (len(x), 1))
    return Scene(system, system.state(x, v), depth)


def draw_shape(rng: np.random.Generator) -> tuple:
    """A kind of obstacle and its sizes, 2 to 20 cm."""
    kind = ("ball", "cylinder", "rod", "plate", "box", "ring")[rng.integers(6)]
    sizes = {
        "ball": (rng.uniform(0.03, 0.1),),
        "cylinder": (rng.uniform(0.02, 0.08),),
        "rod": (rng.uniform(0.03, 0.1), rng.uniform(0.01, 0.05)),
        "plate": (rng.uniform(0.04, 0.1), rng.uniform(0.01, 0.04)),
        "box": tuple(rng.uniform(0.03, 0.2, 3)),
        "ring": (rng.uniform(0.05, 0.1), rng.uniform(0.02, 0.04)),
    }
    return (kind, *map(float, sizes[kind]))


def turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation about an axis, by Rodrigues' formula."""
    k = axis / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), k)
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def place(x: np.ndarray, triangles: np.ndarray, depth, up: np.ndarray) -> np.ndarray:
    """x, moved up so far that the cloth is about `CLEAR` above the obstacle."""
    height = 1.0
    while True:
        room = -depth(inner_points(x + height * up, triangles)).max()
        if room < CLEAR + 1e-3:
            return x + height * up
        height -= room - CLEAR  # no point comes nearer to the obstacle than by its way


def inner_points(x: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(15 s, 3) points of all triangles: corners, and others between them."""
    i, j = np.array([(i, j) for i in range(5) for j in range(5 - i)]).T
    weights = np.column_stack([i, j, 4 - i - j]) / 4
    points: np.ndarray = np.einsum("pk,skc->spc", weights, x[triangles]).reshape(-1, 3)
    return points
