"""The deformation tensor as a condition: C(x) = FᵀF − I with the energy k/2 C:C."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import inner
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.quantities.units import PER_WIDTH
from fecloth.terms.loops import membrane, membrane_loops
from fecloth.terms.loops.regge_strain import check_strain
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import MEMBRANE


@dataclass(frozen=True)
class TensorCondition:
    """W = k/2 C:C over all four entries of C = FᵀF − I = 2E, per reference area.

    The same material as `StVK` with ν = 0 and tensile stiffness 4k (so G = 2k), at the same cost.

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
        k = panel.each(lambda fabric: np.array([self.k]))
        return membrane.bind("TensorCondition", KERNELS, k, panel, slots, self.strain)


@inner
def law(E, c):
    """C = 2E: W = k/2 C:C, S = ∂W/∂E = 2k C, ∂S/∂E = 4k on each of the four entries."""
    k = c[0]
    C11, C22, C12 = 2.0 * E[0], 2.0 * E[1], 2.0 * E[2]
    W = 0.5 * k * (C11 * C11 + C22 * C22 + 2.0 * C12 * C12)
    S = (2.0 * k * C11, 2.0 * k * C22, 2.0 * k * C12)
    return W, S, (4.0 * k, 4.0 * k, 2.0 * k, 0.0, 0.0, 0.0)


KERNELS = membrane_loops.kernels(law, is_quadratic=True)
