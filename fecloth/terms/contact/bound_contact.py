"""What obstacles, meshes and the cloth itself have in common: a barrier with friction, over a step.

A subclass of `BoundContact` has the barrier, and says what slides; here that is put together,
for one state and for a step.
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
from fecloth.terms.protocol import BoundTerm, taken_from
from fecloth.terms.records import remembered
from fecloth.terms.step_difference import StepDifference

Rubbing = Iterable[tuple[Any, np.ndarray]]  # what slides, a `Sliding`, and its velocities w


@remembered
@dataclass(frozen=True, eq=False)
class Touched:
    """The last step: friction has its λ and directions at its end.

    With a restitution between 0 and 1 it also has, for each kind of points of an obstacle, the
    speeds (p,) [m/s] with which they came nearer when they first touched; infinite where
    unknown.
    """

    place: np.ndarray  # (n, 3) at its end [m]
    # (n, 3) [m] and the time [s] at its begin, and its size [s].
    start: np.ndarray
    begin: float
    dt: float
    speeds: tuple[np.ndarray, ...] = ()


class BoundContact(BoundTerm):
    """A contact on a cloth."""

    friction: float  # μ
    gap: float  # [m]
    body: Any  # the `Shape` with which it moves and turns; None where it does not move
    restitution: Any = 1.0  # part of the speed that an impact leaves

    has_energy = True
    stores_strain = False
    needs_end = "the barrier must hold at the end of a step"

    @property
    def velocity_dependent(self) -> bool:
        return self.friction > 0.0

    @property
    def dissipative(self) -> bool:
        return self.friction > 0.0 or self.restitution < 1.0

    @property
    def needs_path(self) -> bool:
        return self.friction > 0.0

    lags = needs_path

    @property
    def supplies(self) -> bool:
        """Whether it moves, and so does work."""
        return self.body is not None and self.body.moves

    # --- what a subclass has ----------------------------------------------------------------------

    def over(self, moved: Touched) -> BoundContact:
        """The contact over a step, in which it dissipates what an impact takes."""
        return self

    def lost(self, x: np.ndarray, t: float) -> float:
        """Energy [J] that it has dissipated over a step that ends at x, without friction."""
        return 0.0

    def speeds(self, x: np.ndarray, t: float) -> tuple[np.ndarray, ...]:
        """`Touched.speeds` after a step that ends at x."""
        return ()

    def touch_speed(self, old: Any, x: np.ndarray, t: float) -> float:
        """The largest speed [m/s] of what enters the gap over a step from the `State` old to x."""
        return 0.0

    def lag(self, x: np.ndarray, t: float, dt: float | None) -> Sequence[Sliding]:
        """What slides at the positions x (n, 3) and the time t.

        The velocity of the surface is the mean of the time dt from then on, or of −dt until
        then; for None the velocity at t.
        """
        raise NotImplementedError

    def add_forces(self, x: np.ndarray, t: float, rubbing: Rubbing, f: np.ndarray) -> None:
        """f (n, 3) += the force of the barrier, and of what rubs [N]."""
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
        """J += wx K of the barrier, and `weight` D of what rubs."""

    def couplings(
        self, x: np.ndarray, t: float, wx: float, rubbing: Rubbing, weight: float, definite: bool
    ) -> sparse.spmatrix | None:
        """The same where it couples nodes outside the fixed pattern."""
        return None

    # --- the first guess of a step; positions are in the frame of the body ------------------------

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
        """(n,) distances [m] of nodes at x (n, 3) in space from a shape; infinite without one."""
        return np.full(len(x), np.inf)

    def struck(
        self, x: np.ndarray, end: np.ndarray, t: float, dt: float, held: np.ndarray
    ) -> np.ndarray:
        """The nodes `held` that, or between which points, pass into something to `end` in dt."""
        raise NotImplementedError

    # --- at one state -----------------------------------------------------------------------------

    def rubbing(self, x: np.ndarray, v: np.ndarray, t: float) -> Rubbing:
        """What slides at one state, with its velocities."""
        sliding = self.lag(x, t, None) if self.friction else ()
        return [(each, each.slip(each.values(v))) for each in sliding]

    def add_force(self, x, v, t, f) -> None:
        """f += the force of the barrier, and friction [N].

        At v = 0 it is the derivative of the energy: the friction of an obstacle that moves
        past a cloth at rest is left out.
        """
        self.add_forces(x, t, self.rubbing(x, v, t) if v.any() else (), f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K of the barrier, and wv D of friction."""
        self.add_tangents(x, t, wx, self.rubbing(x, v, t), wv, J, definite)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ μ λ f₁(y) y of friction [W]."""
        return sum(each.power(w) for each, w in self.rubbing(x, v, t))

    def work_of_shape(self, y: np.ndarray, x: np.ndarray, before: float, t: float) -> float:
        """Work [J] on the cloth by a shape that deforms from the time `before` to t.

        The cloth is at y (n, 3) before, in the frame of the body, and at x in space at the
        end.
        """
        return 0.0

    @property
    def keeps_history(self) -> bool:
        return self.friction > 0.0 or 0.0 < self.restitution < 1.0

    def start_history(self, x: np.ndarray, t: float) -> Touched | None:
        if self.keeps_history:
            return Touched(x, x, t, 1.0, self.speeds(x, t))
        return None

    def over_step(self, step: StepDifference) -> BoundTerm:
        return ContactOverStep(self, step)


@dataclass(frozen=True, eq=False)
class ContactOverStep(BoundTerm):
    """A contact over a step that ends at x; friction has the potential h Σ μ λ f₀(y).

    What it dissipates beside has a potential too: see `restitution`.

    λ and the directions of sliding are taken at the end of the last step, where that was
    committed, and the velocity is the method's difference. Over an `Increment` of the loads it
    is the way over the increment, divided by its size; the barrier does not dissipate there.
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
        """The step before."""
        start = self.step.start
        t = self.step.t
        return self.step.history or Touched(start, start, t, 1.0, self.contact.speeds(start, t))

    @cached_property
    def acting(self) -> BoundContact:
        """The contact over this step."""
        step = self.step
        if step.increment:
            return self.contact
        return self.contact.over(Touched(step.start, step.start, step.t, step.dt, self.last.speeds))

    def commit(self, x: np.ndarray, t: float) -> Touched | None:
        if not self.contact.keeps_history:
            return None
        step = self.step
        return Touched(x, step.start, step.t, step.dt, self.acting.speeds(x, t))

    @cached_property
    def sliding(self) -> Sequence[Sliding]:
        """What slides at the begin of the step, where the cloth touched last."""
        if not self.contact.friction:
            return ()
        step = self.step
        end = self.end
        if not step.increment:
            return self.contact.over(self.last).lag(self.last.place, step.t, step.dt)
        if step.increment.place is None:
            return self.contact.lag(step.start, step.t, end - step.t)
        return self.contact.lag(step.increment.place, end, step.t - end)

    @cached_property
    def past(self) -> Sequence[np.ndarray]:
        """Σ cᵢ xᵢ [m] at the points of what slides."""
        past = np.add.reduce([weight * x for weight, x in self.step.past])
        return [each.values(past) for each in self.sliding]

    def rubbing(self, x: np.ndarray) -> Rubbing:
        """What slides, with its velocities by the method's difference."""
        begin = zip(self.sliding, self.past, strict=True)
        h = self.step.h
        return ((each, each.slip((each.values(x) - past) / h)) for each, past in begin)

    def energy(self, x, t) -> float:
        """The energy of the barrier, and h Σ μ λ f₀(y) [J]."""
        rubbing = self.rubbing(x)
        energy = self.acting.energy(x, t)
        return sum((self.step.h * each.rate(w) for each, w in rubbing), start=energy)

    def add_force(self, x, v, t, f) -> None:
        """f += the force of the barrier at rest, and −μ λ f₁(y)/y w [N]."""
        self.acting.add_forces(x, t, self.rubbing(x), f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; the part of friction is positive semi-definite."""
        weight = wx / self.step.h
        self.acting.add_tangents(x, t, wx, self.rubbing(x), weight, J, definite)

    def coupling(self, x, v, t, wx, wv, definite):
        weight = wx / self.step.h
        return self.acting.couplings(x, t, wx, self.rubbing(x), weight, definite)

    def dissipation(self, x: np.ndarray) -> float:
        """dt Σ μ λ f₁(y) y [J] with the velocity over the step, and what damping takes."""
        power = 0.0
        start = self.step.start
        dt = self.step.dt
        for each in self.sliding:
            power += each.power(each.slip((each.values(x) - each.values(start)) / dt))
        return dt * power + self.acting.lost(x, self.end)

    def work(self, x: np.ndarray) -> float:
        """Force [N] at the end times the way of the surface where the cloth began [J]."""
        contact = self.contact
        start = self.step.start
        t = self.end
        if contact.body is None:
            return 0.0
        begin = contact.body.pose(self.step.t).to_body(start)
        f = np.zeros_like(x)
        self.add_force(x, start, t, f)
        carried = contact.body.pose(t).to_space(begin) - start
        shape = self.acting.work_of_shape(begin, x, self.step.t, t)
        return float((f * carried).sum()) + shape

    def way(self, t: float) -> Way:
        return Way(self.contact, self.contact.begin(self.step, t), self.step.start, t)
