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
        """x (n, 3), or the place on the straight way from the begin of the step where it stops."""
        way = x - self.step.start
        part = self.contact.limit(self.step.start, way, t)
        return x if part == 1.0 else self.step.start + part * way


@dataclass(frozen=True, eq=False)
class RubbedContactOverStep(ContactOverStep):
    """The same with friction, over a step: the potential h Σ μ λ f₀(y) of sliding velocities.

    λ and the directions are those at the begin of the step, and the velocity is the method's
    difference.
    """

    @cached_property
    def lagged(self) -> Any:
        """The friction of all contacts at the begin of the step."""
        return self.contact.sets.lag(self.step.start, self.contact.friction)

    @cached_property
    def past(self) -> np.ndarray:
        """(n, 3) Σ cᵢ xᵢ [m]."""
        return np.add.reduce([weight * x for weight, x in self.step.past])

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """(n, 3) the method's difference [m/s]."""
        return (x - self.past) / self.step.h

    def energy(self, x, t) -> float:
        """That of the barrier, and h Σ μ λ f₀(y) [J]."""
        sets, creep = self.contact.sets, self.contact.creep
        return sets.energy(x) + self.step.h * sets.rub(self.lagged, self.velocity(x), creep)[0]

    def add_force(self, x, v, t, f) -> None:
        """f += the forces of the barrier and of friction [N]."""
        sets, creep = self.contact.sets, self.contact.creep
        f += sets.force(x) + sets.rub(self.lagged, self.velocity(x), creep)[1]

    def coupling(self, x, v, t, wx, wv, definite):
        """wx K of both."""
        sets, creep = self.contact.sets, self.contact.creep
        parts = [sets.tangent(x, definite)]
        D = sets.rub_slope(self.lagged, self.velocity(x), creep)
        parts += [] if D is None else [D / self.step.h]
        found = [wx * part for part in parts if part is not None]
        return sum(found[1:], start=found[0]) if found else None

    def dissipation(self, x: np.ndarray) -> float:
        """dt Σ μ λ f₁(y) y [J] with the velocity over the step, (x − x₀)/dt."""
        v = (x - self.step.start) / self.step.dt
        force = self.contact.sets.rub(self.lagged, v, self.contact.creep)[1]
        return -self.step.dt * float((force * v).sum())
