"""Biquadratic springs: the sides of each triangle, coupled to the energy of `StVK`.

The formulas are in `Springs`. The condition of a triangle is C_i = l_i² − L_i² of its three
sides, side i opposite node i.
"""

import math

import numpy as np

from fecloth.compiled.jit import Array, inner
from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.terms.loops import bound_condition
from fecloth.terms.loops.bound_condition import LengthCondition


def bind(panel: Panel, slots, damping: float, tangent: str) -> LengthCondition:
    """Bind the springs of all triangles; raise `InputError` for an orthotropic fabric.

    Each triangle is a condition with three components and a matrix k (3, 3). Its damping is
    k_d = `damping` k, with `damping` in s. `slots` are those of `Term.bind`, and `tangent` is
    that of `Springs`.
    """
    cloth = panel.cloth
    corners = cloth.X[cloth.stencil]
    sides = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)  # i: opposite node i
    squared_lengths_at_rest = np.sum(sides**2, axis=2)
    area = cloth.weights.sum(axis=1)
    # By the law of cosines: cot α_i = (L_j² + L_k² − L_i²)/(4 A).
    sum_of_squares = squared_lengths_at_rest.sum(axis=1, keepdims=True)
    cot = (sum_of_squares - 2 * squared_lengths_at_rest) / (4 * area[:, None])
    lam, mu = panel.each(_lame).T[..., None, None]
    # The energy is ½ Cᵀ k C. So k_ii = ½ k_i and k_ij = ½ c_ij, with k_i and c_ij of `Springs`.
    k = 2 * (lam + mu) * cot[:, :, None] * cot[:, None, :] + mu * (2 * np.eye(3) - 1)
    k = k / (32 * area[:, None, None])
    return BoundSides.bind(
        "Springs",
        KERNELS,
        convex=(1, 1, 1),
        panel=panel,
        slots=slots,
        nodes=cloth.stencil,
        constants=squared_lengths_at_rest,
        stiffness=k,
        damping=damping * k,
        tangent=tangent,
    )


class BoundSides(LengthCondition):
    """The sides of the triangles; the constants are L_i²."""

    differences = np.roll(np.eye(3), 2, axis=1) - np.roll(np.eye(3), 1, axis=1)

    def rest_over_step(self, e0: Array, e: Array) -> Array:
        """L_i² − |e_i − e₀_i|², for which C_i at the mean is the mean of both ends."""
        rest: Array = self.constants - np.sum((e - e0) ** 2, axis=2)
        return rest

    def moduli_over_step(self, e0: Array, e: Array) -> Array:
        """Return 4 k_rs e_r ⊗ e₁_s + 2 (k C̄)_r δ_rs I (m, 3, 3, 3, 3), with e₁ = 2e − e₀.

        C̄ is the mean of C at both ends of the step; e₀ (m, 3, 3) are the sides at its begin,
        and e those at the mean.
        """
        C = np.sum(e * e, axis=2) - self.rest_over_step(e0, e)
        tension = 2.0 * (self.stiffness @ C[..., None]) * np.eye(3)
        dyads = e[:, :, None, :, None] * (2.0 * e - e0)[:, None, :, None, :]
        moduli: Array = 4.0 * self.stiffness[..., None, None] * dyads
        moduli += tension[..., None, None] * np.eye(3)
        return moduli


def _lame(fabric: Fabric) -> np.ndarray:
    """Return λ and μ = 2 G (2,) [N/m] of a fabric, as Delingette defines them.

    Raises `InputError` for an orthotropic fabric: if warp and weft differ, or if the shear
    modulus is not Y/(2 (1 + ν)).
    """
    warp, weft = fabric.tensile
    nu = fabric.poisson_ratio
    if warp != weft or not math.isclose(fabric.shear, warp / (2 * (1 + nu)), rel_tol=1e-12):
        where = 'Springs(kind="biquadratic")'
        raise InputError("an orthotropic fabric", "must be isotropic", where, "Use StVK.")
    return np.array([warp * nu / (1 - nu**2), warp / (1 + nu)])


@inner
def squared_lengths(y, c, order, C, g, H):
    """Fill C_i = |y_b − y_a|² − c_i, ∂C_i = ±2 (y_b − y_a) and ∂²C_i = ±2 I of a triangle.

    a and b are the two nodes of the side i, which is opposite node i. The arguments are those
    of every family of conditions: see `loops.condition`.
    """
    for r in range(3):
        a = (r + 1) % 3
        b = (r + 2) % 3
        C[r] = -c[r]
        for i in range(3):
            d = y[b, i] - y[a, i]
            C[r] += d * d
            if order > 0:
                g[r, r, i] = 0.0
                g[r, a, i] = -2.0 * d
                g[r, b, i] = 2.0 * d
    if order > 1:
        H[:] = 0.0  # it holds the values of another triangle
        for r in range(3):
            a = (r + 1) % 3
            b = (r + 2) % 3
            for i in range(3):
                H[r, a, i, a, i] = H[r, b, i, b, i] = 2.0
                H[r, a, i, b, i] = H[r, b, i, a, i] = -2.0


KERNELS = bound_condition.ConditionKernels(squared_lengths)
