"""Viscous damping of the membrane strain: a stress proportional to the Green strain rate."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from fecloth import validation
from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import Array
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.quantities.units import TIME
from fecloth.terms.loops.membrane import BoundMembrane, PointwiseStrain, strain_of
from fecloth.terms.loops.membrane_loops import Kernels
from fecloth.terms.loops.regge_strain import ReggeStrain, check_strain
from fecloth.terms.loops.shared_loop import SharedLoop, by_part
from fecloth.terms.membranes import stvk
from fecloth.terms.protocol import BoundTerm, element_nodes, taken_from
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.traits import DAMPING


@dataclass(frozen=True)
class StrainRateDamping:
    """Viscous stress S_v = τ ℂ₀ : Ė with the strain rate Ė = sym(FᵀḞ), or its difference.

    The force is d_a = −Σ w F S_v G_a. The dissipated power is Σ w Ė : S_v ≥ 0. There are two
    forms.

    "velocity" takes Ė = sym(FᵀḞ) from the velocity, zero in any rigid motion. With δE = B(F) δx
    and Ė = B(F) v the tangents are

        ∂d/∂v = −Bᵀ τℂ₀ B                                       symmetric
        ∂d/∂x = −(S_v ⊗ I) − Bᵀ τℂ₀ B(Ḟ)                        the last part is not symmetric

    "step" takes the method's own difference of E over the step, Ė = (E − E*)/h:

        backward Euler   Ė = (E₁ − E₀)/dt
        BDF2             Ė = (3E₁ − 4E₀ + E₋₁)/(2dt),    or that for steps of changing size

    It is zero where the step turns the cloth by any angle. (At the end of a step that turns it
    by φ, sym(FᵀḞ) is about −φ²/(2dt).) It has a potential, h/2 Σ w Ė : S_v with h = dt or 2dt/3:
    the energy of `StVK` with the moduli τℂ₀/h and the rest strain E* = Σ cᵢ E(xᵢ). So its
    tangent is symmetric, and the step minimises an energy if the other terms have energies.

    As dt → 0 both forms become the same, with the order of the method. In the midpoint rule and
    `EnergyMomentum` they are the same at any dt: there sym(FᵀḞ) is (E₁ − E₀)/dt.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, eqs. 11–13, with C = 2E
    as a whole tensor. A step as a minimum: Gast and Schroeder (2014), Optimization Integrator
    for Large Time Steps, SCA.

    Valid at any strain. Motion without strain, such as bending without stretch, is not damped.
    The damping of a real fabric is friction between yarns, which depends less on the
    frequency.

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
        """Raise `InputError` for a parameter that is not allowed."""
        where = "StrainRateDamping"
        check_strain(self.strain, where)
        validation.positive("time", self.time, "s", where)
        validation.one_of("tangent", self.tangent, ("symmetric", "exact"), where)
        if self.rate not in (None, "step", "velocity"):
            allowed = 'must be "step" or "velocity", or left out'
            raise InputError(f"rate = {self.rate!r}", allowed, where)
        if self.law is not None and not hasattr(self.law, "moduli"):
            allowed = "must be a membrane law such as StVK()"
            raise InputError(f"law = {self.law!r}", allowed, where)

    traits = replace(DAMPING, damps="strain")
    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> BoundTerm:
        law: Any = self.law or stvk.StVK()  # `__post_init__` requires its `moduli`
        viscosity = panel.each(lambda fabric: self.time * law.moduli(fabric))
        strain = strain_of(panel, self.strain)
        symmetric = self.tangent == "symmetric"
        loop = SharedLoop.over_elements(panel, panel.cloth.stencil, slots)
        return BoundStrainRate(panel, viscosity, symmetric, self.rate, strain, loop)


