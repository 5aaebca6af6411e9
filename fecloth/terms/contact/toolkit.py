"""The IPC Toolkit: which parts of a surface are in contact, and the barrier between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.errors import InputError

RESERVE = 0.9  # of the way that is free, where it is not all of it


def load(where: str) -> Any:
    """Import ipctk; raise `InputError` if it is missing."""
    try:
        import ipctk
    except ImportError as error:
        remedy = "pip install 'fecloth[contact]'."
        raise InputError(where, "needs the package ipctk", where, remedy) from error
    return ipctk


@dataclass(eq=False)
class ContactSets:
    """The pairs in contact of a surface of triangles, at the positions asked for last.

    Attributes
    ----------
    toolkit, mesh, potential
        ipctk, and its collision mesh and barrier potential.
    gap, thickness
        [m].
    """

    toolkit: Any
    mesh: Any
    potential: Any
    gap: float
    thickness: float
    _last: tuple[np.ndarray, Any] | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls, X: np.ndarray, triangles: np.ndarray, gap: float, thickness: float, stiffness: float
    ) -> ContactSets:
        """Return those of a surface with reference positions X (n, 3)."""
        ipctk = load("SelfContact")
        faces = np.asfortranarray(triangles.astype(np.int32))
        mesh = ipctk.CollisionMesh(np.asfortranarray(X), ipctk.edges(faces), faces)
        potential = ipctk.BarrierPotential(gap, stiffness, use_physical_barrier=True)
        return cls(ipctk, mesh, potential, gap, thickness)

    def at(self, x: np.ndarray) -> Any:
        """The contacts at x (n, 3); energy, force and tangent ask for the same ones in turn."""
        if self._last is None or not np.array_equal(self._last[0], x):
            found = self.toolkit.NormalCollisions()
            found.use_area_weighting = True
            found.build(self.mesh, np.asfortranarray(x), self.gap, self.thickness)
            self._last = x.copy(), found
        return self._last[1]

    def energy(self, x: np.ndarray) -> float:
        """[J]; +∞ where two parts are nearer than the thickness."""
        energy = float(self.potential(self.at(x), self.mesh, np.asfortranarray(x)))
        return energy if math.isfinite(energy) else math.inf

    def force(self, x: np.ndarray) -> np.ndarray:
        """(n, 3) −∂energy/∂x [N]."""
        contacts = self.at(x)
        if not len(contacts):
            return np.zeros_like(x)
        gradient = self.potential.gradient(contacts, self.mesh, np.asfortranarray(x))
        return -np.reshape(gradient, x.shape)

    def tangent(self, x: np.ndarray, definite: bool) -> sparse.csr_matrix | None:
        """(3n, 3n) ∂²energy/∂x² [N/m]; None without contacts."""
        contacts, method = self.at(x), self.toolkit.PSDProjectionMethod
        if not len(contacts):
            return None
        kind = method.CLAMP if definite else method.NONE
        return self.potential.hessian(contacts, self.mesh, np.asfortranarray(x), kind).tocsr()

    def lag(self, x: np.ndarray, friction: float) -> Any:
        """The contacts at x with their normal forces and directions of sliding, for μ."""
        lagged = self.toolkit.TangentialCollisions()
        lagged.build(self.mesh, np.asfortranarray(x), self.at(x), self.potential, friction)
        return lagged

    def rub(self, lagged: Any, v: np.ndarray, creep: float) -> tuple[float, np.ndarray]:
        """Σ μ λ f₀(y) [W] at velocities v (n, 3), and minus its derivative by v: the force [N]."""
        if not len(lagged):
            return 0.0, np.zeros_like(v)
        potential, v = self.toolkit.FrictionPotential(creep), np.asfortranarray(v)
        gradient = potential.gradient(lagged, self.mesh, v)
        return float(potential(lagged, self.mesh, v)), -np.reshape(gradient, v.shape)

    def rub_slope(self, lagged: Any, v: np.ndarray, creep: float) -> sparse.csr_matrix | None:
        """(3n, 3n) −∂force/∂v [N s/m], positive semi-definite; None without contacts."""
        if not len(lagged):
            return None
        potential, method = self.toolkit.FrictionPotential(creep), self.toolkit.PSDProjectionMethod
        return potential.hessian(lagged, self.mesh, np.asfortranarray(v), method.CLAMP).tocsr()

    def free_part(self, x: np.ndarray, y: np.ndarray) -> float:
        """The largest α ≤ 1 for which nothing meets on the straight way from x to x + α (y − x)."""
        ends = np.asfortranarray(x), np.asfortranarray(y)
        ccd = self.toolkit.AdditiveCCD()
        step = self.toolkit.compute_collision_free_stepsize
        part = float(step(self.mesh, *ends, self.thickness, narrow_phase_ccd=ccd))
        return 1.0 if part >= 1.0 else RESERVE * part

    def intersects(self, x: np.ndarray) -> bool:
        """Whether parts that share no node pass through each other."""
        return bool(self.toolkit.has_intersections(self.mesh, np.asfortranarray(x)))

    def least_distance(self, x: np.ndarray) -> float:
        """Least distance [m] of parts nearer than thickness and gap; infinite without any."""
        contacts = self.at(x)
        if not len(contacts):
            return math.inf
        return math.sqrt(contacts.compute_minimum_distance(self.mesh, np.asfortranarray(x)))
