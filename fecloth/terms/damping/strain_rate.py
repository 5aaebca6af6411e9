"""Viscous damping of the membrane strain: a stress proportional to the Green strain rate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated, Any

import numpy as np

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import inner, kernel
from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.units import TIME
from fecloth.terms.damping.regge_strain_rate import BoundReggeRate
from fecloth.terms.damping.strain_rate_over_step import StrainRateOverStep
from fecloth.terms.loops.eigenvalue_bounds import membrane_bound
from fecloth.terms.loops.green_strain import (
    clamp,
    contract,
    gradient,
    scatter_force,
    scatter_mixed,
    scatter_symmetric,
    strain_rate,
)
from fecloth.terms.loops.regge_strain import ReggeStrain, check_strain, is_interpolated
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.membranes.stvk import StVK
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.traits import DAMPING


@dataclass(frozen=True)
class StrainRateDamping:
    """Viscous stress S_v = τ ℂ₀ : Ė with the strain rate Ė = sym(FᵀḞ), or its difference.

    The force is d_a = −Σ w F S_v G_a. The dissipated power is Σ w Ė : S_v ≥ 0. There are two forms.

    "velocity" takes Ė = sym(FᵀḞ) from the velocity, zero in any rigid motion. In the form of Baraff
    and Witkin this is d = −k_d (∂C/∂x)ᵀ Ċ with C = 2E. With δE = B(F) δx and Ė = B(F) v the
    tangents are

        ∂d/∂v = −Bᵀ τℂ₀ B                                       symmetric
        ∂d/∂x = −(S_v ⊗ I) − Bᵀ τℂ₀ B(Ḟ)                        the last part is not symmetric

    "step" takes the method's own difference of E over the step (`strain_rate_over_step`):

        backward Euler   Ė = (E₁ − E₀)/dt
        BDF2             Ė = (3E₁ − 4E₀ + E₋₁)/(2dt),    or that for steps of changing size

    It is zero where the step turns the cloth by any angle, while sym(FᵀḞ) at the end of a step that
    turns it by φ is about −φ²/(2dt). It has a potential, h/2 Σ w Ė : S_v with h = dt and 2dt/3, so
    that the step minimises if the other terms have energies, and its tangent is symmetric. Both
    forms are the same as dt → 0, to the order of the method. In the midpoint rule and
    `EnergyMomentum` they are the same at any dt: there sym(FᵀḞ) is (E₁ − E₀)/dt.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eqs. 11–13; here for the
    whole tensor C at once. They omit the non-symmetric part of ∂d/∂x. A step as a
    minimum: Gast and Schroeder (2014), Optimization Integrator for Large Time Steps, SCA; the
    difference of E as derived above.

    Valid at any strain; the viscosity does not depend on the strain. Motion without strain, such
    as bending without stretch, is not damped. The damping of a real fabric is friction between
    yarns, which depends less on the frequency.

    Cost of force and tangent relative to `StVK`: 1.2 and 1.1 times, in both forms.
    tangent="exact" also needs a linear solver for general matrices.

    Parameters
    ----------
    time
        τ [s], > 0. A membrane motion of angular frequency ω has the damping ratio ζ = ω τ / 2.
    law
        The membrane law whose moduli at E = 0 are ℂ₀. Default: `StVK()`.
    tangent
        Of "velocity": "symmetric" (without the non-symmetric part) or "exact".
    rate
        "velocity"; or "step", for `BackwardEuler` and `BDF2` only. Left out: "step" in these two
        methods, and "velocity" in all others.

    strain
        On P2: "interpolated", which does not lock where the cloth bends (`regge_strain`),
        or "pointwise", the Green strain itself. P1 has one constant strain in a triangle.

    Raises
    ------
    InputError
        For a value that is not allowed; from the run, for "step" with another method.
    """

    time: Annotated[float, TIME]
    law: object = None
    tangent: str = "symmetric"
    rate: str | None = None
    strain: str = "interpolated"

    def __post_init__(self):
        where = "StrainRateDamping"
        check_strain(self.strain, where)
        if not (is_number(self.time) and self.time > 0):
            raise InputError(f"time = {self.time!r}", "must be finite and > 0 [s]", where)
        if self.tangent not in ("symmetric", "exact"):
            allowed = 'must be "symmetric" or "exact"'
            raise InputError(f"tangent = {self.tangent!r}", allowed, where)
        if self.rate not in (None, "step", "velocity"):
            allowed = 'must be "step" or "velocity", or left out'
            raise InputError(f"rate = {self.rate!r}", allowed, where)
        if self.law is not None and not hasattr(self.law, "moduli"):
            raise InputError(f"law = {self.law!r}", "must be a membrane law such as StVK()", where)

    traits = replace(DAMPING, damps="strain")

    def stencil(self, cloth: Cloth) -> np.ndarray:
        return cloth.stencil

    def bind(self, panel: Panel, slots) -> BoundStrainRate | BoundReggeRate:
        law: Any = self.law or StVK()  # `__post_init__` requires its `moduli`
        viscosity = panel.each(lambda fabric: self.time * law.moduli(fabric))
        symmetric = self.tangent == "symmetric"
        if is_interpolated(self.strain, panel):
            strain = ReggeStrain.of_panel(panel)
            return BoundReggeRate(panel, slots, viscosity, symmetric, self.rate, strain)
        return BoundStrainRate(panel, slots, viscosity, symmetric, self.rate)


@dataclass(frozen=True, eq=False)
class BoundStrainRate(BoundTerm):
    """`StrainRateDamping` on a cloth; `viscosity` (m, 6) is τ ℂ₀ [N s/m] in each triangle.

    Its own functions are those of rate = "velocity"; `over_step` has those of "step".
    """

    panel: Panel
    find_slots: FindSlots
    viscosity: np.ndarray
    symmetric: bool
    rate: str | None = None

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
        return SharedLoop.of(self.panel, self.panel.cloth.stencil)

    @property
    def elements(self) -> tuple:
        """The arrays with a row for each triangle; tangents take `slots` after the first."""
        cloth, gradients = self.panel.cloth, self.panel.gradients
        return cloth.stencil, gradients, cloth.weights, self.viscosity

    @property
    def data(self) -> tuple:
        """What every kernel takes first."""
        return *self.panel.cloth.shape, *self.elements

    def over_step(self, step: StepDifference) -> StrainRateOverStep | BoundStrainRate:
        """The damping with the method's difference of E, or itself for rate = "velocity"."""
        if step.at_mean or self.rate == "velocity":
            return self
        return StrainRateOverStep(self, step)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ w Ė : S_v [W]."""
        shape = self.panel.cloth.shape
        return self.loop.total(lambda part: (power, (*shape, *cut(self.elements, part), x, v)))

    def _force(self, x, v, part, f) -> Call:
        return add_force, (*self.panel.cloth.shape, *cut(self.elements, part), x, v, f)

    def add_force(self, x, v, t, f) -> None:
        """f −= Σ w F S_v G_a [N]."""
        self.loop.add(partial(self._force, x, v), f)

    def force_calls(self, x, v, t, f) -> Calls:
        return [self.loop.shared_add(partial(self._force, x, v), f)]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D; if `definite`, the symmetric part with S_v clamped at zero."""
        weights: tuple[float, ...]
        add, weights = add_exact, (wx, wv)
        if self.symmetric or definite:
            add, weights = add_symmetric, (wx, wv, 0.0 if definite else -np.inf)
        shape, (nodes, *others) = self.panel.cloth.shape, self.elements
        arrays = nodes, self.slots, *others
        self.loop.add_blocks(
            lambda part, values: (add, (*shape, *cut(arrays, part), x, v, *weights, values)), J
        )

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] and of M⁻¹D [1/s], at rest."""
        return 0.0, membrane_bound(self.panel, self.viscosity, mass)


@inner
def viscous_stress(c, F, H):
    """Viscous stress S_v = τ ℂ₀ : Ė, and strain rate Ė."""
    rate = strain_rate(F, H)
    return contract((c[0], c[1], c[2], c[3], c[4], c[5]), rate), rate


@kernel
def power(per_node, per_point, nodes, G, w, c, x, v):
    """Σ w Ė : S_v."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F, H = gradient(per_node, nodes, G, e, q, x), gradient(per_node, nodes, G, e, q, v)
            S, rate = viscous_stress(c[e], F, H)
            total += w[e, q] * (S[0] * rate[0] + S[1] * rate[1] + 2.0 * S[2] * rate[2])
    return total


