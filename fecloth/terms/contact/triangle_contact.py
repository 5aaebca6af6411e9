"""Contact between triangles, bound to a cloth: of the cloth with itself or with a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.mesh.intersections import find_intersections
from fecloth.terms.contact.toolkit import ContactSets
from fecloth.terms.contact.triangle_contact_over_step import ContactOverStep, RubbedContactOverStep
from fecloth.terms.step_difference import StepDifference

NAMED = 5  # pairs of triangles that an error names


@dataclass(frozen=True, eq=False)
class BoundTriangleContact:
    """`SelfContact` or `MeshObstacle` on a cloth.

    Attributes
    ----------
    name
        Of the term.
    sets
        The contacts at positions of the cloth.
    friction, creep
        μ, and the speed of sliding [m/s] from which friction has its full value.
    """

    name: str
    sets: ContactSets
    friction: float
    creep: float

    symmetric = True
    has_energy = True
    stores_strain = False
    needs_end = "the barrier must hold at the end of a step"

    @property
    def dissipative(self) -> bool:
        return self.friction > 0.0

    velocity_dependent = dissipative

    @property
    def no_equilibrium(self) -> str:
        """Why it has no unique equilibrium, or ""."""
        return "with friction the place of rest depends on the way there" if self.friction else ""

    def energy(self, x, t) -> float:
        """Σ κ gap A b(s) [J]."""
        return self.sets.energy(x)

    def add_force(self, x, v, t, f) -> None:
        """f −= ∂energy/∂x, and friction [N]."""
        f += self.sets.force(x)
        if self.friction and v.any():
            f += self.sets.rub(self.sets.lag(x, self.friction), v, self.creep)[1]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Add nothing: all of the tangent is in `coupling`."""

    def coupling(self, x, v, t, wx, wv, definite) -> sparse.spmatrix | None:
        """wx K of the barrier, without the negative part of each pair if `definite`, and wv D.

        How friction changes with x is left out: over a step, for which methods ask, it is lagged.
        """
        K = self.sets.tangent(x, definite)
        if K is None:
            return None
        D = None
        if self.friction and wv:
            D = self.sets.rub_slope(self.sets.lag(x, self.friction), v, self.creep)
        return wx * K if D is None else wx * K + wv * D

    def power(self, x, v, t) -> float:
        """Dissipated power Σ μ λ f₁(y) y of friction [W]."""
        force = self.sets.rub(self.sets.lag(x, self.friction), v, self.creep)[1]
        return -float((force * v).sum())

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no triangle passes through another on the way to x + α s."""
        return self.sets.free_part(x, x + s)

    def over_step(self, step: StepDifference) -> ContactOverStep:
        """The contact over a step: it knows where the step began."""
        self.sets.forget()  # so that a step depends on its begin only
        kind = RubbedContactOverStep if self.friction else ContactOverStep
        return kind(self, step)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Return zeros: at rest nothing touches."""
        return 0.0, 0.0

    def push(self, x: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) force on the nodes without friction [N]."""
        return self.sets.force(x)

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for triangles that start nearer than the thickness, or intersect."""
        if self.sets.intersects(x):
            raise InputError(*self.crossing(x), where, "Move them apart at the start.")
        nearest, thickness = self.sets.least_distance(x), self.sets.thickness
        if nearest <= thickness:
            what = f"two layers start at a distance of {nearest:.3g} m"
            allowed = f"must be farther apart than the thickness, {thickness:g} m"
            raise InputError(what, allowed, where, "Move them apart, or take a smaller thickness.")

    def crossing(self, x: np.ndarray) -> tuple[str, str]:
        """What intersects at x, and what is allowed, for an error."""
        pairs = find_intersections(self.sets.triangles, x)
        named = ", ".join(f"{a} and {b}" for a, b in pairs[:NAMED]) if pairs is not None else ""
        what = f"triangles intersect at the start: {named or 'some'}"
        return what, "must start free of intersections"
