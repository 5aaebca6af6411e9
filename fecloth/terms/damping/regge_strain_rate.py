"""Strain-rate damping of the Regge-interpolated strain of quadratic triangles.

The formulas are those of `strain_rate` and `strain_rate_over_step` with E_h in place of E. Over a
step the potential is that of `StVK` with the moduli τℂ₀/h and the method's difference E* for its
rest strain, so its kernels serve here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import inner, kernel
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots
from fecloth.terms.loops.eigenvalue_bounds import membrane_bound
from fecloth.terms.loops.green_strain import clamp, contract, double_contraction
from fecloth.terms.loops.regge_membrane import BoundRegge
from fecloth.terms.loops.regge_strain import (
    NODES,
    POINTS,
    ReggeStrain,
    add_sample_stress,
    contract_rows,
    fill_rows,
    gather,
    scatter_force,
    scatter_geometric,
    scatter_material,
    scatter_tension,
)
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.membranes import stvk
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference


@dataclass(frozen=True, eq=False)
class BoundReggeRate(BoundTerm):
    """`StrainRateDamping` on a cloth of P2 triangles; `viscosity` (m, 6) is τ ℂ₀ [N s/m].

    Its own functions are those of rate = "velocity"; `over_step` has those of "step".
    """

    panel: Panel
    find_slots: FindSlots
    viscosity: np.ndarray
    symmetric: bool
    rate: str | None
    strain: ReggeStrain

    name = "StrainRateDamping"
    has_energy = False
    dissipative = True
    velocity_dependent = True

    @cached_property
    def slots(self) -> np.ndarray:
        """(m, k, k) blocks of the triangles in the matrix."""
        return self.find_slots(self.panel.cloth.stencil)

    @property
    def needs_difference(self) -> bool:
        """Whether a method without a difference over the step must refuse it."""
        return self.rate == "step"

    @cached_property
    def loop(self) -> SharedLoop:
        """The loop over the triangles."""
        return SharedLoop.of(self.panel, self.strain.nodes)

    @cached_property
    def data(self) -> tuple[Any, ...]:
        """What every kernel takes first, by triangle."""
        return self.strain.nodes, self.strain.forms, self.strain.weights, self.viscosity

    def over_step(self, step: StepDifference) -> ReggeRateOverStep | BoundReggeRate:
        """The damping with the method's difference of E_h, or itself for rate = "velocity"."""
        if step.at_mean or self.rate == "velocity":
            return self
        return ReggeRateOverStep(self, step)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ w Ė : S_v [W]."""
        return self.loop.total(lambda part: (power, (*cut(self.data, part), x, v)))

    def _force(self, x, v, part, f) -> Call:
        return add_force, (*cut(self.data, part), x, v, f)

    def add_force(self, x, v, t, f) -> None:
        """f −= Σ w S̃_v · B [N]."""
        self.loop.add(partial(self._force, x, v), f)

    def force_calls(self, x, v, t, f) -> Calls:
        return [self.loop.shared_add(partial(self._force, x, v), f)]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D; if `definite`, the symmetric part with S_v clamped at zero."""
        others: tuple[Any, ...]
        add, others = add_tangent, (x, v, wx, wv, 0.0 if self.symmetric else wx)
        E, arrays = self.strain, (*self.data, self.slots)
        if definite:
            add, others = add_definite, (x, v, wx, wv)
            arrays = *arrays, E.slopes, E.gradients, E.samples
        self.loop.add_blocks(lambda part, values: (add, (*cut(arrays, part), *others, values)), J)

    def nbytes(self, explicit: bool) -> int:
        return self.strain.nbytes

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] and of M⁻¹D [1/s], at rest."""
        return 0.0, membrane_bound(self.panel, self.viscosity, mass)


@dataclass(frozen=True, eq=False)
class ReggeRateOverStep(BoundTerm):
    """`StrainRateDamping` of E_h over a step that ends at x."""

    damping: BoundReggeRate
    step: StepDifference

    name = "StrainRateDamping"
    symmetric = True
    has_energy = True  # the potential over the step
    dissipative = False  # `dissipation` is its account

    @cached_property
    def _membrane(self) -> BoundRegge:
        """The membrane of the moduli τℂ₀/h whose rest strain is E*."""
        return self._membrane_from(self.step.h, self.step.past)

    def _membrane_from(self, h, past) -> BoundRegge:
        damping, E = self.damping, self.damping.strain
        total = np.zeros_like(E.rest)
        for weight, x in past:
            add_forms(E.nodes, E.forms, weight, x, total)
        moduli = damping.viscosity / h
        at = ReggeStrain(E.nodes, E.forms, E.weights, total, E.slopes, E.gradients, E.samples)
        kernels = stvk.KERNELS.regge
        return BoundRegge(self.name, kernels, damping.panel, damping.find_slots, moduli, moduli, at)

    def energy(self, x: np.ndarray, t: float) -> float:
        """h/2 Σ w Ė : τℂ₀ : Ė [J], the potential over the step."""
        return self._membrane.energy(x, t)

    def dissipation(self, x: np.ndarray) -> float:
        """Σ w (E₁ − E₀) : τℂ₀ : (E₁ − E₀)/dt [J], dissipated in the step."""
        step = self.step
        return 2.0 * self._membrane_from(step.dt, ((1.0, step.start),)).energy(x, 0.0)

    def add_force(self, x, v, t, f) -> None:
        """f −= Σ w S̃_v · B [N]."""
        self._membrane.add_force(x, v, t, f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K; `definite` clamps the stresses of the geometric part at zero."""
        self._membrane.add_tangent(x, v, t, wx, wv, J, definite)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] and of M⁻¹D [1/s], at rest."""
        return self.damping.rate_bounds(mass)[1] / self.step.h, 0.0


@inner
def viscous_stress(c, rate):
    """S_v = τ ℂ₀ : Ė."""
    return contract((c[0], c[1], c[2], c[3], c[4], c[5]), rate)


@kernel
def add_forms(nodes, A, weight, x, total):
    """total (m, 3 points, 3) += weight ½ Σ A_ab x_a · x_b."""
    u, B = np.empty((NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        for p in range(POINTS):
            fill_rows(A[e, p], u, B)
            E = contract_rows(B, u)
            total[e, p, 0] += 0.5 * weight * E[0]
            total[e, p, 1] += 0.5 * weight * E[1]
            total[e, p, 2] += 0.5 * weight * E[2]


@kernel
def power(nodes, A, w, c, x, v):
    """Σ w Ė : S_v with Ė = B · v."""
    u, r, B, total = np.empty((NODES, 3)), np.empty((NODES, 3)), np.empty((3, NODES, 3)), 0.0
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for p in range(POINTS):
            fill_rows(A[e, p], u, B)
            rate = contract_rows(B, r)
            total += w[e, p] * double_contraction(viscous_stress(c[e], rate), rate)
    return total


@kernel
def add_force(nodes, A, w, c, x, v, f):
    """f_b −= Σ w S̃_v · B_b."""
    u, r, B = np.empty((NODES, 3)), np.empty((NODES, 3)), np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        for p in range(POINTS):
            fill_rows(A[e, p], u, B)
            S = viscous_stress(c[e], contract_rows(B, r))
            scatter_force(nodes, e, w[e, p], S, B, f)


@kernel
def add_tangent(nodes, A, w, c, slots, x, v, wx, wv, mixed, J):
    """J_ab += Σ w (B_a τℂ₀ (wv B_b + mixed Ḃ_b)ᵀ + wx Σ_k S̃_v,k A^k_ab I₃)."""
    u, r = np.empty((NODES, 3)), np.empty((NODES, 3))
    B, T = np.empty((3, NODES, 3)), np.empty((3, NODES, 3))
    right = np.empty((3, NODES, 3))
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        ce = c[e]
        C = (ce[0], ce[1], ce[2], ce[3], ce[4], ce[5])
        for p in range(POINTS):
            fill_rows(A[e, p], u, B)
            S = viscous_stress(ce, contract_rows(B, r))
            fill_rows(A[e, p], r, right)
            right[:] = wv * B + mixed * right
            scatter_material(slots, e, w[e, p], B, C, right, T, J)
            scatter_geometric(slots, e, wx * w[e, p], S, A[e, p], J)


@kernel
def add_definite(nodes, A, w, c, slots, H, G, M, x, v, wx, wv, J):
    """J += wv D and the geometric part of wx K with its stresses clamped at zero."""
    u, r = np.empty((NODES, 3)), np.empty((NODES, 3))
    B, T, sigma = np.empty((3, NODES, 3)), np.empty((3, NODES, 3)), np.empty(9)
    for e in range(len(nodes)):
        gather(nodes, e, x, u)
        gather(nodes, e, v, r)
        ce = c[e]
        C = (ce[0], ce[1], ce[2], ce[3], ce[4], ce[5])
        sigma[:] = 0.0
        for p in range(POINTS):
            fill_rows(A[e, p], u, B)
            S = viscous_stress(ce, contract_rows(B, r))
            scatter_material(slots, e, wv * w[e, p], B, C, B, T, J)
            add_sample_stress(M[e], p, w[e, p], S, sigma)
        S = clamp((sigma[6], sigma[7], 0.5 * sigma[8]), 0.0)
        scatter_tension(slots, e, wx, sigma, H[e], S, G[e], J)
