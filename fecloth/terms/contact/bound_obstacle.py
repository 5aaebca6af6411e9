"""An obstacle bound to a cloth: energy, force, tangent, and how far the cloth may move."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fecloth.terms.contact import barrier
from fecloth.terms.contact.advance import advance, goes_through, move_out
from fecloth.terms.contact.bound_contact import BoundContact, Rubbing, Touched
from fecloth.terms.contact.friction import SlidingPoints, along
from fecloth.terms.contact.inside import refuse_inside
from fecloth.terms.contact.points import Contacts, Points
from fecloth.terms.contact.restitution import Approach, rates
from fecloth.terms.contact.shape import AT_REST, Pose, Shape
from fecloth.terms.contact.surfaces import Triangles, surface_of
from fecloth.terms.step_difference import StepDifference

# How many gaps more than it had a node may be moved away from a shape that deforms, so that no
# point inside a triangle is left in the shape. Chosen: the way is doubled up to it.
MOST_GAPS_MORE = 32
# Speed of the first touch [m/s] where it is not known, as records can hold no infinite number.
# No cloth is as fast; c of it is nearly 0, so that nothing is damped.
UNKNOWN_SPEED = 1e9


@dataclass(frozen=True, eq=False)
class BoundObstacle(BoundContact):
    """`Obstacle` on a cloth.

    Attributes
    ----------
    shape, gap, friction, restitution
        As of the obstacle.
    stiffness
        κ [Pa].
    creep
        Speed of sliding ε [m/s] from which friction has its full value.
    points
        The kinds of points on which it acts; the nodes are the first.
    moved
        The step over which it acts, with the speeds of the first touch; None at one state, where
        it does not dissipate.
    """

    shape: Shape
    gap: float
    stiffness: float
    friction: float
    creep: float
    points: tuple[Points, ...]
    restitution: float = 1.0
    moved: Touched | None = None

    name = "Obstacle"

    @property
    def body(self) -> Shape:
        return self.shape

    @property
    def symmetric(self) -> bool:
        """Whether there is no friction: its tangent is symmetric only over a step."""
        return not self.friction

    def touching(self, x: np.ndarray, t: float) -> Iterator[Contacts]:
        """The points nearer than the gap, of each kind."""
        pose = self.shape.pose(t)
        at_nodes = self.shape.distance(pose.to_body(x), t)
        for kind, points in enumerate(self.points):
            which = points.candidates(at_nodes, self.gap)
            if not len(which):
                continue
            y = pose.to_body(points.values(x, which))
            s = self.shape.distance(y, t) / self.gap
            is_touching = s < 1.0
            if is_touching.any():
                which = which[is_touching]
                s = s[is_touching]
                approach = self._approach(kind, which, s)
                yield Contacts(points, which, y=y[is_touching], s=s, approach=approach)

    def _approach(self, kind: int, which: np.ndarray, s: np.ndarray) -> Approach:
        """How the points `which` of a kind come to the distances s (p,) over the gap."""
        if self.moved is None:
            return Approach(s0=s, a=np.zeros(len(s)))
        speeds = np.zeros(len(s))
        if self.moved.speeds:
            speeds = self.moved.speeds[kind][which]
        before = self.distances(self.moved.start, self.moved.begin, kind, which)
        c = rates(self.restitution, speeds)
        return Approach(s0=before / self.gap, a=c * self.gap / self.moved.dt)

    def distances(self, x: np.ndarray, t: float, kind: int, which: np.ndarray) -> np.ndarray:
        """(p,) distances [m] of the points `which` of a kind."""
        y = self.shape.pose(t).to_body(self.points[kind].values(x, which))
        return self.shape.distance(y, t)

    def slopes(self, contacts: Contacts, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (p, 3) and Hessian (p, 3, 3) of the distance, in space."""
        gradient, hessian = self.shape.slopes(contacts.y, t)
        if self.shape.rotate is None:
            return gradient, hessian
        R = self.shape.pose(t).R
        return gradient @ R.T, np.einsum("ij,pjk,lk->pil", R, hessian, R)

    def normal_force(self, contacts: Contacts) -> np.ndarray:
        """(p,) −κ A b′(d/gap) max(0, 1 − c ḋ), the factor of ∇d [N]."""
        force = self.stiffness * contacts.areas * barrier.pressure(contacts.s)
        return force * contacts.approach.factor(contacts.s)

    def energy(self, x, t) -> float:
        """Σ κ gap A b(d/gap) [J]; +∞ if a point is inside."""
        total = 0.0
        for contacts in self.touching(x, t):
            total += float((contacts.areas * contacts.approach.value(contacts.s)).sum())
        return self.stiffness * self.gap * total

    def add_forces(self, x: np.ndarray, t: float, rubbing: Rubbing, f: np.ndarray) -> None:
        """f −= κ A b′ ∇d, and friction [N]; NaN if a point is inside."""
        self.add_push(x, t, f)
        for sliding, w in rubbing:
            sliding.add_force(w, f)

    def add_push(self, x: np.ndarray, t: float, f: np.ndarray) -> None:
        """f −= κ A b′ ∇d [N], the force without friction."""
        for contacts in self.touching(x, t):
            if contacts.s.min() <= 0.0:
                f += np.nan
                return
            gradient = self.slopes(contacts, t)[0]
            contacts.points.add_force(
                contacts.which, self.normal_force(contacts)[:, None] * gradient, f
            )

    def add_tangents(self, x, t, wx, rubbing, weight, J, definite) -> None:
        for contacts in self.touching(x, t):
            contacts.points.add_tangent(
                contacts.which, wx * self.push_tangent(contacts, t, definite), J
            )
        for sliding, w in rubbing:
            contacts = sliding.contacts
            contacts.points.add_tangent(contacts.which, sliding.damping(w, weight), J)

    def push_tangent(self, contacts: Contacts, t: float, definite: bool) -> np.ndarray:
        """(p, 3, 3) κ A (b″/gap ∇d ∇dᵀ + b′ ∇²d), without the second part if `definite`."""
        gradient, hessian = self.slopes(contacts, t)
        steep = self.stiffness / self.gap * contacts.areas
        steep *= contacts.approach.curvature(contacts.s)
        K = steep[:, None, None] * gradient[:, :, None] * gradient[:, None, :]
        if not definite:
            K -= self.normal_force(contacts)[:, None, None] * hessian
        return K

    def lag(self, x: np.ndarray, t: float, dt: float | None) -> Sequence[SlidingPoints]:
        """The points of each kind that slide at x and t, with μ λ, normals and velocities."""
        pose = self.shape.pose(t)
        sliding = []
        for contacts in self.touching(x, t):
            gradient = self.slopes(contacts, t)[0]
            steep = np.sqrt(np.einsum("mi,mi->m", gradient, gradient))
            limit = self.friction * self.normal_force(contacts) * steep
            surface = self.shape.mean_velocity(contacts.y, pose.to_space(contacts.y), t, dt)
            n = gradient / steep[:, None]
            sliding.append(
                SlidingPoints(contacts=contacts, limit=limit, n=n, surface=surface, eps=self.creep)
            )
        return sliding

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D; K is not symmetric with friction, and without that if `definite`."""
        super().add_tangent(x, v, t, wx, wv, J, definite)
        if definite or not self.friction:
            return
        spin = np.cross(self.shape.rates(t)[1], np.eye(3)).T
        for sliding in self.lag(x, t, None):
            contacts = sliding.contacts
            change = -self.friction * self.push_tangent(contacts, t, definite)
            K = sliding.stiffness(sliding.values(v), change, spin)
            contacts.points.add_tangent(contacts.which, wx * K, J)

    def work_of_shape(self, y: np.ndarray, x: np.ndarray, before: float, t: float) -> float:
        """Work [J] on the cloth by a shape that deforms: the force times what the shape grows."""
        if not self.shape.deforms:
            return 0.0
        work = 0.0
        for contacts in self.touching(x, t):
            there = contacts.points.values(y, contacts.which)
            grown = self.shape.distance(there, t) - self.shape.distance(there, before)
            work -= float(self.normal_force(contacts) @ grown)
        return work

    def over(self, moved: Touched) -> BoundObstacle:
        if self.restitution < 1.0:
            return replace(self, moved=moved)
        return self

    def lost(self, x: np.ndarray, t: float) -> float:
        """Σ κ gap A p (w − 1)(s₀ − s) [J]."""
        total = 0.0
        for contacts in self.touching(x, t):
            total += float(contacts.areas @ contacts.approach.lost(contacts.s))
        return self.stiffness * self.gap * total

    def speeds(self, x: np.ndarray, t: float) -> tuple[np.ndarray, ...]:
        if not 0.0 < self.restitution < 1.0:
            return ()
        if self.moved is None:
            return tuple(np.full(len(points.areas), UNKNOWN_SPEED) for points in self.points)
        speeds = []
        for kind, before in enumerate(self.moved.speeds):
            all_points = np.arange(len(before))
            d = self.distances(x, t, kind, all_points)
            nearer = self.distances(self.moved.start, self.moved.begin, kind, all_points) - d
            keeps = (d < self.gap) & (before < UNKNOWN_SPEED)
            speeds.append(np.where(keeps, before, np.maximum(nearer / self.moved.dt, 0.0)))
        return tuple(speeds)

    def touch_speed(self, old: Any, x: np.ndarray, t: float) -> float:
        speeds = [0.0]
        pose = self.shape.pose(old.t)
        for contacts in self.touching(x, t):
            place = contacts.points.values(old.x, contacts.which)
            v = contacts.points.values(old.v, contacts.which)
            y = pose.to_body(place)
            n = self.shape.slopes(y, old.t)[0] @ pose.R.T
            n /= np.linalg.norm(n, axis=1, keepdims=True)
            nearer = np.einsum("pi,pi->p", n, self.shape.velocity(place, old.t) - v)
            speeds += nearer[self.shape.distance(y, old.t) >= self.gap].tolist()
        return max(speeds)

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no point passes into the obstacle up to x + α s."""
        pose = self.shape.pose(t)
        way = pose.to_body(x + s) - pose.to_body(x)
        return self._free_part(self.points, x, pose, way, t)

    def _free_part(
        self, kinds: Sequence[Points], x: np.ndarray, pose: Pose, way: np.ndarray, t: float
    ) -> float:
        """The part of the way (n, 3) in the body, from x in space, on which no point enters."""
        at_nodes = self.shape.distance(pose.to_body(x), t)
        least = 1.0
        reach = np.sqrt(np.einsum("ni,ni->n", way, way)) + self.gap
        for points in kinds:
            which = points.candidates(at_nodes, reach)
            if len(which):
                y = pose.to_body(points.values(x, which))
                ways = points.values(way, which)
                least = min(least, float(advance(self.shape, y, ways, t, self.gap).min()))
        return least

    def begin(self, step: StepDifference, t: float) -> np.ndarray:
        begin = self.shape.pose(step.t).to_body(step.start)
        if self.shape.deforms:
            return self._make_way(begin, step.t, t)
        return begin

    def parts(self, begin: np.ndarray, end: np.ndarray, t: float) -> np.ndarray:
        return advance(self.shape, begin, end - begin, t, self.gap)

    def free_part(self, begin: np.ndarray, end: np.ndarray, t: float) -> float:
        return self._free_part(self.points[1:], begin, AT_REST, end - begin, t)

    def allows(self, x: np.ndarray, t: float) -> bool:
        return self.least_distance(x, t) > 0.0

    def leaps(self, old: Any, x: np.ndarray, t: float) -> bool:
        """Whether a point passes through the shape on its straight way in the shape's frame."""
        begin = self.shape.pose(old.t).to_body(old.x)
        end = self.shape.pose(t).to_body(x)
        at_nodes = self.shape.distance(begin, t)
        way = end - begin
        reach = np.sqrt(np.einsum("ni,ni->n", way, way))
        for points in self.points:
            which = points.candidates(at_nodes, reach)
            a = points.values(begin, which)
            b = points.values(end, which)
            if goes_through(self.shape, a, b, t).any():
                return True
        return False

    def room(self, x: np.ndarray, t: float) -> np.ndarray:
        return self.shape.distance(self.shape.pose(t).to_body(x), t)

    def struck(self, x, end, t, dt, held) -> np.ndarray:
        y = self.shape.pose(t + dt).to_body(end)
        nodes = []
        for points in self.points:
            which = points.between(held)
            inside = self.shape.distance(points.values(y, which), t + dt) <= 0.0
            nodes.append(points.nodes(which[inside]))
        return np.unique(np.concatenate(nodes))

    def _make_way(self, y: np.ndarray, before: float, t: float) -> np.ndarray:
        """Move nodes y (n, 3), in the frame of a shape that deforms, out of it at the time t.

        They get the distance that they had at the time `before`, but no more than a gap. Where
        points inside triangles need it, they get 1, 2, 4, … gaps more.
        """
        shape = self.shape
        pose = self.shape.pose(t)
        wanted = np.minimum(shape.distance(y, before), self.gap)
        gaps_more = 0
        while True:
            moved = move_out(shape, y, wanted + gaps_more * self.gap, t)
            is_outside = self.least_distance(pose.to_space(moved), t) > 0.0
            if is_outside or gaps_more == MOST_GAPS_MORE:
                return moved
            gaps_more = max(1, 2 * gaps_more)

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """The least distance [m] of a point of any kind from the shape."""
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
        """The mean distance [m] of the points that it pushes, by their force; NaN without any."""
        force = moment = 0.0
        for contacts in self.touching(x, t):
            push = self.normal_force(contacts)
            force = force + push.sum()
            moment = moment + push @ contacts.s * self.gap
        if force == 0.0:
            return math.nan
        return float(moment / force)

    def push(self, x: np.ndarray, t: float) -> np.ndarray:
        f = np.zeros_like(x)
        self.add_push(x, t, f)
        return f

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        slip = np.zeros_like(x)
        pose = self.shape.pose(t)
        y = pose.to_body(x)
        touching = np.flatnonzero(self.shape.distance(y, t) < self.gap)
        n = self.shape.slopes(y[touching], t)[0] @ pose.R.T
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        slip[touching] = along(n, v[touching] - self.shape.velocity(x[touching], t))
        return slip

    def surface(self, t: float, place: np.ndarray, reach: float) -> Triangles:
        return surface_of(self.shape, t, place, reach)

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        refuse_inside(self.shape, self.points, self.gap, x, t, where)
