"""What all contact has in common: a barrier with friction, at one state and over a step.

A subclass of `BoundContact` has the barrier, and says what slides: `BoundObstacle` for shapes,
`BoundTriangleContact` for meshes and the cloth itself. Here both parts are put together.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.contact.friction import Sliding
from fecloth.terms.contact.guess import Way
from fecloth.terms.contact.shape import TimeDifference
from fecloth.terms.contact.touches import Touches
from fecloth.terms.protocol import BoundTerm, taken_from
from fecloth.terms.records import remembered
from fecloth.terms.step_difference import StepDifference

Rubbing = Iterable[tuple[Any, np.ndarray]]  # each `Sliding`, and its velocities w


@remembered
@dataclass(frozen=True, eq=False)
class Touched:
    """The last step: friction has its λ and directions at its end.

    Attributes
    ----------
    place
        Positions (n, 3) at the end of the step [m].
    start
        Positions (n, 3) at its begin [m].
    begin
        Time at its begin [s].
    dt
        Its size [s].
    """

    place: np.ndarray
    start: np.ndarray
    begin: float
    dt: float


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
    """

    friction: float
    gap: float
    body: Any
    restitution: float

    has_energy = True
    stores_strain = False
    needs_end = "the barrier must hold at the end of a step"

    @property
    def velocity_dependent(self) -> bool:
        return self.friction > 0.0

    dissipative = velocity_dependent
    needs_path = velocity_dependent
    lags = velocity_dependent

    @property
    def supplies(self) -> bool:
        """Whether it moves, and so does work."""
        return self.body is not None and self.body.moves

    # --- what a subclass has ------------------------------------------------------------------

    def find_touches(self, old: Any, new: Any, h: float) -> Touches | None:
        """What it touches at the end of a step of time from the `State` old to new.

        `h` is `StepDifference.h` [s]: over the step the barrier has given h times its force.
        """
        raise NotImplementedError

    def lag(self, x: np.ndarray, t: float, difference: TimeDifference | None) -> Sequence[Sliding]:
        """What slides at the positions x (n, 3) and the time t.

        The velocity of the surface is by the `difference`, or with None that at t.
        """
        raise NotImplementedError

    def add_forces(self, x: np.ndarray, t: float, rubbing: Rubbing, f: np.ndarray) -> None:
        """f (n, 3) += the force [N] of the barrier, and of friction."""
        raise NotImplementedError

    def add_tangents(
        self,
        x: np.ndarray,
        t: float,
        wx: float,
        rubbing: Rubbing,
        weight: float,
        J: BlockMatrix,
        definite: bool,
    ) -> None:
        """J += wx K of the barrier, and `weight` D of friction."""

    def couplings(
        self, x: np.ndarray, t: float, wx: float, rubbing: Rubbing, weight: float, definite: bool
    ) -> sparse.spmatrix | None:
        """(3n, 3n) the part of `add_tangents` outside the fixed pattern; None without any."""
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

    # --- at one state -------------------------------------------------------------------------

    def rubbing(self, x: np.ndarray, v: np.ndarray, t: float) -> Rubbing:
        """What slides at one state, with its velocities."""
        if not self.friction:
            return ()
        return [(sliding, sliding.slip(sliding.values(v))) for sliding in self.lag(x, t, None)]

    def add_force(self, x, v, t, f) -> None:
        """f += the force of the barrier, and friction [N].

        At v = 0 it is the derivative of the energy: the friction of an obstacle that moves
        past a cloth at rest is left out.
        """
        rubbing: Rubbing = ()
        if v.any():
            rubbing = self.rubbing(x, v, t)
        self.add_forces(x, t, rubbing, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K of the barrier, and wv D of friction."""
        self.add_tangents(x, t, wx, self.rubbing(x, v, t), wv, J, definite)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ μ λ f₁(y) y of friction [W]."""
        return sum(sliding.power(w) for sliding, w in self.rubbing(x, v, t))

    def work_of_shape(self, y: np.ndarray, x: np.ndarray, before: float, t: float) -> float:
        """Return the work [J] on the cloth by a shape that deforms from the time `before` to t.

        The cloth is at y (n, 3) at the time `before`, in the frame of the body, and at x (n, 3)
        in space at the time t.
        """
        return 0.0

    @property
    def keeps_history(self) -> bool:
        """Whether a step depends on the step before."""
        return self.friction > 0.0

    def start_history(self, x: np.ndarray, t: float) -> Touched | None:
        if self.keeps_history:
            return Touched(place=x, start=x, begin=t, dt=1.0)
        return None

    def over_step(self, step: StepDifference) -> BoundTerm:
        return ContactOverStep(self, step)


@dataclass(frozen=True, eq=False)
class ContactOverStep(BoundTerm):
    """A contact over a step that ends at x; friction has the potential h Σ μ λ f₀(y).

    λ and the directions of sliding are taken at the end of the last step, if that was
    committed. The velocity is the method's difference. Over an `Increment` of the loads it is
    the way over the increment, divided by its size.
    """

    contact: BoundContact
    step: StepDifference

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
    def last(self) -> Touched:
        """The record of the step before; in a first step, of a cloth at rest at the start."""
        start = self.step.start
        t = self.step.t
        if self.step.history:
            return self.step.history
        return Touched(place=start, start=start, begin=t, dt=1.0)

    def commit(self, x: np.ndarray, t: float) -> Touched | None:
        """Return the record of this step, which ends at x and t; None if none is needed."""
        if not self.contact.keeps_history:
            return None
        step = self.step
        return Touched(place=x, start=step.start, begin=step.t, dt=step.dt)

    def touches(self, old: Any, new: Any) -> Touches | None:
        return self.contact.find_touches(old, new, self.step.h)

    @cached_property
    def sliding(self) -> Sequence[Sliding]:
        """What slides over the step, with fixed normal forces and directions of sliding.

        In a step of time, these are taken at its begin, where the last step ended. In an
        increment of the loads they are taken at the end of the increment, as far as it is known
        from the iteration before (`Increment.place`), and else at its begin.
        """
        if not self.contact.friction:
            return ()
        step = self.step
        end = self.end
        difference = difference_in_time(step)
        if not step.increment:
            return self.contact.lag(self.last.place, step.t, difference)
        if step.increment.place is None:
            return self.contact.lag(step.start, step.t, difference)
        return self.contact.lag(step.increment.place, end, difference)

    @cached_property
    def past(self) -> Sequence[np.ndarray]:
        """Σ cᵢ xᵢ [m] at the points of each `Sliding`."""
        past = np.add.reduce([weight * x for weight, x in self.step.past])
        return [sliding.values(past) for sliding in self.sliding]

    def rubbing(self, x: np.ndarray) -> Rubbing:
        """What slides, with its velocities by the method's difference."""
        h = self.step.h
        for sliding, past in zip(self.sliding, self.past, strict=True):
            yield sliding, sliding.slip((sliding.values(x) - past) / h)

    def energy(self, x, t) -> float:
        """The energy of the barrier, and h Σ μ λ f₀(y) [J]."""
        energy: float = self.contact.energy(x, t)
        for sliding, w in self.rubbing(x):
            energy += self.step.h * sliding.rate(w)
        return energy

    def add_force(self, x, v, t, f) -> None:
        """f += the force of the barrier at rest, and −μ λ f₁(y)/y w [N]."""
        self.contact.add_forces(x, t, self.rubbing(x), f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; the part of friction is positive semi-definite."""
        weight = wx / self.step.h
        self.contact.add_tangents(x, t, wx, self.rubbing(x), weight, J, definite)

    def coupling(self, x, v, t, wx, wv, definite):
        weight = wx / self.step.h
        return self.contact.couplings(x, t, wx, self.rubbing(x), weight, definite)

    def dissipation(self, x: np.ndarray) -> float:
        """Return the energy [J] that friction dissipates in a step that ends at x.

        It is dt Σ μ λ f₁(y) y, with the mean velocities over the step.
        """
        power = 0.0
        step = self.step
        sliding = self.sliding
        if self.contact.supplies and not step.increment:  # what it slides on moves
            mean = mean_in_time(step)
            sliding = self.contact.lag(self.last.place, step.t, mean)
        for each in sliding:
            way = each.values(x) - each.values(step.start)
            power += each.power(each.slip(way / step.dt))
        return step.dt * power

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
        begin_in_body = contact.body.pose(self.step.t).to_body(start)
        f = np.zeros_like(x)
        self.add_force(x, start, t, f)  # its second argument, the velocity, is not used
        carried_way = contact.body.pose(t).to_space(begin_in_body) - start
        work_of_shape = contact.work_of_shape(begin_in_body, x, before=self.step.t, t=t)
        return float((f * carried_way).sum()) + work_of_shape

    def way(self, t: float) -> Way:
        begin = self.contact.begin(self.step, t)
        return Way(contact=self.contact, begin=begin, start=self.step.start, t=t)


def difference_in_time(step: StepDifference) -> TimeDifference:
    """The method's difference of a function of time, for what the cloth slides on.

    The first of the places of `past` is the begin of the step. A second one, of BDF2, is before
    it: where the difference of the time itself is 1. Over an increment of the loads it is the
    mean from its begin to its end, and nothing if it has no size.
    """
    end = step.end
    if step.increment and end == step.t:
        return ()
    if step.increment or len(step.past) != 2:
        return mean_in_time(step)
    (at_begin, _), (before, _) = step.past
    time_before = step.t + (step.dt - step.h) / before
    return (1 / step.h, end), (-at_begin / step.h, step.t), (-before / step.h, time_before)


def mean_in_time(step: StepDifference) -> TimeDifference:
    """The mean rate of a function of time over the step."""
    size = step.end - step.t
    return (1 / size, step.end), (-1 / size, step.t)
