"""An obstacle over a step: where the step began, for a first guess outside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fecloth.terms.contact.advance import advance
from fecloth.terms.step_difference import StepDifference

if TYPE_CHECKING:
    from fecloth.terms.contact.obstacle import BoundObstacle


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
        begin = shape.pose(t - step.dt).to_body(step.start)
        pose = shape.pose(t)
        way = pose.to_body(x) - begin
        parts = advance(shape, begin, way, t, gap)
        if (parts == 1.0).all() and len(self.obstacle.points) == 1:
            return x
        way = parts[:, None] * way
        return pose.to_space(begin + self._shorten(begin, way, t) * way)

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
