"""Tension field: a membrane that folds finely instead of bearing compression."""

import math
from dataclasses import dataclass, replace

import numpy as np

from fecloth.compiled.jit import inner
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.terms.loops import membrane, membrane_loops
from fecloth.terms.loops.green_strain import contract
from fecloth.terms.loops.regge_strain import check_strain
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import OF_FABRIC


@dataclass(frozen=True)
class TensionField:
    """`StVK` relaxed: W(E) = min over A ⪰ 0 of ½ (E + A):ℂ:(E + A), with the wrinkle strain A.

    A is the strain that wrinkles hide. With the principal strains E₁ ≥ E₂, the direction n
    of E₁ and t across it, a point is

        taut      E₂ + νE₁ > 0         W = ½ E:ℂ:E,   S = ℂ:E
        wrinkled  E₂ + νE₁ ≤ 0 < E₁    W = ½ Y E₁²,   S = Y E₁ n⊗n
        slack     E₁ ≤ 0               W = 0,         S = 0

    This is the mixed criterion: taut by the smaller principal stress, slack by the larger
    principal strain. In the wrinkled state ∂S/∂E is Y on the strain along n, and Y E₁/(E₁ − E₂)
    on the shear of n and t (twice the usual C66), as the wrinkles turn with n. Between the
    states W and S are continuous, and ℂ jumps. W is convex in E, S ⪰ 0 and ℂ ⪰ 0. So the
    tangent is semi-definite at any state, and the definite tangent is the exact one.

    Source: Pipkin (1986), The relaxed energy density for isotropic elastic membranes, IMA J.
    Appl. Math. 36, 85–99, and Steigmann (1990), Tension-field theory, Proc. R. Soc. Lond. A
    429, 141–173; the criterion is from Roddeman, Drukker, Oomens and Janssen (1987), The
    wrinkling of thin membranes, J. Appl. Mech. 54, 884–887; here for the energy of `StVK`.

    Valid where wrinkles are finer than the shapes of interest: it gives the mean surface and
    the stress, not the wrinkles, and does not depend on the mesh where `StVK` would fold at
    the width of a triangle. A slack region has no stiffness, and a wrinkled region has none
    across its wrinkles: a static solution needs a load or a mass there. Where much is slack,
    `equilibrium` may need ``max_iterations=600``, or the end of a damped run as its start. In
    tension it is valid for small strains, as `StVK` is. Isotropic fabrics only: for an
    orthotropic fabric the direction of tension is not the direction of E₁.

    Cost relative to `StVK`: force 1.7, tangent 1.2.

    Parameters
    ----------
    strain
        On P2: "interpolated", which does not lock where the cloth bends (`regge_strain`),
        or "pointwise", the Green strain itself. P1 has one constant strain in a triangle.
    """

    strain: str = "interpolated"

    def __post_init__(self) -> None:
        check_strain(self.strain, "TensionField")

    def constants(self, fabric: Fabric) -> np.ndarray:
        """(2,) Y [N/m] and ν; refuses a fabric that is not isotropic."""
        return np.array(fabric.isotropic("TensionField"))

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ [N/m] of the taut state."""
        fabric.isotropic("TensionField")
        return fabric.moduli()

    traits = replace(OF_FABRIC, space_error="leaves the strain across its wrinkles open")
    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> membrane.BoundMembrane:
        constants = panel.each(self.constants)
        return membrane.bind("TensionField", KERNELS, constants, panel, slots, self.strain)


@inner
def law(E, c):
    """W, S and ℂ at the strain E = (E11, E22, E12) of a point; c = (Y, ν).

    With the principal strains E1 ≥ E2 it is taut if E2 > −ν E1, wrinkled in one direction if E1
    is positive, and else slack, without stress.
    """
    Y = c[0]
    nu = c[1]
    mean = 0.5 * (E[0] + E[1])
    half = 0.5 * (E[0] - E[1])
    radius = math.sqrt(half * half + E[2] * E[2])
    E1 = mean + radius
    E2 = mean - radius
    if E2 + nu * E1 > 0.0:
        return taut(E, Y, nu)
    if E1 > 0.0:  # then radius > 0, as E2 ≤ −νE1 < E1
        return wrinkled(E1, E2, half / radius, E[2] / radius, Y)
    return 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inner
def taut(E, Y, nu):
    """S = ℂ:E with the plane-stress moduli."""
    C11 = Y / (1.0 - nu * nu)
    C = (C11, C11, 0.5 * (1.0 - nu) * C11, nu * C11, 0.0, 0.0)
    S = contract(C, E)
    return 0.5 * (S[0] * E[0] + S[1] * E[1] + 2.0 * S[2] * E[2]), S, C


@inner
def wrinkled(E1, E2, c, s, Y):
    """W, S and ℂ of uniaxial tension along n at the angle θ; c = cos 2θ and s = sin 2θ.

    E1 and E2 are the principal strains along n and, across it, t. S = T N with T = Y E1. With
    N = n⊗n and M = sym(n⊗t), ∂N/∂E = 2/(E1 − E2) M⊗M and so ℂ = Y N⊗N + 2 Y E1/(E1 − E2) M⊗M.
    """
    N11, N22, N12 = 0.5 * (1.0 + c), 0.5 * (1.0 - c), 0.5 * s
    M11, M12 = -0.5 * s, 0.5 * c  # M22 = −M11
    T = Y * E1
    shear = 2.0 * Y * E1 / (E1 - E2)
    C = (
        Y * N11 * N11 + shear * M11 * M11,
        Y * N22 * N22 + shear * M11 * M11,
        Y * N12 * N12 + shear * M12 * M12,
        Y * N11 * N22 - shear * M11 * M11,
        Y * N11 * N12 + shear * M11 * M12,
        Y * N22 * N12 - shear * M11 * M12,
    )
    return 0.5 * T * E1, (T * N11, T * N22, T * N12), C


KERNELS = membrane_loops.kernels(law)
