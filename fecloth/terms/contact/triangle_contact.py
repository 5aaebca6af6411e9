"""Contact between triangles, bound to a cloth: of the cloth with itself or with a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.mesh.intersections import find_intersections
from fecloth.terms.contact.shape import Shape
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
    body
        What moves and turns the fixed mesh of the sets; None where it stands still. All contact is
        computed in the frame of this body.
    """

    name: str
    sets: ContactSets
    friction: float
    creep: float
    body: Shape | None = None

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

    def place(self, x: np.ndarray, t: float) -> np.ndarray:
        """Positions (n, 3) as the fixed mesh sees them."""
        return x if self.body is None else self.body.pose(t).to_body(x)

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) velocities as the fixed mesh sees them [m/s]."""
        return v if self.body is None else (v - self.body.velocity(x, t)) @ self.body.pose(t).R

    def turn(self, f: np.ndarray, t: float) -> np.ndarray:
        """Vectors (n, 3) in space, from those in the frame of the fixed mesh."""
        if self.body is None or self.body.rotate is None:
            return f
        return f @ self.body.pose(t).R.T

    def turn_matrix(self, K: sparse.csr_matrix, t: float) -> sparse.csr_matrix:
        """(3n, 3n) R K Rᵀ, in space."""
        if self.body is None or self.body.rotate is None:
            return K
        R = sparse.kron(sparse.identity(K.shape[0] // 3), self.body.pose(t).R, format="csr")
        return (R @ K @ R.T).tocsr()

    def energy(self, x, t) -> float:
        """Σ κ gap A b(s) [J]."""
        return self.sets.energy(self.place(x, t))

    def add_force(self, x, v, t, f) -> None:
        """f −= ∂energy/∂x, and friction [N].

        At v = 0 it is the derivative of the energy: the friction of a mesh that moves past a cloth
        at rest is left out.
        """
        f += self.push(x, t)
        if self.friction and v.any():
            f += self.rub(x, v, t)

    def push(self, x: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) force on the nodes without friction [N]."""
        return self.turn(self.sets.force(self.place(x, t)), t)

    def rub(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) force of friction on the nodes [N]."""
        lagged = self.sets.lag(self.place(x, t), self.friction)
        return self.turn(self.sets.rub(lagged, self.slip(x, v, t), self.creep)[1], t)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Add nothing: all of the tangent is in `coupling`."""

    def coupling(self, x, v, t, wx, wv, definite) -> sparse.spmatrix | None:
        """wx K of the barrier, without the negative part of each pair if `definite`, and wv D.

        How friction changes with x is left out: over a step, for which methods ask, it is lagged.
        """
        y = self.place(x, t)
        K = self.sets.tangent(y, definite)
        if K is None:
            return None
        D = None
        if self.friction and wv:
            lagged = self.sets.lag(y, self.friction)
            D = self.sets.rub_slope(lagged, self.slip(x, v, t), self.creep)
        return self.turn_matrix(wx * K if D is None else wx * K + wv * D, t)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ μ λ f₁(y) y of friction [W]."""
        w = v if self.body is None else v - self.body.velocity(x, t)
        return -float((self.rub(x, v, t) * w).sum())

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no triangle passes through another on the way to x + α s."""
        return self.sets.free_part(self.place(x, t), self.place(x + s, t))

    def over_step(self, step: StepDifference) -> ContactOverStep:
        """The contact over a step: it knows where the step began."""
        self.sets.forget()  # so that a step depends on its begin only
        kind = RubbedContactOverStep if self.friction else ContactOverStep
        return kind(self, step)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Return zeros: at rest nothing touches."""
        return 0.0, 0.0

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for triangles that start nearer than the thickness, or intersect."""
        y = self.place(x, t)
        if self.sets.intersects(y):
            raise InputError(*self.crossing(x), where, "Move them apart at the start.")
        nearest, thickness = self.sets.least_distance(y), self.sets.thickness
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
