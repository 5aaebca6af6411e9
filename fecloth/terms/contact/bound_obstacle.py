"""An obstacle bound to a cloth: energy, force, tangent, and how far the cloth may move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.terms.contact import barrier
from fecloth.terms.contact.advance import advance, goes_through, move_out
from fecloth.terms.contact.bound_contact import NO_FORCES, BoundContact, Touched
from fecloth.terms.contact.friction import STICK_OVER_BARRIER, Grips, along
from fecloth.terms.contact.inside import refuse_inside
from fecloth.terms.contact.near_points import Contacts, NearPoints
from fecloth.terms.contact.points import Points
from fecloth.terms.contact.surfaces import Triangles, surface_of
from fecloth.terms.contact.touches import Touches, gradients
from fecloth.terms.protocol import taken_from
from fecloth.terms.step_difference import StepDifference

# How many gaps more than it had a node may be moved away from a shape that deforms, so that no
# point inside a triangle is left in the shape. Chosen: the way is doubled up to it.
MOST_GAPS_MORE = 32


@dataclass(frozen=True, eq=False)
class BoundObstacle(BoundContact):
    """`Obstacle` on a cloth.

    Attributes
    ----------
    near
        The points near its shape.
    friction, restitution
        As of the obstacle.
    stiffness
        κ [Pa].
    last
        Where friction sticks; None before a run.
    """

    near: NearPoints
    stiffness: float
    friction: float
    restitution: float
    last: Touched | None = None

    name = "Obstacle"
    body = shape = taken_from("near.shape")
    gap = taken_from("near.gap")
    points = taken_from("near.points")
    touching = taken_from("near.touching")
    placed_nodes = taken_from("near.placed_nodes")

    def normal_force(self, contacts: Contacts) -> np.ndarray:
        """Return −κ A b′(d/gap) (p,) [N]; times ∇d it is the push on a point."""
        return self.stiffness * contacts.areas * barrier.pressure(contacts.s)

    def barrier(self, x: np.ndarray, t: float) -> float:
        """Σ κ gap A b(d/gap) [J]; +∞ if a point is inside."""
        total = 0.0
        for contacts in self.touching(x, t):
            total += float((contacts.areas * barrier.value(contacts.s)).sum())
        return self.stiffness * self.gap * total

    def add_push(self, x: np.ndarray, t: float, f: np.ndarray) -> None:
        """f (n, 3) −= κ A b′ ∇d [N]; NaN if a point is inside."""
        for contacts in self.touching(x, t):
            if contacts.s.min() <= 0.0:  # inside, where the barrier has no force
                f += np.nan
                return
            gradient, _ = contacts.slopes
            contacts.add_force(self.normal_force(contacts)[:, None] * gradient, f)

    def add_push_tangent(self, x, t, wx, J, definite) -> None:
        """J += wx κ A (b″/gap ∇d ∇dᵀ + b′ ∇²d) [N/m].

        The second part, in which b′ is negative, is left out if `definite`.
        """
        for contacts in self.touching(x, t):
            gradient, hessian = contacts.slopes
            normal_stiffness = self.stiffness / self.gap * contacts.areas
            normal_stiffness *= barrier.curvature(contacts.s)
            K = normal_stiffness[:, None, None] * gradient[:, :, None] * gradient[:, None, :]
            if not definite:
                K -= self.normal_force(contacts)[:, None, None] * hessian
            contacts.add_tangent(wx * K, J)

    def grips(self, x: np.ndarray, t: float, forces: np.ndarray = NO_FORCES) -> Sequence[Grips]:
        all_grips = []
        begin = 0
        for contacts in self.touching(x, t):
            gradient, _ = contacts.body_slopes
            # The length of ∇d is not 1 where the distance is a formula.
            length = np.sqrt(np.einsum("mi,mi->m", gradient, gradient))
            end = begin + len(length)
            push = forces[begin:end] if len(forces) else self.normal_force(contacts) * length
            stiffness = STICK_OVER_BARRIER * self.stiffness / self.gap * contacts.areas
            all_grips.append(Grips(contacts, gradient / length[:, None], push, stiffness))
            begin = end
        return all_grips

    def work_of_shape(self, y: np.ndarray, x: np.ndarray, before: float, t: float) -> float:
        """Return the work [J] on the cloth by a shape that deforms; 0 for all other shapes.

        It is the push at the end, times the change of the distance by the deformation alone, at
        the places y (n, 3) in the frame of the body, where the cloth was at the time `before`.
        """
        if not self.shape.deforms:
            return 0.0
        work = 0.0
        for contacts in self.touching(x, t):
            places = contacts.points.values(y, contacts.point_numbers)
            change = self.shape.distance(places, t) - self.shape.distance(places, before)
            work -= float(self.normal_force(contacts) @ change)  # a shape that grows: change < 0
        return work

    def find_touches(self, old: Any, new: Any, h: float) -> Touches | None:
        kinds = [self._touching(contacts, old, new, h) for contacts in self.touching(new.x, new.t)]
        if not any(kind.pushed.any() for kind in kinds):
            return None
        return Touches.join(kinds)

    def _touching(self, contacts: Contacts, old: Any, new: Any, h: float) -> Touches:
        """The points of one kind that touch; see `find_touches`.

        At the begin of the step, points opened along the normal at that place. Those outside of
        the gap opened along the normal at the end.
        """
        numbers = contacts.point_numbers
        gradient, _ = contacts.slopes
        length = np.linalg.norm(gradient, axis=1)  # not 1 where the distance is a formula
        n = gradient / length[:, None]
        pose = self.shape.pose(old.t)
        begins = contacts.points.values(old.x, numbers)
        y = pose.to_body(begins)
        was_outside = self.shape.distance(y, old.t) >= self.gap
        n_at_begin = np.where(was_outside[:, None], n, self.shape.gradient(y, old.t) @ pose.R.T)
        n_at_begin /= np.linalg.norm(n_at_begin, axis=1)[:, None]
        growth = np.zeros(len(n))  # speed of the surface of a shape that deforms, its mean
        if self.shape.deforms:
            change = contacts.s * self.gap - self.shape.distance(contacts.y, old.t)
            growth = -change / (new.t - old.t) / length
        relative = contacts.points.values(old.v, numbers) - self.shape.velocity(begins, old.t)
        v = self.shape.velocity(contacts.points.values(new.x, numbers), new.t)
        nodes, weights = contacts.points.weights(numbers)
        of_place = np.repeat(np.arange(len(nodes)), nodes.shape[1])
        shape = (len(nodes), len(old.x))
        return Touches(
            rows=gradients(
                sparse.csr_matrix((weights.ravel(), (of_place, nodes.ravel())), shape=shape), n
            ),
            surface=np.einsum("pi,pi->p", n, v) + growth,
            before=np.einsum("pi,pi->p", n_at_begin, relative) - growth,
            pushed=h * self.normal_force(contacts) * length,
            restitution=np.full(len(n), self.restitution),
        )

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no point passes into the obstacle up to x + α s."""
        y, node_distances = self.placed_nodes(x, t)
        way = self.shape.pose(t).to_body(x + s) - y
        return self._free_part(self.points, y, node_distances, way, t)

    def _free_part(
        self,
        kinds: Sequence[Points],
        y: np.ndarray,
        node_distances: np.ndarray,
        way: np.ndarray,
        t: float,
    ) -> float:
        """Return the part in [0, 1] of the nodes' ways on which no point enters the shape.

        The ways (n, 3) are displacements [m] of the nodes from y (n, 3), where they have the
        distances `node_distances` (n,) [m]. All is in the frame of the body, and the shape is
        taken at the time t.
        """
        free_part = 1.0
        # `advance` limits no point that stays farther away than the gap.
        reach = np.sqrt(np.einsum("ni,ni->n", way, way)) + self.gap
        for points in kinds:
            point_numbers = points.candidates(node_distances, reach)
            if len(point_numbers):
                places = points.values(y, point_numbers)
                ways = points.values(way, point_numbers)
                parts = advance(self.shape, places, ways, t, self.gap)
                free_part = min(free_part, float(parts.min()))
        return free_part

    def begin(self, step: StepDifference, t: float) -> np.ndarray:
        begin = self.shape.pose(step.t).to_body(step.start)
        if self.shape.deforms:
            return self._move_nodes_out(begin, before=step.t, t=t)
        return begin

    def parts(self, begin: np.ndarray, end: np.ndarray, t: float) -> np.ndarray:
        return advance(self.shape, begin, end - begin, t, self.gap)

    def free_part(self, begin: np.ndarray, end: np.ndarray, t: float) -> float:
        inner_points = self.points[1:]  # the nodes have been stopped one by one (`parts`)
        if not inner_points:
            return 1.0
        node_distances = self.shape.distance(begin, t)
        return self._free_part(inner_points, begin, node_distances, end - begin, t)

    def allows(self, x: np.ndarray, t: float) -> bool:
        return self.least_distance(x, t) > 0.0

    def leaps(self, old: Any, x: np.ndarray, t: float) -> bool:
        """Whether a point passes through the shape on its straight way in the shape's frame."""
        begin = self.shape.pose(old.t).to_body(old.x)
        end = self.shape.pose(t).to_body(x)
        node_distances = self.shape.distance(begin, t)
        way = end - begin
        # A node that moves by less than its distance does not even touch the shape.
        reach = np.sqrt(np.einsum("ni,ni->n", way, way))
        for points in self.points:
            point_numbers = points.candidates(node_distances, reach)
            a = points.values(begin, point_numbers)
            b = points.values(end, point_numbers)
            if goes_through(self.shape, a, b, t).any():
                return True
        return False

    def room(self, x: np.ndarray, t: float) -> np.ndarray:
        return self.placed_nodes(x, t)[1]

    def struck(self, x, end, t, dt, held) -> np.ndarray:
        """Return the nodes `held` by pins that are inside the shape at `end`, at t + dt.

        With them are the nodes of a point inside, if pins hold all of them.
        """
        y = self.shape.pose(t + dt).to_body(end)
        struck_nodes = []
        for points in self.points:
            point_numbers = points.between(held)
            is_inside = self.shape.distance(points.values(y, point_numbers), t + dt) <= 0.0
            struck_nodes.append(points.nodes(point_numbers[is_inside]))
        return np.unique(np.concatenate(struck_nodes))

    def _move_nodes_out(self, y: np.ndarray, before: float, t: float) -> np.ndarray:
        """Return nodes y (n, 3), moved out of a shape that deforms, as it is at the time t.

        The nodes are in the frame of the shape. They get the distance that they had at the time
        `before`, but no more than a gap. If points inside triangles are still in the shape then,
        all nodes get 1, 2, 4, … gaps more. With `MOST_GAPS_MORE` the result is returned as it
        is, perhaps with points inside.
        """
        shape = self.shape
        pose = self.shape.pose(t)
        wanted_distances = np.minimum(shape.distance(y, before), self.gap)
        gaps_more = 0
        while True:
            moved = move_out(shape, y, wanted_distances + gaps_more * self.gap, t)
            is_outside = self.least_distance(pose.to_space(moved), t) > 0.0
            if is_outside or gaps_more == MOST_GAPS_MORE:
                return moved
            gaps_more = max(1, 2 * gaps_more)

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """Return the least distance [m] of all points from the shape; negative inside."""
        y_of_nodes, node_distances = self.placed_nodes(x, t)
        least = float(node_distances.min())
        for points in self.points[1:]:  # the points inside triangles, if there are any
            point_numbers = points.candidates(node_distances, least)
            if len(point_numbers):
                y = points.values(y_of_nodes, point_numbers)
                least = min(least, float(self.shape.distance(y, t).min()))
        return least

    def mean_distance(self, x: np.ndarray, t: float) -> float:
        """Return the mean distance [m] of the points that it pushes; NaN if it pushes none.

        Each distance is weighted with the normal force at the point.
        """
        total_force = 0.0
        force_times_distance = 0.0
        for contacts in self.touching(x, t):
            push = self.normal_force(contacts)
            total_force = total_force + push.sum()
            force_times_distance = force_times_distance + push @ contacts.s * self.gap
        if total_force == 0.0:
            return math.nan
        return float(force_times_distance / total_force)

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) velocity [m/s] of the nodes in the gap, along and relative to the surface.

        All other nodes have 0.
        """
        slip = np.zeros_like(x)
        pose = self.shape.pose(t)
        y = pose.to_body(x)
        nodes_in_gap = np.flatnonzero(self.shape.distance(y, t) < self.gap)
        gradient, _ = self.shape.slopes(y[nodes_in_gap], t)
        n = gradient @ pose.R.T
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        relative_v = v[nodes_in_gap] - self.shape.velocity(x[nodes_in_gap], t)
        slip[nodes_in_gap] = along(n, relative_v)
        return slip

    def surface(self, t: float, place: np.ndarray, reach: float) -> Triangles:
        return surface_of(self.shape, t, place, reach)

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        refuse_inside(self.shape, self.points, self.gap, x, t, where)