@kernel
def add_force(per_node, per_point, nodes, G, w, c, x, v, f):
    """d_a = −Σ w F S_v G_a."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F, H = gradient(per_node, nodes, G, e, q, x), gradient(per_node, nodes, G, e, q, v)
            S, _ = viscous_stress(c[e], F, H)
            scatter_force(per_node, nodes, G, e, q, w[e, q], F, S, f)


@kernel
def add_symmetric(per_node, per_point, nodes, slots, G, w, c, x, v, wx, wv, floor, J):
    """J_ab += w (wv B_aᵀ τℂ₀ B_b + wx (G_a · S_v G_b) I₃)."""
    for e in range(len(nodes)):
        ce = c[e]
        C = (wv * ce[0], wv * ce[1], wv * ce[2], wv * ce[3], wv * ce[4], wv * ce[5])
        for q in range(len(per_point)):
            F, H = gradient(per_node, nodes, G, e, q, x), gradient(per_node, nodes, G, e, q, v)
            S, _ = viscous_stress(ce, F, H)
            S = clamp((wx * S[0], wx * S[1], wx * S[2]), floor)
            scatter_symmetric(per_node, slots, G, e, q, w[e, q], F, S, C, J)


@kernel
def add_exact(per_node, per_point, nodes, slots, G, w, c, x, v, wx, wv, J):
    """J_ab += w (B_a(F)ᵀ τℂ₀ B_b(wv F + wx Ḟ) + wx (G_a · S_v G_b) I₃)."""
    for e in range(len(nodes)):
        ce = c[e]
        for q in range(len(per_point)):
            F, H = gradient(per_node, nodes, G, e, q, x), gradient(per_node, nodes, G, e, q, v)
            S, _ = viscous_stress(ce, F, H)
            mixed = (
                wv * F[0] + wx * H[0],
                wv * F[1] + wx * H[1],
                wv * F[2] + wx * H[2],
                wv * F[3] + wx * H[3],
                wv * F[4] + wx * H[4],
                wv * F[5] + wx * H[5],
            )
            S = (wx * S[0], wx * S[1], wx * S[2])
            scatter_mixed(per_node, slots, G, e, q, w[e, q], F, mixed, S, ce, J)
