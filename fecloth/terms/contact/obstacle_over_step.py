"""An obstacle over a step: a first guess outside, and friction with a potential."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fecloth.terms.contact import friction
from fecloth.terms.contact.advance import advance
from fecloth.terms.contact.points import Points
from fecloth.terms.contact.rubbing import along
from fecloth.terms.contact.shape import Shape
from fecloth.terms.step_difference import StepDifference

ITERATIONS = 10  # out of the way of a shape that deforms
MORE = (0, 1, 2, 4, 8, 16, 32)  # gaps, for points inside triangles

if TYPE_CHECKING:
    from fecloth.terms.contact.bound_obstacle import BoundObstacle


@dataclass(frozen=True, eq=False)
class ObstacleOverStep:
    """`Obstacle` over a step that ends at x."""

    obstacle: BoundObstacle
    step: StepDifference

    symmetric = True
    has_energy = True
    dissipative = False
    velocity_dependent = False
    stores_strain = False

    @property
    def name(self) -> str:
        return self.obstacle.name

    def energy(self, x, t) -> float:
        """That of the barrier [J]."""
        return self.obstacle.energy(x, t)

    def add_force(self, x, v, t, f) -> None:
        self.obstacle.add_force(x, v, t, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        self.obstacle.add_tangent(x, v, t, wx, wv, J, definite)

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        return self.obstacle.limit(x, s, t)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        return self.obstacle.rate_bounds(mass)

    def admit(self, x: np.ndarray, t: float) -> np.ndarray:
        """Positions (n, 3) near x at the end of the step, at t, that are outside.

        Each node goes the straight way from the begin of the step to x, as the obstacle sees it,
        and stops before it would enter. If points inside triangles would enter, all nodes stop.
        """
        shape, step, gap = self.obstacle.shape, self.step, self.obstacle.gap
        begin = shape.pose(step.t).to_body(step.start)
        if shape.deforms:
            begin = self._make_way(begin, t)
        pose = shape.pose(t)
        way = pose.to_body(x) - begin
        parts = advance(shape, begin, way, t, gap)
        if (parts == 1.0).all() and len(self.obstacle.points) == 1:
            return x
        way = parts[:, None] * way
        return pose.to_space(begin + self._shorten(begin, way, t) * way)

    def _make_way(self, y: np.ndarray, t: float) -> np.ndarray:
        """Nodes (n, 3), as the shape sees them, outside of what it has become at t.

        They get the distance that they had before, or a gap, and more if points inside triangles
        need it.
        """
        obstacle, shape = self.obstacle, self.obstacle.shape
        pose, wanted = shape.pose(t), np.minimum(shape.distance(y, self.step.t), obstacle.gap)
        for more in MORE:
            moved = _move_out(shape, y, wanted + more * obstacle.gap, t)
            if obstacle.least_distance(pose.to_space(moved), t) > 0.0:
                break
        return moved

    def _shorten(self, y: np.ndarray, way: np.ndarray, t: float) -> float:
        """The part of the way (n, 3) of all nodes on which no point inside a triangle enters."""
        obstacle, least = self.obstacle, 1.0
        at_nodes = obstacle.shape.distance(y, t)
        reach = np.sqrt(np.einsum("ni,ni->n", way, way)) + obstacle.gap
        for points in obstacle.points[1:]:
            which = points.candidates(at_nodes, reach)
            if len(which):
                at, ways = points.values(y, which), points.values(way, which)
                parts = advance(obstacle.shape, at, ways, t, obstacle.gap)
                least = min(least, float(parts.min()))
        return least


def _move_out(shape: Shape, y: np.ndarray, wanted: np.ndarray, t: float) -> np.ndarray:
    """Points (n, 3) moved along the slope of the distance to the `wanted` one (n,), if nearer."""
    y = y.copy()
    for _ in range(ITERATIONS):
        d = shape.distance(y, t)
        near = np.flatnonzero(d < wanted)
        if not len(near):
            break
        gradient = shape.slopes(y[near], t)[0]
        part = (wanted - d)[near] / np.einsum("mi,mi->m", gradient, gradient)
        y[near] += part[:, None] * gradient
    return y


class Lagged(NamedTuple):
    """Friction of points of one kind, as the begin of the step has it.

    Attributes
    ----------
    points, which
        The points, and (p,) the numbers of those that touch.
    limit
        (p,) μ λ [N].
    n
        (p, 3) normals.
    surface
        (p, 3) mean velocity of the obstacle over the step [m/s].
    start, past
        (p, 3) x₀ and Σ cᵢ xᵢ of the points [m].
    """

    points: Points
    which: np.ndarray
    limit: np.ndarray
    n: np.ndarray
    surface: np.ndarray
    start: np.ndarray
    past: np.ndarray

    def sliding(self, x: np.ndarray, past: np.ndarray, h: float) -> np.ndarray:
        """(p, 3) velocity (x − past)/h relative to the obstacle, along its surface [m/s]."""
        v = (self.points.values(x, self.which) - past) / h
        return along(self.n, v - self.surface)


@dataclass(frozen=True, eq=False)
class RubbedOverStep(ObstacleOverStep):
    """`Obstacle` with friction over a step: the potential h Σ μ λ f₀(y) of its sliding velocity.

    λ and the normals are those at the begin of the step, and the velocity is the method's
    difference.
    """

    @cached_property
    def lagged(self) -> tuple[Lagged, ...]:
        """The friction of all points that touch at the begin of the step."""
        obstacle, step, lagged = self.obstacle, self.step, []
        now, later = obstacle.shape.pose(step.t), obstacle.shape.pose(step.t + step.dt)
        past = np.zeros_like(step.start)
        for weight, x in step.past:
            past += weight * x
        for at in obstacle.touching(step.start, step.t):
            gradient = obstacle.slopes(at, step.t)[0]
            steep = np.sqrt(np.einsum("mi,mi->m", gradient, gradient))
            limit = obstacle.friction * obstacle.normal_force(at) * steep
            surface = (later.to_space(at.y) - now.to_space(at.y)) / step.dt
            begin = at.points.values(step.start, at.which), at.points.values(past, at.which)
            n = gradient / steep[:, None]
            lagged.append(Lagged(at.points, at.which, limit, n, surface, *begin))
        return tuple(lagged)

    def energy(self, x, t) -> float:
        """That of the barrier, and h Σ μ λ f₀(y) [J]."""
        total, h, eps = self.obstacle.energy(x, t), self.step.h, self.obstacle.creep
        for each in self.lagged:
            y = np.linalg.norm(each.sliding(x, each.past, h), axis=1)
            total += h * float((each.limit * friction.potential(y, eps)).sum())
        return total

    def add_force(self, x, v, t, f) -> None:
        """f += the force of the barrier at rest, and −μ λ f₁(y)/y w [N]."""
        self.obstacle.add_push(x, t, f)
        for each in self.lagged:
            w = each.sliding(x, each.past, self.step.h)
            size = each.limit * friction.factor(np.linalg.norm(w, axis=1), self.obstacle.creep)
            each.points.add_force(each.which, -size[:, None] * w, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; the part of friction is positive semi-definite."""
        self.obstacle.add_push_tangent(x, t, wx, J, definite)
        for each in self.lagged:
            w = each.sliding(x, each.past, self.step.h)
            across = np.eye(3) - each.n[:, :, None] * each.n[:, None, :]
            slope = across @ friction.slope(w, self.obstacle.creep) @ across
            K = (wx / self.step.h) * each.limit[:, None, None] * slope
            each.points.add_tangent(each.which, K, J)

    def dissipation(self, x: np.ndarray) -> float:
        """dt Σ μ λ f₁(y) y [J] with the velocity over the step, (x − x₀)/dt."""
        total = 0.0
        for each in self.lagged:
            y = np.linalg.norm(each.sliding(x, each.start, self.step.dt), axis=1)
            total += float((each.limit * friction.factor(y, self.obstacle.creep) * y**2).sum())
        return self.step.dt * total
