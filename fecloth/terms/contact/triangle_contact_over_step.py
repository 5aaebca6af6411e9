"""Contact between triangles over a step: a first guess without intersections, and friction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fecloth.terms.step_difference import StepDifference

if TYPE_CHECKING:
    from fecloth.terms.contact.triangle_contact import BoundTriangleContact


@dataclass(frozen=True, eq=False)
class ContactOverStep:
    """`BoundTriangleContact` over a step that ends at x."""

    contact: BoundTriangleContact
    step: StepDifference

    symmetric = True
    has_energy = True
    dissipative = False
    velocity_dependent = False
    stores_strain = False

    @property
    def name(self) -> str:
        return self.contact.name

    def energy(self, x, t) -> float:
        """That of the barrier [J]."""
        return self.contact.energy(x, t)

    def add_force(self, x, v, t, f) -> None:
        self.contact.add_force(x, v, t, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        self.contact.add_tangent(x, v, t, wx, wv, J, definite)

    def coupling(self, x, v, t, wx, wv, definite):
        return self.contact.coupling(x, v, t, wx, wv, definite)

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        return self.contact.limit(x, s, t)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        return self.contact.rate_bounds(mass)

    def admit(self, x: np.ndarray, t: float) -> np.ndarray:
        """x (n, 3), or the place on the way from the begin of the step where it stops.

        The way is straight as the fixed mesh sees it: a mesh that moves takes the cloth along.
        """
        contact = self.contact
        begin, end = contact.place(self.step.start, self.step.t), contact.place(x, t)
        part = contact.sets.free_part(begin, end)
        if part == 1.0:
            return x
        there = begin + part * (end - begin)
        return there if contact.body is None else contact.body.pose(t).to_space(there)


@dataclass(frozen=True, eq=False)
class RubbedContactOverStep(ContactOverStep):
    """The same with friction, over a step: the potential h Σ μ λ f₀(y) of sliding velocities.

    λ and the directions are those at the begin of the step, and the velocity is the method's
    difference.
    """

    @cached_property
    def lagged(self) -> Any:
        """The friction of all contacts at the begin of the step."""
        begin = self.contact.place(self.step.start, self.step.t)
        return self.contact.sets.lag(begin, self.contact.friction)

    @cached_property
    def past(self) -> np.ndarray:
        """(n, 3) Σ cᵢ xᵢ [m]."""
        return np.add.reduce([weight * x for weight, x in self.step.past])

    @cached_property
    def surface(self) -> np.ndarray | float:
        """(n, 3) mean velocity of the fixed mesh over the step, at the nodes of the cloth [m/s]."""
        body, step = self.contact.body, self.step
        if body is None:
            return 0.0
        later = body.pose(step.t + step.dt).to_space(self.contact.place(step.start, step.t))
        return (later - step.start) / step.dt

    def slip(self, v: np.ndarray) -> np.ndarray:
        """(n, 3) velocities relative to the mesh, in its frame at the begin of the step [m/s]."""
        body = self.contact.body
        return v if body is None else (v - self.surface) @ body.pose(self.step.t).R

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """(n, 3) the method's difference, relative to the mesh [m/s]."""
        return self.slip((x - self.past) / self.step.h)

    def energy(self, x, t) -> float:
        """That of the barrier, and h Σ μ λ f₀(y) [J]."""
        rubbed = self.contact.sets.rub(self.lagged, self.velocity(x), self.contact.creep)[0]
        return self.contact.energy(x, t) + self.step.h * rubbed

    def add_force(self, x, v, t, f) -> None:
        """f += the forces of the barrier and of friction [N]."""
        contact = self.contact
        rubbed = contact.sets.rub(self.lagged, self.velocity(x), contact.creep)[1]
        f += contact.push(x, t) + contact.turn(rubbed, self.step.t)

    def coupling(self, x, v, t, wx, wv, definite):
        """wx K of both."""
        contact = self.contact
        K = contact.coupling(x, v, t, wx, 0.0, definite)
        D = contact.sets.rub_slope(self.lagged, self.velocity(x), contact.creep)
        if D is None:
            return K
        D = contact.turn_matrix((wx / self.step.h) * D, self.step.t)
        return D if K is None else K + D

    def dissipation(self, x: np.ndarray) -> float:
        """dt Σ μ λ f₁(y) y [J] with the velocity over the step, (x − x₀)/dt."""
        v = self.slip((x - self.step.start) / self.step.dt)
        force = self.contact.sets.rub(self.lagged, v, self.contact.creep)[1]
        return -self.step.dt * float((force * v).sum())
