"""What all contact has in common: a barrier with friction, at one state and over a step.

A subclass of `BoundContact` has the barrier, and says what slides: `BoundObstacle` for shapes,
`BoundTriangleContact` for meshes and the cloth itself. Here both parts are put together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.sparse as sparse

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.contact.friction import MOST_STRETCH_OVER_GAP, Friction, Grips, Springs
from fecloth.terms.contact.guess import Way
from fecloth.terms.contact.touches import Touches
from fecloth.terms.last_states import LastStates
from fecloth.terms.protocol import BoundTerm, taken_from
from fecloth.terms.records import remembered
from fecloth.terms.sliders import Sliders
from fecloth.terms.step_difference import StepDifference

NO_FORCES = np.zeros(0)
NO_STRETCH = np.zeros((0, 3))


@remembered
@dataclass(frozen=True, eq=False)
class Touched:
    """Where friction sticks at the end of a step.

    Attributes
    ----------
    place
        Positions (n, 3) at the end of the step [m].
    t
        The time then [s].
    stretch
        e (p, 3) [m] of the springs to the anchors, in the frame of the body, at all places that
        touch then, in the order of `BoundContact.find_touches`. Empty where all are 0.
    forces
        The mean normal forces (p,) [N] over the step at these places; empty where they are not
        known.
    """

    place: np.ndarray
    t: float
    stretch: np.ndarray = field(default_factory=lambda: NO_STRETCH)
    forces: np.ndarray = field(default_factory=lambda: NO_FORCES)


class BoundContact(BoundTerm):
    """A contact on a cloth.

    Attributes
    ----------
    friction
        Coefficient μ of Coulomb's friction.
    gap
        Distance at which the barrier begins [m].
    body
        The `Shape` with which it moves and turns; None where it does not move.
    restitution
        Part of the speed that an impact leaves.
    last
        Where friction sticks; None before a run: then there is no friction.
    """

    friction: float
    gap: float
    body: Any
    restitution: float
    last: Touched | None

    symmetric = True
    has_energy = True
    stores_strain = False
    couples_nodes = False
    needs_end = "the barrier must hold at the end of a step"

    @property
    def dissipative(self) -> bool:
        return self.friction > 0.0

    needs_path = dissipative
    lags = dissipative

    @property
    def supplies(self) -> bool:
        """Whether it moves, and so does work."""
        return self.body is not None and self.body.moves

    # --- what a subclass has ------------------------------------------------------------------

    def find_touches(self, old: Any, new: Any, h: float) -> Touches | None:
        """What it touches at the end of a step of time from the `State` old to new.

        Over the step the barrier has changed the momentum by h [s] times its force. None where
        nothing pushes.
        """
        raise NotImplementedError

    def grips(self, x: np.ndarray, t: float, forces: np.ndarray = NO_FORCES) -> Sequence[Grips]:
        """What touches at x (n, 3) and t, in the order of `find_touches`.

        The normal forces are the forces of the barrier, or the `forces` (p,) [N] of `Touched`.
        """
        raise NotImplementedError

    def barrier(self, x: np.ndarray, t: float) -> float:
        """The energy of the barrier [J]; +∞ if a point is inside."""
        raise NotImplementedError

    def add_push(self, x: np.ndarray, t: float, f: np.ndarray) -> None:
        """f (n, 3) += the force of the barrier [N]; NaN if a point is inside."""
        raise NotImplementedError

    def add_push_tangent(
        self, x: np.ndarray, t: float, wx: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K of the barrier."""

    def push_coupling(
        self, x: np.ndarray, t: float, wx: float, definite: bool
    ) -> sparse.spmatrix | None:
        """(3n, 3n) the part of wx K outside the fixed pattern; None without any."""
        return None

    # --- the first guess of a step; positions are in the frame of the body ---------------------

    def begin(self, step: StepDifference, t: float) -> np.ndarray:
        """Positions (n, 3) at the begin of the step that ends at t."""
        raise NotImplementedError

    def parts(self, begin: np.ndarray, end: np.ndarray, t: float) -> np.ndarray:
        """The part (n,) in [0, 1] of the way that each node may go by itself."""
        return np.ones(len(begin))

    def free_part(self, begin: np.ndarray, end: np.ndarray, t: float) -> float:
        """The largest part ≤ 1 of the way of all nodes on which no triangle meets anything."""
        raise NotImplementedError

    def room(self, x: np.ndarray, t: float) -> np.ndarray:
        """(n,) distances [m] from a shape of nodes at x (n, 3) in space; infinite without one."""
        return np.full(len(x), np.inf)

    def struck(
        self, x: np.ndarray, end: np.ndarray, t: float, dt: float, held: np.ndarray
    ) -> np.ndarray:
        """Return the nodes, among those `held` by pins, that pins move into something.

        The way goes from x at the time t to `end` at t + dt. A point between nodes counts, too,
        if all of these nodes are held: then they are returned.
        """
        raise NotImplementedError

    # --- friction -----------------------------------------------------------------------------

    def rotation(self, t: float) -> np.ndarray:
        """R (3, 3) from the frame of the body to space."""
        if self.body is None:
            return np.eye(3)
        R: np.ndarray = self.body.pose(t).R
        return R

    def carried(self, x: np.ndarray, begin: float, end: float) -> np.ndarray:
        """Positions (n, 3) to which the body takes x (n, 3) from one time to another [m]."""
        if self.body is None:
            return x
        y: np.ndarray = self.body.pose(end).to_space(self.body.pose(begin).to_body(x))
        return y

    def spring(
        self, last: Touched, t: float, now: np.ndarray | None = None, holds: bool = False
    ) -> Friction:
        """The springs at the time t, with the anchors of the record `last`.

        λ and the normals are the ones of the record, or the ones at the positions `now` (n, 3)
        at t.
        If it `holds`, no spring slides at the record's place.
        """
        if not self.friction:
            return Friction()
        grips = self.grips(last.place, last.t, last.forces)
        stretch = last.stretch
        if not len(stretch):
            stretch = np.zeros((sum(len(each.n) for each in grips), 3))
        ends = np.cumsum([len(each.n) for each in grips], dtype=int)
        stretches = np.split(stretch, ends[:-1]) if len(grips) else []
        if now is not None:
            before = grips
            grips = self.grips(now, t)
            stretches = [each.hand_on(before, stretches) for each in grips]
        R = self.rotation(t)
        carried = self.carried(last.place, last.t, t)
        springs = []
        for each, e in zip(grips, stretches, strict=True):
            limit = self.friction * each.push
            stiffness = each.stiffness
            if holds:
                limit = np.maximum(limit, stiffness * np.linalg.norm(e, axis=1))
            else:
                stiffness = np.maximum(stiffness, limit / (MOST_STRETCH_OVER_GAP * self.gap))
            sliders = Sliders.of_contact(limit, stiffness)
            anchors = each.places.values(carried) - e @ R.T
            springs.append(Springs(each, each.n @ R.T, anchors, sliders))
        return Friction(springs)

    def held(self, t: float) -> Friction:
        """The springs between two steps."""
        if self.last is None:
            return Friction()
        return self.spring(self.last, t, holds=True)

    def settle(self, friction: Friction, x: np.ndarray, t: float) -> tuple[float, Touched]:
        """Return the heat [J] of a step with this `friction`, and its record.

        The step ends at x (n, 3) at the time t. Anchors have followed the places that slid; those
        of places that do not touch any more are dropped, and what their springs had stored is
        heat.
        """
        heat = 0.0
        left = []
        for each in friction.springs:
            e = each.stretch(x)
            kept = each.sliders.left(e)
            left.append(kept @ self.rotation(t))
            heat += float((each.sliders.heat(e) + each.sliders.energy(kept)).sum())
        stretches = [NO_STRETCH]
        for grips in self.grips(x, t):
            e = grips.hand_on([each.grips for each in friction.springs], left)
            stretches.append(e)
            heat -= grips.stored(e)
        return heat, Touched(place=x, t=t, stretch=np.concatenate(stretches))

    # --- at one state -------------------------------------------------------------------------

    def energy(self, x, t) -> float:
        """The energy of the barrier, and what the springs of friction store [J]."""
        return self.barrier(x, t) + self.held(t).energy(x)

    def add_force(self, x, v, t, f) -> None:
        """f += the force of the barrier, and of the springs of friction [N]."""
        self.add_push(x, t, f)
        self.held(t).add_force(x, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K."""
        self.add_push_tangent(x, t, wx, J, definite)
        self.held(t).add_tangent(x, wx, J)

    def coupling(self, x, v, t, wx, wv, definite) -> sparse.spmatrix | None:
        """wx K outside the fixed pattern."""
        return join(self.push_coupling(x, t, wx, definite), self.held(t).couplings(x, wx))

    def push(self, x: np.ndarray, t: float) -> np.ndarray:
        f = np.zeros_like(x)
        self.add_push(x, t, f)
        return f

    def power(self, x, v, t) -> float:
        """Zero: no force depends on v. `dissipation` is the heat of a step."""
        return 0.0

    def work_of_shape(self, y: np.ndarray, x: np.ndarray, before: float, t: float) -> float:
        """Return the work [J] on the cloth by a shape that deforms from the time `before` to t.

        The cloth is at y (n, 3) at the time `before`, in the frame of the body, and at x (n, 3)
        in space at the time t.
        """
        return 0.0

    def start_history(self, x: np.ndarray, t: float) -> Touched | None:
        return Touched(place=x, t=t) if self.friction else None

    def with_history(self, record: Touched) -> Self:
        return replace(self, last=record)  # type: ignore[type-var]  # a subclass is a dataclass

    def over_step(self, step: StepDifference) -> BoundTerm:
        return ContactOverStep(self, step)


def join(
    first: sparse.spmatrix | None, others: Sequence[sparse.spmatrix]
) -> sparse.spmatrix | None:
    """The sum of matrices; None without any."""
    parts = list(others) if first is None else [first, *others]
    return sum(parts[1:], start=parts[0]) if parts else None


@dataclass(frozen=True, eq=False)
class ContactOverStep(BoundTerm):
    """A contact over a step that ends at x; friction has the potential of its springs.

    λ and the directions of sliding are taken at the end of the last step, or over an `Increment`
    of the loads at its end, as far as it is known from the iteration before (`Increment.place`).
    Over a step the tangent of sliding friction is a secant, unless it is asked to be `exact`.
    """

    contact: BoundContact
    step: StepDifference
    exact: bool = False

    symmetric = True
    has_energy = True
    stores_strain = False
    name = taken_from("contact.name")
    couples_nodes = taken_from("contact.couples_nodes")
    limit = taken_from("contact.limit")
    dissipates_over_step = taken_from("contact.dissipative")
    needs_path = taken_from("contact.needs_path")
    end = taken_from("step.end")
    lags = needs_path

    @cached_property
    def friction(self) -> Friction:
        """The springs of friction over the step, with fixed normal forces and directions."""
        step = self.step
        last = step.history or Touched(place=step.start, t=step.t)
        now = step.increment.place if step.increment else None
        is_exact = self.exact or step.increment is not None
        return self.contact.spring(last, step.end, now)._replace(exact=is_exact)

    def with_exact_tangent(self) -> BoundTerm:
        return replace(self, exact=True) if self.needs_path else self

    @cached_property
    def settled(self) -> LastStates[tuple[float, Touched]]:
        """Of x and t: the heat [J] of the step, and its record."""
        return LastStates(lambda x, t: self.contact.settle(self.friction, x, t))

    def commit(self, x: np.ndarray, t: float) -> Touched | None:
        """Return the record of this step, which ends at x; None without friction."""
        if not self.contact.friction:
            return None
        return self.settled(x, self.end)[1]

    def touches(self, old: Any, new: Any, h: float) -> Touches | None:
        return self.contact.find_touches(old, new, h)

    def energy(self, x, t) -> float:
        """The energy of the barrier, and Σ φ(e) [J]."""
        return self.contact.barrier(x, t) + self.friction.energy(x)

    def add_force(self, x, v, t, f) -> None:
        """f += the force of the barrier, and −∂φ/∂x [N]."""
        self.contact.add_push(x, t, f)
        self.friction.add_force(x, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; the part of friction is positive semi-definite."""
        self.contact.add_push_tangent(x, t, wx, J, definite)
        self.friction.add_tangent(x, wx, J)

    def coupling(self, x, v, t, wx, wv, definite):
        return join(self.contact.push_coupling(x, t, wx, definite), self.friction.couplings(x, wx))

    def dissipation(self, x: np.ndarray) -> float:
        """Return the heat [J] of friction in a step that ends at x."""
        if not self.contact.friction:
            return 0.0
        return self.settled(x, self.end)[0]

    def work(self, x: np.ndarray) -> float:
        """Return the work [J] of the body on the cloth over the step; 0 without a body.

        It is the force at the end x of the step times the way on which the body carries the
        nodes from their positions at its begin, plus the work of a shape that deforms.
        """
        contact = self.contact
        start = self.step.start
        t = self.end
        if contact.body is None:
            return 0.0
        f = np.zeros_like(x)
        self.add_force(x, start, t, f)  # its second argument, the velocity, is not used
        carried_way = contact.carried(start, self.step.t, t) - start
        begin_in_body = contact.body.pose(self.step.t).to_body(start)
        work_of_shape = contact.work_of_shape(begin_in_body, x, before=self.step.t, t=t)
        return float((f * carried_way).sum()) + work_of_shape

    def way(self, t: float) -> Way:
        begin = self.contact.begin(self.step, t)
        return Way(contact=self.contact, begin=begin, start=self.step.start, t=t)
