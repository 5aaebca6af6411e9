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
and 9.4.) Nothing here assumes three nodes or one quadrature point: `per_node` and `per_point` are
tuples with one zero for each node and each point, so that the compiler knows their number and
unrolls the loops (three times faster than a count read from an array).

Which laws are the same material at small strain, that is have one ℂ at F = a rotation, for a
fabric of Y and ν (tests/terms/membranes/test_tension_field.py checks each line):

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
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from fecloth.compiled.calls import Call, Calls
from fecloth.compiled.jit import Array, Zeros, specialise
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.mesh.recovery import CONSTANT, QUADRATIC, Samples
from fecloth.terms.kinematics import deformation_gradient
from fecloth.terms.loops import membrane_discrete_gradient, regge_membrane
from fecloth.terms.loops.eigenvalue_bounds import membrane_bound
from fecloth.terms.loops.green_strain import (
    Six,
    Three,
    clamp,
    gradient,
    green_strain,
    scatter_force,
    scatter_symmetric,
)
from fecloth.terms.loops.membrane_discrete_gradient import DiscreteGradientKernels, OverStep
from fecloth.terms.loops.regge_membrane import BoundRegge, ReggeKernels
from fecloth.terms.loops.regge_strain import ReggeStrain, is_interpolated
from fecloth.terms.loops.shared_loop import SharedLoop, cut
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.recovered_error import green_strains, membrane_error
from fecloth.terms.step_difference import StepDifference


def law(E: Three, c: Array) -> tuple[float, Three, Six]:
    """Return W, S (3,) and ℂ (6,) at E (3,); `kernels` puts a law in place of this one."""
    raise NotImplementedError


def energy(
    per_node: Zeros, per_point: Zeros, nodes: Array, G: Array, w: Array, c: Array, x: Array
) -> float:
    """Σ w W [J]."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            W, _, _ = law(green_strain(gradient(per_node, nodes, G, e, q, x)), c[e])
            total += w[e, q] * W
    return total


def add_force(
    per_node: Zeros,
    per_point: Zeros,
    nodes: Array,
    G: Array,
    w: Array,
    c: Array,
    x: Array,
    f: Array,
) -> None:
    """f_a −= Σ w P G_a."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            _, S, _ = law(green_strain(F), c[e])
            scatter_force(per_node, nodes, G, e, q, w[e, q], F, S, f)


def add_tangent(
    per_node: Zeros,
    per_point: Zeros,
    nodes: Array,
    slots: Array,
    G: Array,
    w: Array,
    c: Array,
    x: Array,
    scale: float,
    floor: float,
    J: Array,
) -> None:
    """J += scale · K, with the stress of the geometric part clamped from below at `floor`."""
    for e in range(len(nodes)):
        for q in range(len(per_point)):
            F = gradient(per_node, nodes, G, e, q, x)
            _, S, C = law(green_strain(F), c[e])
            scatter_symmetric(per_node, slots, G, e, q, scale * w[e, q], F, clamp(S, floor), C, J)


def add_stress(
    per_node: Zeros,
    per_point: Zeros,
    nodes: Array,
    G: Array,
    w: Array,
    c: Array,
    x: Array,
    out: Array,
) -> None:
    """out[e] += (S11, S22, S12, W), the means over the triangle."""
    for e in range(len(nodes)):
        area = 0.0
        for q in range(len(per_point)):
            area += w[e, q]
        for q in range(len(per_point)):
            W, S, _ = law(green_strain(gradient(per_node, nodes, G, e, q, x)), c[e])
            share = w[e, q] / area
            out[e, 0] += share * S[0]
            out[e, 1] += share * S[1]
            out[e, 2] += share * S[2]
            out[e, 3] += share * W


def add_moduli(
    per_node: Zeros,
    per_point: Zeros,
    nodes: Array,
    G: Array,
    w: Array,
    c: Array,
    x: Array,
    out: Array,
) -> None:
    """out[e] += ℂ (6,), the mean over the triangle."""
    for e in range(len(nodes)):
        area = 0.0
        for q in range(len(per_point)):
            area += w[e, q]
        for q in range(len(per_point)):
            _, _, C = law(green_strain(gradient(per_node, nodes, G, e, q, x)), c[e])
            for k in range(6):
                out[e, k] += w[e, q] / area * C[k]


class MembraneKernels(NamedTuple):
    """The entry points of a law, each a template above compiled with the law."""

    energy: Callable[..., float]
    add_force: Callable[..., None]
    add_tangent: Callable[..., None]
    add_definite_tangent: Callable[..., None]
    add_stress: Callable[..., None]
    add_moduli: Callable[..., None]  # of the definite law
    over_step: DiscreteGradientKernels
    regge: ReggeKernels


def kernels(
    law: Callable[..., Any],
    definite_law: Callable[..., Any] | None = None,
    is_quadratic: bool = False,
) -> MembraneKernels:
    """Compile the entry points of a law; each is compiled at its first call, or read from disk.

    Parameters
    ----------
    law
        The compiled function (see above).
    definite_law
        The same law with ℂ positive semi-definite, for the definite tangent. Default: `law`,
        whose ℂ must then be semi-definite everywhere.
    is_quadratic
        W is quadratic in E, so that the average stress over a step does the work of the energy.
    """
    definite_law = law if definite_law is None else definite_law
    return MembraneKernels(
        specialise(energy, law=law),
        specialise(add_force, law=law),
        specialise(add_tangent, law=law),
        specialise(add_tangent, law=definite_law),
        specialise(add_stress, law=law),
        specialise(add_moduli, law=definite_law),
        membrane_discrete_gradient.kernels(law, definite_law, is_quadratic),
        regge_membrane.kernels(law, definite_law),
    )


