"""Self-contact over a step: a first guess without intersections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fecloth.terms.step_difference import StepDifference

if TYPE_CHECKING:
    from fecloth.terms.contact.self_contact import BoundSelfContact


@dataclass(frozen=True, eq=False)
class SelfContactOverStep:
    """`SelfContact` over a step that ends at x."""

    contact: BoundSelfContact
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
