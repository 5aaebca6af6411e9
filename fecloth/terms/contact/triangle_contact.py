"""Contact between triangles, bound to a cloth: of the cloth with itself or with a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError
from fecloth.mesh.surface import find_intersections
from fecloth.terms.contact.bound_contact import BoundContact, ContactOverStep, Rubbing
from fecloth.terms.contact.shape import Shape
from fecloth.terms.contact.toolkit import ContactSets
from fecloth.terms.step_difference import StepDifference

NAMED = 5  # pairs of triangles that an error names


@dataclass(frozen=True, eq=False)
class SlidingTriangles:
    """Pairs of triangles that slide on each other; velocities are those of all nodes (n, 3)."""

    # The contacts, and the toolkit's own with their normal forces and directions.
    sets: ContactSets
    lagged: Any
    surface: np.ndarray | float  # (n, 3) velocity of the fixed mesh [m/s]
    R: np.ndarray | None  # (3, 3) rotation of the fixed mesh; None if it does not turn
    eps: float  # speed from which friction has its full value [m/s]

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        return of_nodes

    def slip(self, v: np.ndarray) -> np.ndarray:
        """(n, 3) velocities relative to the fixed mesh, in its frame."""
        w: np.ndarray = v - self.surface
        return w if self.R is None else w @ self.R

    def rate(self, w: np.ndarray) -> float:
        return self.sets.rub(self.lagged, w, self.eps)[0]

    def power(self, w: np.ndarray) -> float:
        return -float((self.sets.rub(self.lagged, w, self.eps)[1] * w).sum())

    def force(self, w: np.ndarray) -> np.ndarray:
        """(n, 3) force on the nodes [N]."""
        return _turn(self.sets.rub(self.lagged, w, self.eps)[1], self.R)

    def damping(self, w: np.ndarray, weight: float) -> sparse.csr_matrix | None:
        """(3n, 3n) `weight` times −∂force/∂v, positive semi-definite; None if nothing touches."""
        D = self.sets.rub_slope(self.lagged, w, self.eps)
        return None if D is None else _turn_matrix(weight * D, self.R)


def _turn(f: np.ndarray, R: np.ndarray | None) -> np.ndarray:
    """Vectors (n, 3) in space, from those in the frame of the fixed mesh."""
    return f if R is None else f @ R.T


def _turn_matrix(K: sparse.csr_matrix, R: np.ndarray | None) -> sparse.csr_matrix:
    """(3n, 3n) R K Rᵀ, in space."""
    if R is None:
        return K
    all_R = sparse.kron(sparse.identity(K.shape[0] // 3), R, format="csr")
    return (all_R @ K @ all_R.T).tocsr()


@dataclass(frozen=True, eq=False)
class BoundTriangleContact(BoundContact):
    """`SelfContact` or `MeshObstacle` on a cloth."""

    name: str  # of the term
    sets: ContactSets  # the contacts at positions of the cloth
    # μ, and the speed of sliding [m/s] from which friction has its full value.
    friction: float
    creep: float
    # What moves and turns the fixed mesh of the sets; None where it stands still. All contact is
    # computed in the frame of this body.
    body: Shape | None = None

    symmetric = True

    def place(self, x: np.ndarray, t: float) -> np.ndarray:
        """Positions (n, 3) as the fixed mesh sees them."""
        return x if self.body is None else self.body.pose(t).to_body(x)

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) velocities as the fixed mesh sees them [m/s]."""
        return v if self.body is None else (v - self.body.velocity(x, t)) @ self.body.pose(t).R

    def rotation(self, t: float) -> np.ndarray | None:
        """R (3, 3) of the fixed mesh; None if it does not turn."""
        if self.body is None or self.body.rotate is None:
            return None
        return self.body.pose(t).R

    def energy(self, x, t) -> float:
        """Σ κ gap A b(s) [J]."""
        return self.sets.energy(self.place(x, t))

    def push(self, x: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) force on the nodes without friction [N]."""
        return _turn(self.sets.force(self.place(x, t)), self.rotation(t))

    def add_forces(self, x: np.ndarray, t: float, rubbing: Rubbing, f: np.ndarray) -> None:
        """f −= ∂energy/∂x, and friction [N]."""
        f += sum((each.force(w) for each, w in rubbing), start=self.push(x, t))

    def coupling(self, x, v, t, wx, wv, definite) -> sparse.spmatrix | None:
        """wx K of the barrier, without the negative part of each pair if `definite`, and wv D.

        How friction changes with x is left out: over a step, for which methods ask, it is lagged.
        """
        rubbing = self.rubbing(x, v, t) if wv else ()
        return self.couplings(x, t, wx, rubbing, wv, definite)

    def couplings(
        self,
        x: np.ndarray,
        t: float,
        wx: float,
        rubbing: Rubbing,
        weight: float,
        definite: bool,
    ) -> sparse.spmatrix | None:
        K = self.sets.tangent(self.place(x, t), definite)
        parts = [None if K is None else _turn_matrix(wx * K, self.rotation(t))]
        parts += [each.damping(w, weight) for each, w in rubbing]
        coupled = [part for part in parts if part is not None]
        return sum(coupled[1:], start=coupled[0]) if coupled else None

    def lag(self, x: np.ndarray, t: float, dt: float) -> Sequence[SlidingTriangles]:
        y = self.place(x, t)
        surface = 0.0 if self.body is None else self.body.mean_velocity(y, x, t, dt)
        lagged = self.sets.lag(y, self.friction)
        return [SlidingTriangles(self.sets, lagged, surface, self.rotation(t), self.creep)]

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α ≤ 1 for which no triangle passes through another on the way to x + α s."""
        return self.sets.free_part(self.place(x, t), self.place(x + s, t))

    def over_step(self, step: StepDifference) -> ContactOverStep:
        """The contact over a step: it knows where the step began."""
        self.sets.forget()  # so that a step depends on its begin only
        return super().over_step(step)

    def admit_from(self, step: StepDifference, x: np.ndarray, t: float) -> np.ndarray:
        """x (n, 3), or the place on the way from the begin of the step where it stops.

        The way is straight as the fixed mesh sees it: a mesh that moves takes the cloth along.
        """
        begin, end = self.place(step.start, step.t), self.place(x, t)
        part = self.sets.free_part(begin, end)
        if part == 1.0:
            return x
        there = begin + part * (end - begin)
        return there if self.body is None else self.body.pose(t).to_space(there)

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
