"""Obstacles of the catalogue, each with formulas of its own beside the term of fecloth.

A body stands at a centre c and is turned by Q at t = 0. Its formulas hold in its own frame, with
its axis along z: y = Qᵀ R(t)ᵀ (x − c − u(t)).
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import meshio
import numpy as np

import fecloth as fc

UPRIGHT = np.eye(3)
THIN = 0.005  # m
NO_POINTS, NO_LINES = np.zeros((0, 3)), np.zeros((0, 2, 3))


def turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """(3, 3) rotation about an axis, by Rodrigues' formula."""
    k = axis / np.linalg.norm(axis)
    cross = np.cross(np.eye(3), k)
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


@dataclass(frozen=True)
class Motion:
    """u(t) = way · sin(rate t), or way · t for rate 0, and a turn about an axis by spin · t."""

    way: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rate: float = 0.0
    axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    spin: float = 0.0  # rad/s

    def keys(self, centre: np.ndarray) -> dict:
        """The arguments of a shape or a `MeshObstacle`."""
        part = f"sin({self.rate!r}*t)" if self.rate else "t"
        keys: dict = {}
        if self.way.any():
            keys["motion"] = tuple(f"{float(each)!r}*{part}" for each in self.way)
        if self.spin:
            turned = tuple(map(float, centre)), tuple(map(float, self.axis)), f"{self.spin!r}*t"
            keys["rotate"] = fc.Rotation(*turned)
        return keys

    def to_rest(self, x: np.ndarray, centre: np.ndarray, t: float) -> np.ndarray:
        """Points (m, 3) relative to the centre, turned and moved back to t = 0."""
        moved = self.way * (math.sin(self.rate * t) if self.rate else t)
        back: np.ndarray = (x - centre - moved) @ turn_about(self.axis, self.spin * t)
        return back


@dataclass(frozen=True)
class Body:
    """An obstacle and what is known of it without fecloth.

    Attributes
    ----------
    make
        (centre, Q, motion keys, contact keys) → the term.
    depth
        (m, 3) points in its frame and t → (m,) how deep they are inside [m]; None for a mesh.
    lines
        (k, 2, 3) segments inside of a thin body, which no triangle may cut.
    inner
        (k, 3) points far inside of a wide body, over which no triangle may pass. Around a thin one
        a cloth may slip within a step, so that straight ways tell nothing.
    triangles
        (k, 3, 3) of a mesh, which no triangle may cut.
    """

    make: Callable
    depth: Callable | None
    lines: np.ndarray = field(default_factory=lambda: NO_LINES)
    inner: np.ndarray = field(default_factory=lambda: np.zeros((1, 3)))
    triangles: np.ndarray | None = None
    can_turn: bool = True  # whether its term takes Q
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    Q: np.ndarray = field(default_factory=lambda: UPRIGHT)
    motion: Motion = field(default_factory=Motion)

    def at(self, centre, Q=UPRIGHT, motion: Motion | None = None) -> Body:
        """The body at a place, turned if its term can be."""
        Q = Q if self.can_turn else UPRIGHT
        return replace(self, centre=np.array(centre, float), Q=Q, motion=motion or Motion())

    def term(self, **keys) -> fc.Obstacle | fc.MeshObstacle:
        """The obstacle with a gap, a friction and a restitution."""
        return self.make(self.centre, self.Q, self.motion.keys(self.centre), keys)

    def to_frame(self, x: np.ndarray, t: float) -> np.ndarray:
        """Points (m, 3) of space in its own frame."""
        return self.motion.to_rest(x, self.centre, t) @ self.Q

    def deep(self, x: np.ndarray, t: float) -> np.ndarray:
        """(m,) how deep points of space are inside [m]; a mesh: minus their distance, roughly."""
        y = self.to_frame(x, t)
        if self.depth is not None:
            return self.depth(y, t)
        spots = self.triangles.reshape(-1, 3)
        size = np.linalg.norm(self.triangles - np.roll(self.triangles, 1, 1), axis=2).max()
        return size - np.linalg.norm(y[:, None] - spots, axis=2).min(axis=1)


# --- how deep points are inside -------------------------------------------------------------------


def in_cylinder(y, radius):
    return radius - np.hypot(y[:, 0], y[:, 1])


def in_rod(y, half, radius):
    return radius - np.linalg.norm(y - np.outer(np.clip(y[:, 2], -half, half), [0, 0, 1]), axis=1)


def in_plate(y, radius, thickness):
    return np.minimum(in_cylinder(y, radius), thickness / 2 - abs(y[:, 2]))


def in_ring(y, radius, thickness):
    return thickness / 2 - np.hypot(np.hypot(y[:, 0], y[:, 1]) - radius, y[:, 2])


# --- bodies ---------------------------------------------------------------------------------------


def place(values) -> tuple[float, ...]:
    return tuple(map(float, values))


def obstacle(shape: Callable) -> Callable:
    """`Body.make` of the shape that a function of (centre, axis) and the motion returns."""

    def make(centre, Q, motion, keys):
        return fc.Obstacle(shape(centre, Q[:, 2], motion), **keys)

    return make


def plane() -> Body:
    make = obstacle(lambda c, n, motion: fc.shapes.Plane(place(c), place(n), **motion))
    return Body(make, lambda y, t: -y[:, 2], inner=np.array([[0, 0, -0.01]]))


