"""A membrane law bound to a cloth, with the strain that the element has.

The law's energy, force and tangent are sums over the triangles and their quadrature points of
weight w (`membrane_loops`). With the pointwise strain these are

    F = Σ x_a ⊗ G_a        (3, 2)        deformation gradient, G_a = ∂N_a/∂X
    E = (FᵀF − I)/2        (2, 2)        Green strain
    P = F S                (3, 2)        first Piola–Kirchhoff stress resultant
    f_a  = −Σ w P G_a                                     force
    K_ab = Σ w (B_aᵀ ℂ B_b + (G_a · S G_b) I₃)            stiffness, δE = Σ B_a δx_a

(Bonet and Wood 2008, Nonlinear Continuum Mechanics for Finite Element Analysis, sections 9.3
and 9.4.) `regge_strain` has the same for the interpolated strain.

The table says which laws are the same material at small strain: they have the same ℂ where F is
a rotation. It is for a fabric of Y and ν; tests/terms/membranes/test_tension_field.py checks
each line.

    law                          uniaxial   biaxial      shear           is StVK's
    StVK                         Y          Y/(1 − ν)    Y/(2 (1 + ν))   -
    NeoHookean("compressible")   Y          Y/(1 − ν)    Y/(2 (1 + ν))   for every ν ≥ 0
    NeoHookean()                 Y          2 Y          Y/3             for ν = ½ only
    TensorCondition(Y/4)         Y          Y            Y/2             for ν = 0 only
    TensionField, taut           Y          Y/(1 − ν)    Y/(2 (1 + ν))   for every ν

TensionField itself has no ℂ at rest. From E = 0 a strain e > 0 along one direction alone gives
the stress Y e/(1 − ν²) if ν > 0, a strain e < 0 gives none, and the shear E12 = e gives Y e/2 in
place of 2 G e.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np

from fecloth.compiled.calls import Call, Calls, Present
from fecloth.compiled.jit import Array
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix, FindSlots
from fecloth.mesh.recovery import CONSTANT, QUADRATIC, Samples
from fecloth.terms.discrete_gradient import OverMean
from fecloth.terms.kinematics import deformation_gradient, green_strains
from fecloth.terms.loops.membrane_loops import Kernels
from fecloth.terms.loops.regge_strain import ReggeStrain, is_interpolated
from fecloth.terms.loops.shared_loop import SharedLoop, by_part, cut
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.strain_errors import membrane_error

GRADIENTS_OF_UNIT = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])  # of its corners, (0, 0) first


@dataclass(frozen=True, eq=False)
class PointwiseStrain:
    """The Green strain at the quadrature points of a panel, along warp and weft.

    Attributes
    ----------
    panel
        The cloth with its fabrics.
    rest
        (m, points, 3) The strain at rest, which the entry points `Kernels.rested` subtract.
    """

    panel: Panel
    rest: np.ndarray

    nbytes = 0  # it has no arrays of its own
    # The definite tangent takes no more arrays than the others, unlike the one of `ReggeStrain`.
    definite_arrays: ClassVar[tuple[Array, ...]] = ()

    @classmethod
    def of_panel(cls, panel: Panel) -> Self:
        """The strain of a panel that is flat and without strain at rest."""
        return cls(panel, np.broadcast_to(0.0, (*panel.cloth.weights.shape, 3)))

    @property
    def shape(self) -> tuple[Any, ...]:
        """A zero for each node, and a zero for each point."""
        return self.panel.cloth.shape

    @property
    def elements(self) -> tuple[Array, Array, Array]:
        """Nodes (m, k), gradients (m, points, k, 2) and weights (m, points)."""
        cloth = self.panel.cloth
        return cloth.stencil, self.panel.gradients, cloth.weights

    def sampled(self, x: Array) -> tuple[Array, Samples]:
        """E (m, points, 3) at positions x (n, 3), and the samples that these points are."""
        cloth = self.panel.cloth
        E = green_strains(deformation_gradient(cloth, x, self.panel.gradients))
        if cloth.element == "P1":
            return E, CONSTANT
        return E, QUADRATIC


@dataclass(frozen=True, eq=False)
class BoundMembrane(BoundTerm):
    """An elastic membrane law bound to a cloth, as a `System` calls it.

    Attributes
    ----------
    name
        The name of the term.
    kernels
        The compiled entry points of the law for this strain.
    panel
        The cloth with its fabrics.
    constants
        (m, p) The constants of the law in each triangle.
    strain
        The strain of the panel.
    loop
        The loop over the triangles.
    """

    name: str
    kernels: Kernels
    panel: Panel
    constants: np.ndarray
    strain: PointwiseStrain | ReggeStrain
    loop: SharedLoop

    symmetric = has_energy = objective = True

    @cached_property
    def elements(self) -> tuple[Any, ...]:
        """The arrays with a row for each triangle: nodes, A, w, c and the strain at rest."""
        return *self.strain.elements, self.constants, self.strain.rest

    @property
    def data(self) -> tuple[Any, ...]:
        """What every entry point takes first."""
        return *self.strain.shape, *self.elements

    def _energy(self, x: Array) -> Callable[..., Call]:
        return by_part(self.kernels.energy, self.strain.shape, self.elements, x, x)

    def energy(self, x: np.ndarray, t: float) -> float:
        """Σ w W [J]."""
        return self.loop.total(self._energy(x))

    def energy_calls(self, x: Array, t: Array, sums: Array) -> Calls | None:
        if self.loop.counted is not None:
            return None
        return self.loop.total_calls(self._energy(x), sums)

    def _force(self, x: Array) -> Callable[..., Call]:
        return by_part(self.kernels.add_force, self.strain.shape, self.elements, x, x)

    def add_force(self, x: Array, v: Array, t: float, f: Array) -> None:
        """f −= Σ w S : ∂E/∂x [N]."""
        self.loop.add(self._force(x), f)

    def force_calls(self, x: Array, v: Array, t: Array, f: Array) -> Calls:
        return [self.loop.shared_add(self._force(x), f)]

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K; `definite` raises the stress of the geometric part to zero."""
        self.loop.add_blocks(self._tangent(x, wx, definite), J)

    def tangent_calls(
        self, x: Array, v: Array, t: Array, wx: Present, wv: Present, J: BlockMatrix, definite: bool
    ) -> Calls:
        return [self.loop.shared_add_blocks(self._tangent(x, wx, definite), J)]

    def _tangent(self, x: Array, wx: float | Present, definite: bool) -> Callable[..., Call]:
        if definite:
            add = self.kernels.add_definite_tangent
            return self._blocks(add, (x, x, wx, wx), more=self.strain.definite_arrays)
        return self._blocks(self.kernels.add_tangent, (x, x, wx, wx))

    def add_mixed_tangent(self, x: Array, v: Array, scale: float, J: BlockMatrix) -> None:
        """J += scale Σ w (∂E/∂x : ℂ : ∂E/∂x at x + v + S : ∂²E/∂x²), which is not symmetric."""
        add = self.kernels.add_mixed_tangent
        self.loop.add_blocks(self._blocks(add, (x, x, v, scale, scale, scale)), J)

    def _blocks(
        self, add: Any, others: tuple[Any, ...], more: tuple[Array, ...] = ()
    ) -> Callable[..., Call]:
        """The calls of an entry point; `more` are arrays with a row for each triangle."""
        nodes, A, w, c, rest = self.elements
        arrays = nodes, self.loop.slots, A, w, c, *more, rest
        return by_part(add, self.strain.shape, arrays, *others)

    def add_stress(self, x: Array, out: Array) -> None:
        """out (m, 4) += S11, S22, S12 [N/m] and W [J/m²], the means over each triangle."""
        self.kernels.add_stress(*self.data, x, x, out)

    def stress_of(self, F: Array, triangles: np.ndarray) -> Array:
        """S11, S22, S12 (r, 3) [N/m] of deformation gradients F (r, 3, 2) along warp and weft.

        The constants are those of the triangles (r,). The loop takes a triangle with the corners
        0, F₁ and F₂ for each: its deformation gradient is F.
        """
        r = len(F)
        corners = np.concatenate([np.zeros((r, 1, 3)), F.swapaxes(1, 2)], axis=1).reshape(-1, 3)
        nodes = np.arange(3 * r, dtype=np.int32).reshape(r, 3)
        G = np.broadcast_to(GRADIENTS_OF_UNIT, (r, 1, 3, 2)).copy()
        constants = np.ascontiguousarray(self.constants[triangles])
        at_rest = np.broadcast_to(0.0, (r, 1, 3))
        out = np.zeros((r, 4))
        arrays = nodes, G, np.ones((r, 1)), constants, at_rest
        add = self.kernels.pointwise.add_stress
        add((0, 0, 0), (0,), *arrays, corners, corners, out)
        return out[:, :3]

    def strain_error(self, x: Array, t: float) -> np.ndarray:
        """(m,) the energy [J] of the change that recovery makes of the strain, by triangle."""
        return membrane_error(self.panel, *self.sampled_strain(x))

    def sampled_strain(self, x: Array) -> tuple[Array, Array, Samples]:
        """E (m, q, 3) at the points of samples, ℂ (m, 6) [N/m], and the samples."""
        moduli = np.zeros((len(self.constants), 6))
        self.kernels.add_moduli(*self.data, x, x, moduli)
        E, samples = self.strain.sampled(x)
        return E, moduli, samples

    def nbytes(self, explicit: bool) -> int:
        return self.strain.nbytes

    def less(self, strains: Iterable[tuple[float, Array]]) -> Self:
        """Return the membrane of the strain E − Σ c E(y), for `strains` ((c, y (n, 3)), …).

        The sum is added to its strain at rest.
        """
        rest = self.strain.rest.copy()
        nodes, A, _, _, old_rest = self.elements

        def add(weight: float, y: Array, part: slice) -> Call:
            arrays = *self.strain.shape, *cut((nodes, A, old_rest), part)
            return self.kernels.add_strain, (*arrays, weight, y, y, rest[part])

        for weight, y in strains:
            self.loop.each(partial(add, weight, y))
        strain = replace(self.strain, rest=rest)
        return replace(self, kernels=self.kernels.rested, strain=strain)

    def between(self, start: Array, x: Array) -> Self:
        """The membrane with the strain Ē = ½ (E₀ + E₁) at x, of `start` and 2x − start."""
        return self.less(((1.0, x), (-0.5, start), (-0.5, 2.0 * x - start)))

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The membrane over a step at whose mean it is evaluated; otherwise itself."""
        if not step.at_mean:
            return self
        return OverMeanStrain(self, step.start, step.symmetric, self.kernels.is_quadratic)


class OverMeanStrain(OverMean):
    """A membrane over a step, f = −Σ w S(Ē) : ∂E/∂x at the mean x.

    E is quadratic in x, so that E₁ − E₀ = ∂E/∂x (x₁ − x₀): the work is the change of an energy
    quadratic in E (Simo and Tarnow 1992, The Discrete Energy–Momentum Method, ZAMP 43).
    """

    def add_tangent(
        self, x: Array, v: Array, t: float, wx: float, wv: float, J: BlockMatrix, definite: bool
    ) -> None:
        """J += wx K.

        The symmetric tangent has both factors ∂E/∂x at x, the exact one the second factor at
        the end of the step.
        """
        membrane = self.term.between(self.start, x)
        if definite or self.symmetric:
            membrane.add_tangent(x, v, t, wx, wv, J, definite)
        else:
            membrane.add_mixed_tangent(x, x - self.start, float(wx), J)


def bind(
    name: str,
    kernels: Kernels,
    constants: np.ndarray,
    panel: Panel,
    slots: FindSlots,
    strain: object = "interpolated",
) -> BoundMembrane:
    """Return the membrane of a law on a panel.

    Parameters
    ----------
    name
        Name of the term.
    kernels
        The compiled entry points of the law.
    constants
        (m, p) The constants of the law in each triangle.
    panel
        The cloth with its fabrics.
    slots
        Finds blocks in the system matrix.
    strain
        "interpolated" or "pointwise"; only on P2 it makes a difference.
    """
    return BoundMembrane(
        name=name,
        kernels=kernels.regge if is_interpolated(strain, panel) else kernels,
        panel=panel,
        constants=constants,
        strain=strain_of(panel, strain),
        loop=SharedLoop.over_elements(panel, panel.cloth.stencil, slots),
    )


def strain_of(panel: Panel, strain: object) -> PointwiseStrain | ReggeStrain:
    """The strain of a panel for a term with this `strain`, "interpolated" or "pointwise"."""
    if is_interpolated(strain, panel):
        return ReggeStrain.of_panel(panel)
    return PointwiseStrain.of_panel(panel)
