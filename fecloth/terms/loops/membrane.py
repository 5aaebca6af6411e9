"""The membrane loop: every law in the Green strain runs through these few kernels.

A law is a compiled function ``law(E, c) -> (W, S, ℂ)`` of the Green strain
E = (E11, E22, E12) and the constants c of the triangle, in the Voigt order (11, 22, 12) with the
engineering shear 2 E12:

    W    energy per reference area [J/m²]
    S    second Piola–Kirchhoff stress resultant ∂W/∂E = (S11, S22, S12) [N/m]
    ℂ    tangent moduli ∂S/∂E = (C11, C22, C66, C12, C16, C26) [N/m]

The loop forms, for the nodes a of each triangle and each quadrature point of weight w,

    F = Σ x_a ⊗ G_a        (3, 2)        deformation gradient, G_a = ∂N_a/∂X
    E = (FᵀF − I)/2        (2, 2)        Green strain
    P = F S                (3, 2)        first Piola–Kirchhoff stress resultant
    f_a  = −Σ w P G_a                                     force
    K_ab = Σ w (B_aᵀ ℂ B_b + (G_a · S G_b) I₃)            stiffness, δE = Σ B_a δx_a

(Bonet and Wood 2008, Nonlinear Continuum Mechanics for Finite Element Analysis, sections 9.3
and 9.4.) Nothing here assumes three nodes or one quadrature point: `K` and `Q` are
tuples with one zero for each node and each point, so that the compiler knows their number and
unrolls the loops (three times faster than a count read from an array).

Which laws are the same material at small strain, that is have one ℂ at F = a rotation, for a
fabric of Y and ν (tests/test_tension_field.py holds each line):

    law                          uniaxial   biaxial      shear           is StVK's
    StVK                         Y          Y/(1 − ν)    Y/(2 (1 + ν))   -
    NeoHookean("compressible")   Y          Y/(1 − ν)    Y/(2 (1 + ν))   for every ν ≥ 0
    NeoHookean()                 Y          2 Y          Y/3             for ν = ½ only
    TensorCondition(Y/4)         Y          Y            Y/2             for ν = 0 only
    TensionField, taut           Y          Y/(1 − ν)    Y/(2 (1 + ν))   for every ν

TensionField has no ℂ at rest itself: from E = 0 a strain e > 0 along one direction alone meets
Y e/(1 − ν²) if ν > 0, e < 0 nothing, and the shear E12 = e the stress Y e/2 in place of 2 G e.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fecloth.fabric.panel import Panel
from fecloth.jit import inner, kernel, loop
from fecloth.mesh.cloth import Cloth
from fecloth.terms.loops.green_strain import (
    clamped,
    gradient,
    green_strain,
    scatter_force,
    scatter_symmetric,
)


@inner
def contract(C, E):
    """S = ℂ : E."""
    C11, C22, C66, C12, C16, C26 = C
    E11, E22, E12 = E
    S11 = C11 * E11 + C12 * E22 + C16 * 2.0 * E12
    S22 = C12 * E11 + C22 * E22 + C26 * 2.0 * E12
    S12 = C16 * E11 + C26 * E22 + C66 * 2.0 * E12
    return S11, S22, S12


@loop
def energy(law, K, Q, nodes, G, w, c, x):
    """Σ w W [J]."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(Q)):
            W, _, _ = law(green_strain(gradient(K, nodes, G, e, q, x)), c[e])
            total += w[e, q] * W
    return total


@loop
def add_force(law, K, Q, nodes, G, w, c, x, f):
    """f_a −= Σ w P G_a."""
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F = gradient(K, nodes, G, e, q, x)
            _, S, _ = law(green_strain(F), c[e])
            scatter_force(K, nodes, G, e, q, w[e, q], F, S, f)


@loop
def add_tangent(law, K, Q, nodes, slots, G, w, c, x, scale, floor, J):
    """J += scale · K, with the stress of the geometric part clamped from below at `floor`."""
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F = gradient(K, nodes, G, e, q, x)
            _, S, C = law(green_strain(F), c[e])
            scatter_symmetric(K, slots, G, e, q, scale * w[e, q], F, clamped(S, floor), C, J)


@loop
def add_stress(law, K, Q, nodes, G, w, c, x, out):
    """out[e] += (S11, S22, S12, W), the means over the triangle."""
    for e in range(len(nodes)):
        area = 0.0
        for q in range(len(Q)):
            area += w[e, q]
        for q in range(len(Q)):
            W, S, _ = law(green_strain(gradient(K, nodes, G, e, q, x)), c[e])
            share = w[e, q] / area
            out[e, 0] += share * S[0]
            out[e, 1] += share * S[1]
            out[e, 2] += share * S[2]
            out[e, 3] += share * W


class Kernels(NamedTuple):
    """A law's compiled entry points, each one of the loops above written out with the law."""

    energy: Callable
    add_force: Callable
    add_tangent: Callable
    add_stress: Callable


