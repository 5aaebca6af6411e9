"""Strain-rate damping over a step: the strain rate is the method's difference of the strain.

With the difference Ė = (E(x) − E*)/h, E* = Σ cᵢ E(xᵢ), of `StepDifference`

    Ψ    = h/2 Σ w Ė : τℂ₀ : Ė                             potential over the step [J]
    f_a  = −∂Ψ/∂x_a = −Σ w F S_v G_a,   S_v = τℂ₀ : Ė
    K_ab = Σ w (B_aᵀ (τℂ₀/h) B_b + (G_a · S_v G_b) I₃)      symmetric

and D = 0. A rigid motion does not change E, so however far the cloth turns in the step, Ψ and the
force are zero. The dissipated energy is Σ w (E₁ − E₀) : τℂ₀ : (E₁ − E₀)/dt, never negative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from fecloth.compiled.calls import Call
from fecloth.compiled.jit import inner, kernel
from fecloth.terms.loops.green_strain import (
    clamp,
    contract,
    double_contraction,
    gradient,
    green_strain,
    scatter_force,
    scatter_symmetric,
)
from fecloth.terms.loops.shared_loop import cut
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference

if TYPE_CHECKING:
    from fecloth.terms.damping.strain_rate import BoundStrainRate


@dataclass(frozen=True, eq=False)
class StrainRateOverStep(BoundTerm):
    """`StrainRateDamping` over a step that ends at x."""

    damping: BoundStrainRate
    step: StepDifference

    symmetric = True
    has_energy = True  # Ψ
    dissipative = False  # `dissipation` is its account

    @property
    def name(self) -> str:
        return self.damping.name

    @cached_property
    def strain(self) -> np.ndarray:
        """(m, points, 3) E*."""
        shape, (nodes, G, *_) = self._shape, self.damping.elements
        strain = np.zeros((len(nodes), len(shape[1]), 3))

        def add(weight: float, x: np.ndarray, part: slice) -> Call:
            return add_strain, (*shape, *cut((nodes, G), part), weight, x, strain[part])

        for weight, x in self.step.past:
            self.damping.loop.each(partial(add, weight, x))
        return strain

    @property
    def _shape(self) -> tuple:
        return self.damping.panel.cloth.shape

    @property
    def _arrays(self) -> tuple:
        """Those with a row for each triangle."""
        return *self.damping.elements, self.strain

    def energy(self, x: np.ndarray, t: float) -> float:
        """Ψ [J], the potential over the step."""
        arrays, others = self._arrays, (self.step.h, x)
        return self.damping.loop.total(
            lambda part: (potential, (*self._shape, *cut(arrays, part), *others))
        )

    def dissipation(self, x: np.ndarray) -> float:
        """Σ w (E₁ − E₀) : τℂ₀ : (E₁ − E₀)/dt [J], dissipated in the step."""
        elements, last = self.damping.elements, (self.step.start, self.step.dt, x)
        parts = (cut(elements, part) for part in self.damping.loop.runs)
        return float(sum(dissipation(*self._shape, *part, *last) for part in parts))

    def add_force(self, x, v, t, f) -> None:
        """f −= Σ w F S_v G_a [N]."""
        arrays, others = self._arrays, (self.step.h, x)
        self.damping.loop.add(
            lambda part, f: (add_force, (*self._shape, *cut(arrays, part), *others, f)), f
        )

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; `definite` clamps S_v of the geometric part at zero."""
        nodes, *others = self._arrays
        arrays = nodes, self.damping.slots, *others
        last = self.step.h, x, wx, 0.0 if definite else -math.inf
        self.damping.loop.add_blocks(
            lambda part, values: (add_tangent, (*self._shape, *cut(arrays, part), *last, values)), J
        )

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] and of M⁻¹D [1/s], at rest."""
        return self.damping.rate_bounds(mass)[1] / self.step.h, 0.0


@inner
def viscous_stress(c, h, strain, E):
    """S_v = τℂ₀ : Ė and Ė = (E − E*)/h."""
    rate = (E[0] - strain[0]) / h, (E[1] - strain[1]) / h, (E[2] - strain[2]) / h
    return contract((c[0], c[1], c[2], c[3], c[4], c[5]), rate), rate


@kernel
def add_strain(per_node, per_point, nodes, G, weight, x, strain):
    """strain += weight E(x)."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            E = green_strain(gradient(per_node, nodes, G, e, q, x))
            strain[e, q, 0] += weight * E[0]
            strain[e, q, 1] += weight * E[1]
            strain[e, q, 2] += weight * E[2]


@kernel
def potential(per_node, per_point, nodes, G, w, c, strain, h, x):
    """h/2 Σ w Ė : S_v."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            E = green_strain(gradient(per_node, nodes, G, e, q, x))
            S, rate = viscous_stress(c[e], h, strain[e, q], E)
            total += 0.5 * h * w[e, q] * double_contraction(S, rate)
    return total


@kernel
def dissipation(per_node, per_point, nodes, G, w, c, start, dt, x):
    """dt Σ w Ė : τℂ₀ : Ė with Ė = (E₁ − E₀)/dt."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            E0 = green_strain(gradient(per_node, nodes, G, e, q, start))
            E1 = green_strain(gradient(per_node, nodes, G, e, q, x))
            S, rate = viscous_stress(c[e], dt, E0, E1)
            total += dt * w[e, q] * double_contraction(S, rate)
    return total


@kernel
def add_force(per_node, per_point, nodes, G, w, c, strain, h, x, f):
    """f_a −= Σ w F S_v G_a."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            S, _ = viscous_stress(c[e], h, strain[e, q], green_strain(F))
            scatter_force(per_node, nodes, G, e, q, w[e, q], F, S, f)


@kernel
def add_tangent(per_node, per_point, nodes, slots, G, w, c, strain, h, x, scale, floor, J):
    """J_ab += scale Σ w (B_aᵀ (τℂ₀/h) B_b + (G_a · S_v G_b) I₃), S_v clamped at `floor`."""
    for e in range(len(nodes)):
        ce = c[e]
        C = (ce[0] / h, ce[1] / h, ce[2] / h, ce[3] / h, ce[4] / h, ce[5] / h)
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            S, _ = viscous_stress(ce, h, strain[e, q], green_strain(F))
            S = clamp(S, floor)
            scatter_symmetric(per_node, slots, G, e, q, scale * w[e, q], F, S, C, J)
