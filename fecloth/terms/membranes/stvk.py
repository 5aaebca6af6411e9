"""The St. Venant–Kirchhoff membrane: energy quadratic in the Green strain."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import inner
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.quantities.units import PER_WIDTH
from fecloth.terms.loops import membrane, membrane_loops
from fecloth.terms.loops.green_strain import contract
from fecloth.terms.loops.regge_strain import check_strain
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import MEMBRANE, OF_FABRIC


@dataclass(frozen=True)
class StVK:
    """W = ½ E:ℂ:E and S = ℂ:E with the plane-stress moduli ℂ of the fabric.

    W is the energy per reference area [J/m²] and S the stress resultant [N/m], along warp and
    weft. The fabric may be isotropic or orthotropic:

        isotropic    W = Y/(2 (1 − ν²)) (E11² + E22² + 2 ν E11 E22 + 2 (1 − ν) E12²)
        orthotropic  W = (Y₁ E11² + Y₂ E22² + 2 ν₁₂ Y₂ E11 E22)/(2 (1 − ν₁₂ ν₂₁)) + 2 G E12²

    with ν₂₁ = ν₁₂ Y₂/Y₁. Pulled to the stretch λ with its sides free, it has the nominal stress
    P = Y λ (λ² − 1)/2 [N/m].

    Source: Bonet and Wood (2008), Nonlinear Continuum Mechanics for Finite Element Analysis,
    chapter 6, with plane-stress moduli (`Fabric.moduli`).

    Valid for any rotation and for small strains, of a few per cent: at 10 % P is 15.5 % above
    Y (λ − 1), and a woven fabric stiffens in another way, as its crimp is pulled out. W is
    convex in E, but compressed below a stretch of 1/√3 = 0.577 the resistance falls again: a
    triangle gives way and can collapse.

    Cost: 15 ns a triangle for the force, 68 for the tangent; other terms state theirs relative
    to these (``python -m studies.evidence.benchmarks.terms``).

    Parameters
    ----------
    strain
        On P2: "interpolated", which does not lock where the cloth bends (`regge_strain`),
        or "pointwise", the Green strain itself. P1 has one constant strain in a triangle.
    """

    strain: str = "interpolated"

    def __post_init__(self) -> None:
        check_strain(self.strain, "StVK")

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ = (C11, C22, C66, C12, C16, C26) [N/m]."""
        return fabric.moduli()

    traits = OF_FABRIC
    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> membrane.BoundMembrane:
        moduli = panel.each(self.moduli)
        return membrane.bind("StVK", KERNELS, moduli, panel, slots, self.strain)


@inner
def law(E, c):
    """c = ℂ: W = E:ℂ:E / 2, S = ℂ:E, ∂S/∂E = ℂ."""
    C = (c[0], c[1], c[2], c[3], c[4], c[5])
    S = contract(C, E)
    W = 0.5 * (S[0] * E[0] + S[1] * E[1] + 2.0 * S[2] * E[2])
    return W, S, C


KERNELS = membrane_loops.kernels(law, is_quadratic=True)


@dataclass(frozen=True)
class TensorCondition:
    """W = k/2 C:C over all four entries of C = FᵀF − I = 2E, per reference area.

    It is `StVK` with ν = 0 and the tensile stiffness 4k (so G = 2k), at the same cost.

    Source: the condition as the energy k/2 CᵀC follows Baraff and Witkin (1998), Large Steps in
    Cloth Simulation, section 4.1 (above its eq. 7).

    Valid where `StVK` is, for a cloth that does not contract as it is stretched: small strains,
    any rotation; it gives way below a stretch of 1/√3.

    Parameters
    ----------
    k
        Stiffness of the condition [N/m], > 0.
    strain
        On P2: "interpolated", which does not lock where the cloth bends (`regge_strain`),
        or "pointwise", the Green strain itself. P1 has one constant strain in a triangle.
    """

    k: Annotated[float, PER_WIDTH]
    strain: str = "interpolated"

    def __post_init__(self):
        check_strain(self.strain, "TensorCondition")
        validation.positive("k", self.k, "N/m", "TensorCondition")

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ = (C11, C22, C66, C12, C16, C26) [N/m]; the fabric's own are not used."""
        return np.array([4 * self.k, 4 * self.k, 2 * self.k, 0.0, 0.0, 0.0])

    traits = MEMBRANE
    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> membrane.BoundMembrane:
        moduli = panel.each(self.moduli)
        return membrane.bind("TensorCondition", KERNELS, moduli, panel, slots, self.strain)