@dataclass(frozen=True, eq=False)
class BoundMembrane:
    """An elastic membrane law on a cloth: what `System` holds for `StVK` and its siblings.

    Attributes
    ----------
    kernels
        The law's entry points.
    panel, slots
        The panel, and the (m, k, k) blocks of its triangles in the system matrix.
    constants
        (m, p) constants of the law in each triangle.
    moduli
        (m, 6) ℂ at E = 0 [N/m], for the bound on the frequency.
    """

    name: str
    kernels: Kernels
    panel: Panel
    slots: np.ndarray
    constants: np.ndarray
    moduli: np.ndarray

    symmetric = True
    has_energy = True
    dissipative = False
    velocity_dependent = False

    @property
    def _data(self):
        cloth, gradients = self.panel.cloth, self.panel.gradients
        return *cloth.shape, cloth.stencil, gradients, cloth.weights, self.constants

    def energy(self, x: np.ndarray, t: float) -> float:
        """Σ w W [J]."""
        return self.kernels.energy(*self._data, x)

    def add_force(self, x, v, t, f) -> None:
        """f −= Σ w P G_a [N]."""
        self.kernels.add_force(*self._data, x, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; `definite` clamps the stress of the geometric part at zero."""
        K, Q, nodes, *data = self._data
        floor = 0.0 if definite else -math.inf
        self.kernels.add_tangent(K, Q, nodes, self.slots, *data, x, wx, floor, J.values)

    def add_stress(self, x, out) -> None:
        """out (m, 4) += S11, S22, S12 [N/m] and W [J/m²], the means over each triangle."""
        self.kernels.add_stress(*self._data, x, out)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] at rest and of M⁻¹D [1/s]."""
        return eigenvalue_bound(self.panel, self.moduli, mass), 0.0


def bind(name, kernels: Kernels, constants, moduli, panel: Panel, slots: Callable) -> BoundMembrane:
    """Bind a law with its constants (m, p) and moduli (m, 6) to a panel."""
    return BoundMembrane(name, kernels, panel, slots(panel.cloth.stencil), constants, moduli)


def eigenvalue_bound(panel: Panel, moduli: np.ndarray, mass: np.ndarray) -> float:
    """Upper bound of the largest eigenvalue of M⁻¹K at F = I, for lumped masses (n,) [kg].

    The largest eigenvalue of a sum of element matrices is at most the largest of the elements'
    own (Irons and Treharne 1971); each node's mass is shared among its triangles by theirs. With
    ℂ = L Lᵀ the nonzero eigenvalues of M_e⁻¹ K_e are those of the matrix of 3×3 blocks, one for
    each pair of quadrature points, Lᵀ (Σ_a √(w_p w_q) B_ap B_aqᵀ / m_a) L.
    """
    cloth = panel.cloth
    area = cloth.weights.sum(axis=1) * panel.density
    around = np.bincount(cloth.stencil.ravel(), np.repeat(area, cloth.stencil.shape[1]), len(mass))
    share = area[:, None] * (mass / around)[cloth.stencil]  # (m, k)
    L = np.linalg.cholesky(moduli[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]])  # (m, 3, 3)
    G1, G2 = np.moveaxis(panel.gradients, -1, 0)  # (m, q, k)
    zero = np.zeros_like(G1)
    B = np.stack([np.stack([G1, zero], -1), np.stack([zero, G2], -1), np.stack([G2, G1], -1)], -2)
    m, q, k = G1.shape
    scale = np.sqrt(cloth.weights[:, :, None] / share[:, None, :])  # (m, q, k)
    rows = np.einsum("eli,eqalj,eqa->eqiaj", L, B, scale, optimize=True).reshape(m, 3 * q, 2 * k)
    return float(np.linalg.eigvalsh(rows @ rows.transpose(0, 2, 1))[:, -1].max())


def deformation_gradient(
    cloth: Cloth, x: np.ndarray, gradients: np.ndarray | None = None
) -> np.ndarray:
    """(m, q, 3, 2), F = Σ x_a ⊗ G_a at every quadrature point; G along X and Y if left out."""
    G = cloth.gradients if gradients is None else gradients
    return np.einsum("eai,eqaj->eqij", x[cloth.stencil], G)


def principal_stretches(cloth: Cloth, x: np.ndarray) -> np.ndarray:
    """(m, 2) smaller and larger principal stretch, from the triangle's mean FᵀF."""
    F = deformation_gradient(cloth, x)
    share = cloth.weights / cloth.weights.sum(axis=1, keepdims=True)
    right = np.einsum("eq,eqij,eqik->ejk", share, F, F)
    return np.sqrt(np.maximum(np.linalg.eigvalsh(right), 0.0))


def largest_stretch(cloth: Cloth, x: np.ndarray) -> float:
    """The largest principal stretch of all triangles; not a number if any is not."""
    return extreme_stretches(cloth, x)[1]


def extreme_stretches(cloth: Cloth, x: np.ndarray) -> tuple[float, float]:
    """The least and the largest principal stretch of all triangles; NaN if any is."""
    return _extreme_stretches(*cloth.shape, cloth.stencil, cloth.gradients, x)


@kernel
def _extreme_stretches(K, Q, nodes, G, x):
    """√ of the least and largest eigenvalue of FᵀF = 2E + I."""
    least, largest = np.inf, 0.0
    for e in range(len(nodes)):
        for q in range(len(Q)):
            E11, E22, E12 = green_strain(gradient(K, nodes, G, e, q, x))
            mean, half = 1.0 + (E11 + E22), 0.5 * (E11 - E22)
            radius = 2.0 * math.sqrt(half * half + E12 * E12)
            if mean != mean or radius != radius:
                return math.nan, math.nan
            least = min(least, mean - radius)
            largest = max(largest, mean + radius)
    return math.sqrt(max(least, 0.0)), math.sqrt(largest)
