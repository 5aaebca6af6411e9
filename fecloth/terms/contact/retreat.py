"""How pairs of triangles dissipate: over a step they push less while they move apart.

The pairs at the begin of a step, with the distance d₀, move apart by z = ∇d(x₀) · (x − x₀). Of
the energy E(d) of such a pair a retreat z > 0 releases only

    E(d₀) − E(d₀ + r),   r = z − z²/(2ρ) for z < ρ, else ρ/2

with ρ = dt/c, or half of the way out of the gap if that is less. With p = −E′, the pair pushes
by p(d₀ + r) max(0, 1 − z/ρ). That is the law of `restitution` for e = 0 with c = 400 s/m: the
push vanishes above the speed 1/c = 2.5 mm/s, and nothing sticks. The rest of the elastic push
is taken back by a potential E(d₀ + r) − E(d₀ + z), which is added to the energy of the pairs at
x. The force of this potential never does work on the cloth, also where the step has replaced
these pairs by others. An approach is elastic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.terms.contact import barrier
from fecloth.terms.contact.restitution import MOST_DAMPING
from fecloth.terms.contact.toolkit import ContactSets

# The least distance at the begin, over the distance now. Chosen: it must be > 0, though the way
# z along the gradient ∇d may be longer than the distance.
LEAST_START_OVER_DISTANCE = 1e-3
# 1 − s from which on a pair counts. Nearer to the end of the gap, E/b(s) is a quotient of
# round-off: b(s) is 1e-18 there.
LEAST_DEPTH_OVER_GAP = 1e-6


@dataclass(frozen=True, eq=False)
class Retreat:
    """Pairs (m,) at the begin of a step, and how far they may move apart over it.

    Attributes
    ----------
    start
        Positions (n, 3) at the begin, as the fixed mesh sees them [m].
    normals
        ∇d (m, 3n).
    d0
        Distances (m,) of the middle surfaces at the begin [m].
    scale
        E(d)/b(s) (m,) [J].
    rho
        ρ (m,) [m].
    thickness
        Least distance of the middle surfaces [m].
    span
        (d² − thickness²)/s [m²]; s = 1 at the gap.
    """

    start: np.ndarray
    normals: sparse.csr_matrix
    d0: np.ndarray
    scale: np.ndarray
    rho: np.ndarray
    thickness: float
    span: float

    @classmethod
    def at(cls, sets: ContactSets, x: np.ndarray, start: np.ndarray, dt: float) -> Retreat:
        """Make the retreat of the pairs in contact at x, over a step of dt [s] from `start`.

        x and `start` are positions (n, 3) as the fixed mesh sees them. x is the begin of the
        step itself, or the end of the step: then the distances at the begin are extrapolated.
        """
        normals, d, energies = sets.pairs(x)
        thickness = sets.thickness
        reach = sets.gap + thickness
        span = reach**2 - thickness**2
        s = (d**2 - thickness**2) / span
        acts = (energies > 0) & (s < 1 - LEAST_DEPTH_OVER_GAP)
        any_s = np.where(acts, s, 0.5)  # 0.5: any s with b(s) > 0, where a pair does not act
        scale = np.where(acts, energies / barrier.value(any_s), 0.0)
        largest_z = (1 - LEAST_START_OVER_DISTANCE) * (d - thickness)  # so that d₀ > thickness
        z = np.minimum(normals @ (x - start).ravel(), largest_z)
        d0 = d - np.maximum(z, 0.0)
        half_way_out = np.maximum(0.5 * (reach - d0), np.finfo(float).tiny)  # > 0, for 1/ρ
        return cls(
            start=start,
            normals=normals,
            d0=d0,
            scale=scale,
            rho=np.minimum(dt / MOST_DAMPING, half_way_out),
            thickness=thickness,
            span=span,
        )

    def apart(self, y: np.ndarray) -> np.ndarray:
        """(m,) how far the pairs are apart [m] at positions y (n, 3): z, or 0 where z < 0."""
        return np.maximum(self.normals @ (y - self.start).ravel(), 0.0)

    def energy(self, y: np.ndarray) -> float:
        """Σ E(d₀ + r) − E(d₀ + z) [J]."""
        z = self.apart(y)
        return float((self._energies(self._released(z)) - self._energies(z)).sum())

    def held(self, z: np.ndarray) -> np.ndarray:
        """Return by how much [N] each pair (m,) pushes less than an elastic pair would; ≥ 0.

        It is p(d₀ + z) − p(d₀ + r) max(0, 1 − z/ρ).
        """
        r = self._released(z)
        return self._pushes(z)[0] - self._pushes(r)[0] * np.maximum(1 - z / self.rho, 0.0)

    def force(self, y: np.ndarray) -> np.ndarray:
        """(n, 3) −∂energy/∂y [N]."""
        return np.reshape(-self.normals.T @ self.held(self.apart(y)), y.shape)

    def parts(self, y: np.ndarray) -> np.ndarray:
        """The part (m,) of their elastic force with which the pairs push at y (n, 3)."""
        z = self.apart(y)
        elastic_push, _ = self._pushes(z)
        # Without a push, nothing is held back either: the part is 1.
        return 1 - self.held(z) / np.where(elastic_push > 0.0, elastic_push, 1.0)

    def lost(self, y: np.ndarray) -> float:
        """Energy [J] that a step to y dissipates."""
        z = self.apart(y)
        return float(self.held(z) @ z)

    def tangent(self, y: np.ndarray, definite: bool) -> sparse.csr_matrix:
        """Return ∂²energy/∂y² (3n, 3n) [N/m] at positions y (n, 3).

        If `definite`, the negative curvatures of pairs are set to 0.
        """
        z = self.apart(y)
        _, slope_at_z = self._pushes(z)
        push_at_r, slope_at_r = self._pushes(self._released(z))
        # d²/dz² of E(d₀ + r) − E(d₀ + z), with p = −E′, r′ = max(0, 1 − z/ρ) and r″ = −1/ρ
        slope_of_r = np.maximum(1 - z / self.rho, 0.0)
        curvature = slope_at_z - slope_at_r * slope_of_r**2
        curvature = curvature + push_at_r / self.rho * (slope_of_r > 0)
        curvature = np.where(z > 0, curvature, 0.0)
        if definite:
            curvature = np.maximum(curvature, 0.0)
        return (self.normals.T @ sparse.diags(curvature) @ self.normals).tocsr()

    def _released(self, z: np.ndarray) -> np.ndarray:
        """r (m,) [m]: the energy of a pair falls by E(d₀) − E(d₀ + r)."""
        z = np.minimum(z, self.rho)
        return z - z**2 / (2 * self.rho)

    def _s(self, z: np.ndarray) -> np.ndarray:
        """s (m,) at d₀ + z, at most 1."""
        return np.minimum(((self.d0 + z) ** 2 - self.thickness**2) / self.span, 1.0)

    def _energies(self, z: np.ndarray) -> np.ndarray:
        """E(d₀ + z) (m,) [J]."""
        return self.scale * barrier.value(self._s(z))

    def _pushes(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """p = −E′ (m,) [N] at d₀ + z, and p′ [N/m]."""
        s = self._s(z)
        slope = 2 * (self.d0 + z) / self.span
        push = self.scale * barrier.pressure(s)
        return push * slope, 2 * push / self.span - self.scale * barrier.curvature(s) * slope**2