@dataclass(frozen=True, eq=False)
class BoundStrainRate(BoundTerm):
    """`StrainRateDamping` on a cloth.

    Its own functions are for rate = "velocity"; `over_step` has the functions of "step". The
    loops are the loops of `StVK` with the rate of the strain, whose energy is half of the
    power.

    Attributes
    ----------
    panel
        The cloth with its fabrics.
    viscosity
        (m, 6) τ ℂ₀ in each triangle [N s/m].
    symmetric
        Whether the tangent of "velocity" leaves out its non-symmetric part.
    rate
        The form: "velocity", "step", or None for the form that suits the method.
    strain
        The strain of the panel.
    loop
        The loop over the triangles.
    """

    panel: Panel
    viscosity: np.ndarray
    symmetric: bool
    rate: str | None
    strain: PointwiseStrain | ReggeStrain
    loop: SharedLoop

    name = "StrainRateDamping"
    has_energy = False
    dissipative = velocity_dependent = True

    @property
    def needs_difference(self) -> bool:
        """Whether a method without a difference over the step must refuse it."""
        return self.rate == "step"

    @property
    def is_pointwise(self) -> bool:
        return isinstance(self.strain, PointwiseStrain)

    @cached_property
    def kernels(self) -> Kernels:
        """The entry points of the rate of this strain."""
        if self.is_pointwise:
            return stvk.KERNELS.rate
        return stvk.KERNELS.regge_rate

    @cached_property
    def elements(self) -> tuple[Array, ...]:
        """The arrays with a row for each triangle: nodes, A, w, the moduli and a rest strain.

        The rate does not depend on the rest strain.
        """
        return *self.strain.elements, self.viscosity, self.strain.rest

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The damping with the method's difference of E, or itself for rate = "velocity"."""
        if step.at_mean or self.rate == "velocity":  # at the mean both forms are the same
            return self
        return StrainRateOverStep(self, step)

    def power(self, x, v, t) -> float:
        """Dissipated power Σ w Ė : S_v [W]."""
        shape = self.strain.shape
        energy = self.kernels.energy
        return 2.0 * self.loop.total(by_part(energy, shape, self.elements, x, v))

    def _force(self, x, v) -> Callable[..., Call]:
        return by_part(self.kernels.add_force, self.strain.shape, self.elements, x, v)

    def add_force(self, x, v, t, f) -> None:
        """f −= Σ w S_v : ∂E/∂x [N]."""
        self.loop.add(self._force(x, v), f)

    def force_calls(self, x, v, t, f) -> Calls:
        return [self.loop.shared_add(self._force(x, v), f)]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx K + wv D; see the class of the term for "symmetric" and "exact".

        If `definite`, the negative principal values of S_v are raised to zero, and the
        non-symmetric part is left out.
        """
        self.loop.add_blocks(self._tangent(x, v, wx, wv, definite), J)

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls:
        return [self.loop.shared_add_blocks(self._tangent(x, v, wx, wv, definite), J)]

    def _tangent(self, x, v, wx, wv, definite) -> Callable[..., Call]:
        nodes, A, w, moduli, rest = self.elements
        arrays: tuple[Array, ...] = (nodes, self.loop.slots, A, w, moduli, rest)
        shape = self.strain.shape
        if definite:
            add = self.kernels.add_definite_tangent
            # This kernel takes more arrays, before the rest strain.
            arrays = (*arrays[:-1], *self.strain.definite_arrays, rest)
            return by_part(add, shape, arrays, x, v, wx, wv)
        if self.symmetric:
            return by_part(self.kernels.add_tangent, shape, arrays, x, v, wx, wv)
        # This kernel takes v twice, for Ė and for Ḟ in B(Ḟ), and three weights: of the part with
        # S_v, of Bᵀ τℂ₀ B, and of the part that is not symmetric.
        return by_part(self.kernels.add_mixed_tangent, shape, arrays, x, v, v, wx, wv, wx)

    def nbytes(self, explicit: bool) -> int:
        return self.strain.nbytes


@dataclass(frozen=True, eq=False)
class StrainRateOverStep(BoundTerm):
    """`StrainRateDamping` over a step that ends at x: a membrane with the rest strain E*."""

    damping: BoundStrainRate
    step: StepDifference

    name = "StrainRateDamping"
    symmetric = True
    has_energy = True  # the potential over the step, h/2 Σ w Ė : τℂ₀ : Ė [J]
    dissipative = False  # `dissipation` is its account
    velocity_dependent = False
    energy = taken_from("membrane.energy")
    add_force = taken_from("membrane.add_force")
    add_tangent = taken_from("membrane.add_tangent")
    energy_calls = taken_from("membrane.energy_calls")
    force_calls = taken_from("membrane.force_calls")
    tangent_calls = taken_from("membrane.tangent_calls")

    @property
    def step_arrays(self) -> tuple[Array, ...]:
        """The moduli and the strain at rest of the membrane."""
        return self.membrane.constants, self.membrane.strain.rest

    @cached_property
    def membrane(self) -> BoundMembrane:
        """The membrane of the moduli τℂ₀/h whose rest strain is E*."""
        return self._membrane(self.step.h, self.step.past)

    def _membrane(self, h: float, past: tuple[tuple[float, Array], ...]) -> BoundMembrane:
        """The membrane of the moduli τℂ₀/h and the strain E − Σ c E(y), for ((c, y), …)."""
        damping = self.damping
        membrane = BoundMembrane(
            name=self.name,
            kernels=stvk.KERNELS if damping.is_pointwise else stvk.KERNELS.regge,
            panel=damping.panel,
            constants=damping.viscosity / h,
            strain=replace(damping.strain, rest=np.zeros_like(damping.strain.rest)),
            loop=damping.loop,
        )
        return membrane.less(past)

    def dissipation(self, x: np.ndarray) -> float:
        """Σ w (E₁ − E₀) : τℂ₀ : (E₁ − E₀)/dt [J], dissipated in the step."""
        step = self.step
        return 2.0 * self._membrane(step.dt, ((1.0, step.start),)).energy(x, 0.0)
