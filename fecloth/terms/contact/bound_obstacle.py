"""An obstacle bound to a cloth: energy, force, tangent, and how far the cloth may move."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.mesh.cloth import Cloth
from fecloth.terms.contact import barrier
from fecloth.terms.contact.advance import advance
from fecloth.terms.contact.obstacle_over_step import ObstacleOverStep, RubbedOverStep
from fecloth.terms.contact.points import MOST, Points, divisions, longest_edges
from fecloth.terms.contact.rubbing import Rubbing, along
from fecloth.terms.contact.shape import Shape
from fecloth.terms.contact.surfaces import Triangles, surface_of
from fecloth.terms.step_difference import StepDifference

NAMED = 5  # nodes that an error names


class Contacts(NamedTuple):
    """Points of one kind that an obstacle pushes.

    Attributes
    ----------
    points, which
        The points, and (p,) the numbers of those nearer than the gap.
    y
        (p, 3) their places in the frame of the shape.
    d
        (p,) their distances [m].
    """

    points: Points
    which: np.ndarray
    y: np.ndarray
    d: np.ndarray


@dataclass(frozen=True, eq=False)
class BoundObstacle:
    """`Obstacle` on a cloth.

    Attributes
    ----------
    shape, gap, stiffness, friction
        Of the obstacle; the stiffness is a number.
    creep
        Speed of sliding [m/s] from which friction has its full value.
    points
        On which it acts.
    """

    shape: Shape
    gap: float
    stiffness: float
    friction: float
    creep: float
    points: tuple[Points, ...]

    name = "Obstacle"
    has_energy = True
    stores_strain = False
    needs_end = "the barrier must hold at the end of a step"

    @property
    def symmetric(self) -> bool:
        """Whether there is no friction, which is not symmetric by itself, but over a step."""
        return not self.friction

    @property
    def dissipative(self) -> bool:
        return self.friction > 0.0

    velocity_dependent = dissipative

    @property
    def no_equilibrium(self) -> str:
        """Why it has no unique equilibrium, or ""."""
        return "with friction the place of rest depends on the way there" if self.friction else ""

    def touching(self, x: np.ndarray, t: float) -> Iterator[Contacts]:
        """The points nearer than the gap, of each kind."""
        pose = self.shape.pose(t)
        at_nodes = self.shape.distance(pose.to_body(x), t)
        for points in self.points:
            which = points.candidates(at_nodes, self.gap)
            if not len(which):
                continue
            y = pose.to_body(points.values(x, which))
            d = self.shape.distance(y, t)
            near = d < self.gap
            if near.any():
                yield Contacts(points, which[near], y[near], d[near])

    def slopes(self, at: Contacts, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (p, 3) and Hessian (p, 3, 3) of the distance, in space."""
        gradient, hessian = self.shape.slopes(at.y, t)
        if self.shape.rotate is None:
            return gradient, hessian
        R = self.shape.pose(t).R
        return gradient @ R.T, np.einsum("ij,pjk,lk->pil", R, hessian, R)

    def normal_force(self, at: Contacts) -> np.ndarray:
        """(p,) −κ A b′(d/gap), the factor of ∇d [N]."""
        return self.stiffness * at.points.areas[at.which] * barrier.pressure(at.d / self.gap)

    def energy(self, x, t) -> float:
        """Σ κ gap A b(d/gap) [J]; +∞ if a point is inside."""
        density = self.stiffness * self.gap
        return density * sum(
            float((at.points.areas[at.which] * barrier.value(at.d / self.gap)).sum())
            for at in self.touching(x, t)
        )

    def add_force(self, x, v, t, f) -> None:
        """f −= κ A b′ ∇d, and friction [N]; NaN if a point is inside.

        At v = 0 it is the derivative of the energy: the friction of an obstacle that moves past a
        cloth at rest is left out.
        """
        self.add_push(x, t, f)
        if self.friction and v.any():
            for at, rubbing in self.rubbing(x, v, t):
                at.points.add_force(at.which, rubbing.force, f)

    def add_push(self, x: np.ndarray, t: float, f: np.ndarray) -> None:
        """f −= κ A b′ ∇d [N], the force without friction."""
        for at in self.touching(x, t):
            if at.d.min() <= 0.0:
                f += np.nan
                return
            gradient = self.slopes(at, t)[0]
            at.points.add_force(at.which, self.normal_force(at)[:, None] * gradient, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D; K is not symmetric with friction, and without that if `definite`."""
        self.add_push_tangent(x, t, wx, J, definite)
        if self.friction:
            for at, rubbing in self.rubbing(x, v, t):
                K = wv * rubbing.damping
                K += 0.0 if definite else wx * rubbing.stiffness(self, at)
                at.points.add_tangent(at.which, K, J)

    def add_push_tangent(
        self, x: np.ndarray, t: float, wx: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx κ A (b″/gap ∇d ∇dᵀ + b′ ∇²d), without the second part if `definite`."""
        for at in self.touching(x, t):
            gradient, hessian = self.slopes(at, t)
            areas, s = at.points.areas[at.which], at.d / self.gap
            steep = self.stiffness / self.gap * areas * barrier.curvature(s)
            K = steep[:, None, None] * gradient[:, :, None] * gradient[:, None, :]
            if not definite:
                K -= self.normal_force(at)[:, None, None] * hessian
            at.points.add_tangent(at.which, wx * K, J)

    def rubbing(self, x: np.ndarray, v: np.ndarray, t: float) -> Iterator[tuple[Contacts, Rubbing]]:
        """The points that touch, of each kind, and their friction."""
        for at in self.touching(x, t):
            yield at, Rubbing.of(self, at, *self.slopes(at, t), x, v, t)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ μ λ f₁(y) y of friction [W]."""
        return -sum(float((each.force * each.w).sum()) for _, each in self.rubbing(x, v, t))

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no point passes into the obstacle on the way to x + α s."""
        pose = self.shape.pose(t)
        way = pose.to_body(x + s) - pose.to_body(x)
        at_nodes = self.shape.distance(pose.to_body(x), t)
        reach = np.sqrt(np.einsum("ni,ni->n", way, way)) + self.gap
        least = 1.0
        for points in self.points:
            which = points.candidates(at_nodes, reach)
            if len(which):
                y, ways = pose.to_body(points.values(x, which)), points.values(way, which)
                least = min(least, float(advance(self.shape, y, ways, t, self.gap).min()))
        return least

    def over_step(self, step: StepDifference) -> ObstacleOverStep:
        """The obstacle over a step: it knows where the step began."""
        kind = RubbedOverStep if self.friction else ObstacleOverStep
        return kind(self, step)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Return zeros: at rest nothing touches the obstacle."""
        return 0.0, 0.0

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """The least distance [m] of its points from the obstacle."""
        pose = self.shape.pose(t)
        at_nodes = self.shape.distance(pose.to_body(x), t)
        least = float(at_nodes.min())
        for points in self.points[1:]:
            which = points.candidates(at_nodes, least)
            if len(which):
                y = pose.to_body(points.values(x, which))
                least = min(least, float(self.shape.distance(y, t).min()))
        return least

    def mean_distance(self, x: np.ndarray, t: float) -> float:
        """The mean distance [m] of the points that it pushes, weighted by the force; else NaN."""
        force = moment = 0.0
        for at in self.touching(x, t):
            push = self.normal_force(at)
            force, moment = force + push.sum(), moment + push @ at.d
        return float(moment / force) if force else math.nan

    def push(self, x: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) force on the nodes without friction [N]."""
        f = np.zeros_like(x)
        self.add_push(x, t, f)
        return f

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) velocity [m/s] along the surface and relative to it, of nodes in the gap."""
        slip, pose = np.zeros_like(x), self.shape.pose(t)
        y = pose.to_body(x)
        near = np.flatnonzero(self.shape.distance(y, t) < self.gap)
        n = self.shape.slopes(y[near], t)[0] @ pose.R.T
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        slip[near] = along(n, v[near] - self.shape.velocity(x[near], t))
        return slip

    def surface(self, t: float, place: np.ndarray, reach: float) -> Triangles:
        """The surface of its shape; of an endless one the part within `reach` [m] of a place."""
        return surface_of(self.shape, t, place, reach)

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for a cloth that starts inside the obstacle; it names the nodes."""
        pose = self.shape.pose(t)
        for points in self.points:
            which = points.candidates(self.shape.distance(pose.to_body(x), t), 0.0)
            d = self.shape.distance(pose.to_body(points.values(x, which)), t)
            inside = which[d <= 0.0]
            if len(inside):
                raise self._inside(points, inside, -d[d <= 0.0], where)

    def _inside(self, points: Points, inside: np.ndarray, depth: np.ndarray, where: str):
        kind = type(self.shape).__name__
        deepest = np.argsort(-depth, kind="stable")[:NAMED]
        if points is self.points[0]:
            named = ", ".join(f"{inside[i]} ({1e3 * depth[i]:.3g} mm)" for i in deepest)
            more = ", …" if len(inside) > NAMED else ""
            what = f"{len(inside)} nodes start inside the {kind}, the deepest: {named}{more}"
        else:
            deep = f"by up to {1e3 * depth.max():.3g} mm"
            what = f"{len(inside)} points inside triangles start inside the {kind}, {deep}"
        gap = f"{1e3 * self.gap:g} mm"
        remedy = f"Start at least {gap}, the gap, away from it, or move the obstacle."
        return InputError(what, "must start outside", where, remedy)


@dataclass(frozen=True, eq=False)
class BoundMovingObstacle(BoundObstacle):
    """`Obstacle` on a cloth, with a shape that moves, turns or deforms: it does work."""

    def supply(self, x, v, t) -> float:
        """Power F · w [W] of its force on the cloth at the velocity w of its surface."""
        power = 0.0
        for at, rubbing in self.rubbing(x, v, t):
            push = self.normal_force(at)
            surface = self.shape.velocity(at.points.values(x, at.which), t)
            F = (push * rubbing.steep)[:, None] * rubbing.n + rubbing.force
            power += float((F * surface).sum() - push @ self.shape.time_rate(at.y, t))
        return power


def cutting_depth(obstacle: BoundObstacle, cloth: Cloth) -> float:
    """How deep [m] a triangle may dip into the shape between its points; 0 if it cannot."""
    if divisions(obstacle.shape, obstacle.gap, cloth) <= MOST:
        return 0.0
    part = float(longest_edges(cloth).max()) / MOST
    radius = obstacle.shape.radius_of_curvature + obstacle.gap
    return min(part**2 / (6 * radius), 0.5 * part)  # half of a part: at an edge of 90 degrees