@dataclass(frozen=True, eq=False)
class BoundMembrane(BoundTerm):
    """An elastic membrane law bound to a cloth, as a `System` calls it.

    Attributes
    ----------
    kernels
        The law's entry points.
    panel, find_slots
        As `bind` of a term gets them; the matrix is not looked at before the first tangent.
    constants
        (m, p) constants of the law in each triangle.
    moduli
        (m, 6) ℂ at E = 0 [N/m], for the bound on the frequency.
    """

    name: str
    kernels: MembraneKernels
    panel: Panel
    find_slots: FindSlots
    constants: np.ndarray
    moduli: np.ndarray

    symmetric = True
    has_energy = True

    @cached_property
    def slots(self) -> np.ndarray:
        """(m, k, k) blocks of the triangles in the matrix."""
        return self.find_slots(self.panel.cloth.stencil)

    @cached_property
    def loop(self) -> SharedLoop:
        """The loop over the triangles."""
        return SharedLoop.of(self.panel, self.panel.cloth.stencil)

    @property
    def elements(self) -> tuple[Any, ...]:
        """The arrays with a row for each triangle; tangents take `slots` after the first."""
        cloth, gradients = self.panel.cloth, self.panel.gradients
        return cloth.stencil, gradients, cloth.weights, self.constants

    @property
    def data(self) -> tuple[Any, ...]:
        """What every entry point takes first."""
        return *self.panel.cloth.shape, *self.elements

    def energy(self, x: np.ndarray, t: float) -> float:
        """Σ w W [J]."""
        shape, add = self.panel.cloth.shape, self.kernels.energy
        return self.loop.total(lambda part: (add, (*shape, *cut(self.elements, part), x)))

    def _force(self, x: Array, part: slice, f: Array) -> Call:
        shape = self.panel.cloth.shape
        return self.kernels.add_force, (*shape, *cut(self.elements, part), x, f)

    def add_force(self, x: Array, v: Array, t: float, f: Array) -> None:
        """f −= Σ w P G_a [N]."""
        self.loop.add(partial(self._force, x), f)

    def force_calls(self, x: Array, v: Array, t: float, f: Array) -> Calls:
        return [self.loop.shared_add(partial(self._force, x), f)]

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K; `definite` clamps the stress of the geometric part at zero."""
        add, floor = self.kernels.add_tangent, -math.inf
        if definite:
            add, floor = self.kernels.add_definite_tangent, 0.0
        shape, (nodes, *others) = self.panel.cloth.shape, self.elements
        arrays = nodes, self.slots, *others
        self.loop.add_blocks(
            lambda part, values: (add, (*shape, *cut(arrays, part), x, wx, floor, values)), J
        )

    def add_stress(self, x: Array, out: Array) -> None:
        """out (m, 4) += S11, S22, S12 [N/m] and W [J/m²], the means over each triangle."""
        self.kernels.add_stress(*self.data, x, out)

    def strain_error(self, x: Array, t: float) -> np.ndarray:
        """(m,) energy [J] of what recovery changes of the strain in each triangle."""
        return membrane_error(self.panel, *self.sampled_strain(x))

    def sampled_strain(self, x: Array) -> tuple[Array, Array, Samples]:
        """E (m, q, 3) at the points of samples, ℂ (m, 6) [N/m], and the samples."""
        cloth, moduli = self.panel.cloth, np.zeros((len(self.moduli), 6))
        self.kernels.add_moduli(*self.data, x, moduli)
        F = deformation_gradient(cloth, x, self.panel.gradients)
        samples = CONSTANT if cloth.element == "P1" else QUADRATIC
        return green_strains(F), moduli, samples

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the eigenvalues of M⁻¹K [1/s²] at rest and of M⁻¹D [1/s]."""
        return membrane_bound(self.panel, self.moduli, mass), 0.0

    def over_step(self, step: StepDifference) -> OverStep | BoundMembrane:
        """The membrane over a step at whose mean it is evaluated; otherwise itself."""
        return OverStep(self, step.start, step.symmetric) if step.at_mean else self


def bind(
    name: str,
    kernels: MembraneKernels,
    constants: np.ndarray,
    moduli: np.ndarray,
    panel: Panel,
    slots: FindSlots,
    strain: object = "interpolated",
) -> BoundMembrane | BoundRegge:
    """Bind a law with its constants (m, p) and moduli (m, 6) to a panel.

    On P2 the law takes the Regge-interpolated strain, unless `strain` is "pointwise".
    """
    if is_interpolated(strain, panel):
        interpolated = ReggeStrain.of_panel(panel)
        return BoundRegge(name, kernels.regge, panel, slots, constants, moduli, interpolated)
    return BoundMembrane(name, kernels, panel, slots, constants, moduli)