def ball(radius: float) -> Body:
    make = obstacle(lambda c, _, motion: fc.shapes.Sphere(place(c), radius, **motion))
    return Body(make, lambda y, t: radius - np.linalg.norm(y, axis=1))


def cylinder(radius: float) -> Body:
    make = obstacle(lambda c, a, motion: fc.shapes.Cylinder(place(c), place(a), radius, **motion))
    return Body(make, lambda y, t: in_cylinder(y, radius), lines=axis(1.0), inner=NO_POINTS)


def middle(width: float) -> np.ndarray:
    """`Body.inner` of a body that is so wide at its middle [m]."""
    return np.zeros((1, 3)) if width > THIN else NO_POINTS


def axis(half: float) -> np.ndarray:
    return np.array([[[0, 0, -half], [0, 0, half]]])


def rod(half: float, radius: float) -> Body:
    make = obstacle(
        lambda c, a, motion: fc.shapes.Capsule(
            place(c - half * a), place(c + half * a), radius, **motion
        )
    )
    inner = middle(2 * radius)
    return Body(make, lambda y, t: in_rod(y, half, radius), axis(half), inner)


def plate(radius: float, thickness: float) -> Body:
    make = obstacle(
        lambda c, a, motion: fc.shapes.Disk(place(c), place(a), radius, thickness, **motion)
    )
    angle = np.linspace(0, math.pi, 4, endpoint=False)
    across = 0.98 * radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    lines = np.stack([-across, across], axis=1)
    return Body(make, lambda y, t: in_plate(y, radius, thickness), lines, middle(thickness))


def box(*size: float) -> Body:
    make = obstacle(lambda c, _, motion: fc.shapes.Box(place(c), size, **motion))
    half = np.array(size) / 2
    lines = bars(half) if min(size) < THIN else NO_LINES
    inner = middle(min(size))
    return Body(make, lambda y, t: (half - abs(y)).min(axis=1), lines, inner, can_turn=False)


def bars(half: np.ndarray) -> np.ndarray:
    """(12, 2, 3) the edges of a box."""
    corners = half * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    pairs = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]
    return corners[np.array(pairs)]


def ring(radius: float, thickness: float) -> Body:
    formula = f"sqrt((sqrt(x**2 + y**2) - {radius!r})**2 + z**2) - {thickness / 2!r}"
    make = obstacle(lambda c, _, motion: fc.shapes.Sdf(formula, radius=thickness / 2, **motion))
    angle = np.linspace(0, 2 * math.pi, 9)
    circle = radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    inner = circle[:-1]
    return Body(make, lambda y, t: in_ring(y, radius, thickness), inner=inner, can_turn=False)


# --- meshes ---------------------------------------------------------------------------------------

FOLDER = Path(tempfile.gettempdir()) / "fecloth_catalogue"


def mesh(name: str, nodes: np.ndarray, triangles: list, inner: np.ndarray) -> Body:
    """A `MeshObstacle` of these triangles, turned and moved in its file."""

    def make(centre, Q, motion, keys):
        FOLDER.mkdir(exist_ok=True)
        keys.pop("restitution", None)
        path = FOLDER / f"{name}_{abs(hash((nodes.tobytes(), Q.tobytes(), centre.tobytes())))}.stl"
        meshio.write_points_cells(path, nodes @ Q.T + centre, {"triangle": np.array(triangles)})
        return fc.MeshObstacle(path, **motion, **keys)

    return Body(make, None, inner=inner, triangles=nodes[np.array(triangles)])


def star(spikes: int, inside: float, outside: float, height: float) -> Body:
    """A prism over a star with sharp spikes, along z."""
    count = 2 * spikes
    angle = math.pi / spikes * np.arange(count)
    radius = np.where(np.arange(count) % 2, inside, outside)
    rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
    up = np.array([0, 0, height / 2])
    nodes = np.vstack([rim - up, rim + up, [-up, up]])
    triangles = []
    for a in range(count):
        b = (a + 1) % count
        triangles += [[a, b, count + b], [a, count + b, count + a]]
        triangles += [[b, a, 2 * count], [count + a, count + b, 2 * count + 1]]
    return mesh("star", nodes, triangles, np.zeros((1, 3)))


def zigzag(teeth: int, pitch: float, height: float, width: float) -> Body:
    """An open sheet of sharp ridges and grooves that run along y."""
    s = np.arange(2 * teeth + 1)
    x = pitch / 2 * (s - teeth)
    z = np.where(s % 2, 0.0, -height)
    left = np.column_stack([x, 0 * x - width / 2, z])
    nodes, count = np.vstack([left, left + [0, width, 0]]), len(s)
    triangles = []
    for a in range(count - 1):
        triangles += [[a, a + 1, count + a + 1], [a, count + a + 1, count + a]]
    return mesh("zigzag", nodes, triangles, NO_POINTS)


def spike(half: float, radius: float) -> Body:
    """A needle with a triangle as its section, and a sharp point at both ends."""
    angle = 2 * math.pi / 3 * np.arange(3)
    around = radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    nodes = np.vstack([around, [[0, 0, -half], [0, 0, half]]])
    triangles = [[a, (a + 1) % 3, 4] for a in range(3)] + [[(a + 1) % 3, a, 3] for a in range(3)]
    return replace(mesh("spike", nodes, triangles, NO_POINTS), lines=axis(0.98 * half))
