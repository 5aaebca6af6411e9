"""Neo-Hookean membranes: energies that grow without bound as a triangle collapses."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import inner
from fecloth.errors import InputError, is_number
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.quantities.units import PER_WIDTH
from fecloth.terms.loops import membrane, membrane_loops
from fecloth.terms.loops.regge_strain import check_strain
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import OF_FABRIC

KINDS = ("incompressible", "compressible")


@dataclass(frozen=True)
class NeoHookean:
    """Rubber-like membrane: W(C) with C = FᵀF = I + 2E, I₁ = tr C, J = √det C (the area ratio).

    "incompressible": the sheet keeps its volume, so its thickness is 1/J times the thickness at
    rest, and the faces are free of stress:

        W = μ/2 (I₁ + 1/J² − 3),  S = μ (I − C⁻¹/J²),  ℂ = 2μ/J² (C⁻¹ ⊗ C⁻¹ + C⁻¹ ⊙ C⁻¹)

    with (A ⊙ A)_ijkl = (A_ik A_jl + A_il A_jk)/2. W is convex in E everywhere.

    "compressible":

        W = μ/2 (I₁ − 2) − μ ln J + λ/2 (ln J)²,   S = μ (I − C⁻¹) + λ ln J C⁻¹
        ℂ = λ C⁻¹ ⊗ C⁻¹ + 2 (μ − λ ln J) C⁻¹ ⊙ C⁻¹

    For plane stress the fabric gives μ = Y/(2 (1 + ν)) and λ = Yν/(1 − ν²), so that the law
    agrees with `StVK` at rest. In the metric of C the eigenvalues of ℂ are 2 (μ − λ ln J),
    twice, and 2 (λ + μ − λ ln J). So W is convex in E up to ln J = μ/λ = (1 − ν)/(2ν), which
    is an area ratio of 3.2 at ν = 0.3. Beyond, a definite tangent raises negative eigenvalues
    to zero.

    Source: "incompressible" is Treloar (1975), The Physics of Rubber Elasticity,
    W = ½ G (λ₁² + λ₂² + λ₃² − 3), here with λ₃ = 1/(λ₁λ₂); "compressible" Bonet and Wood (2008),
    Nonlinear Continuum Mechanics for Finite Element Analysis, section 6.4.3 (S is its eq. 6.28),
    for two dimensions: their W with λ₃ = 1.

    Valid for isotropic fabrics. The law is defined at any stretch; it describes rubber up to
    strains of some 20 %, as it has no limit at which chains, or yarns, are straight. In
    compression S grows at least as 1/J and W without bound, so that no equilibrium has a
    collapsed triangle. But J has no sign, and a large step may turn a triangle over.

    Cost relative to `StVK`: force 1.2 (incompressible) and 1.8 (compressible), tangent 1.2 and
    1.4.

    Parameters
    ----------
    kind
        "incompressible" or "compressible".
    mu
        μ, shear modulus per width [N/m], > 0. Left out, from the fabric; for "incompressible" it
        is Y/3, which keeps the tensile stiffness: Poisson's ratio is ½ whatever the fabric says.
    lam
        λ [N/m], ≥ 0, for "compressible" and together with `mu`.
    strain
        On P2: "interpolated", which does not lock where the cloth bends (`regge_strain`),
        or "pointwise", the Green strain itself. P1 has one constant strain in a triangle.

    Examples
    --------
    >>> import fecloth as fc
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=900.0, poisson_ratio=0.5)
    >>> law = fc.NeoHookean()
    >>> bool(abs(law.moduli(fabric) - fc.StVK().moduli(fabric)).max() < 1e-9)
    True
    """

    kind: str = "incompressible"
    mu: Annotated[float | None, PER_WIDTH] = None
    lam: Annotated[float | None, PER_WIDTH] = None
    strain: str = "interpolated"

    def __post_init__(self):
        """Raise `InputError` for a parameter that is not allowed."""
        where = "NeoHookean"
        check_strain(self.strain, where)
        validation.one_of("kind", self.kind, KINDS, where)
        if self.mu is not None:
            validation.positive("mu", self.mu, "N/m", where)
        if self.lam is not None and not (is_number(self.lam) and self.lam >= 0):
            allowed = "must be finite and >= 0 [N/m]"
            remedy = "Below 0, W falls as J goes to 0."
            raise InputError(f"lam = {self.lam!r}", allowed, where, remedy)
        if self.kind == "incompressible" and self.lam is not None:
            raise InputError("lam is given", 'only kind = "compressible" has it', where)
        if self.kind == "compressible" and (self.mu is None) != (self.lam is None):
            raise InputError("only one of mu, lam is given", "give both or neither", where)

    def constants(self, fabric: Fabric) -> np.ndarray:
        """(1,) μ, or if compressible (2,) μ and λ [N/m]: those of the term, else of the fabric.

        Raises `InputError` for a fabric that is not isotropic, or if compressible has ν < 0.
        """
        if self.mu is not None and self.lam is not None:
            return np.array([self.mu, self.lam])
        if self.mu is not None:
            return np.array([self.mu])
        Y, nu = fabric.isotropic("NeoHookean")
        if self.kind == "incompressible":
            return np.array([Y / 3])
        if nu < 0:
            what = f"poisson_ratio = {nu!r}"
            allowed = "must be >= 0"
            raise InputError(what, allowed, "NeoHookean", "Below 0, W falls as J goes to 0.")
        return np.array([Y / (2 * (1 + nu)), Y * nu / (1 - nu**2)])  # of plane stress

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ at E = 0 [N/m]."""
        mu, lam = self.constants(fabric)[[0, -1]]
        if self.kind == "incompressible":
            lam = 2 * mu
        return np.array([lam + 2 * mu, lam + 2 * mu, mu, lam, 0.0, 0.0])

    traits = OF_FABRIC
    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> membrane.BoundMembrane:
        constants = panel.each(self.constants)
        kernels = KERNELS[self.kind]
        return membrane.bind("NeoHookean", kernels, constants, panel, slots, self.strain)


@inner
def invariants(E):
    """tr E, det E, and d = det C − 1 = 2 tr E + 4 det E, exact for small E."""
    trace = E[0] + E[1]
    determinant = E[0] * E[1] - E[2] * E[2]
    return trace, determinant, 2.0 * trace + 4.0 * determinant


@inner
def positive(D):
    """D, or NaN where D ≤ 0, which only an interpolated strain has, in a long step.

    With NaN Newton's line search takes a shorter step. Otherwise W would be less than W of the
    cloth at rest, and the step would be taken.
    """
    if D > 0.0:
        return D
    return math.nan


@inner
def inverse(E, D):
    """A = C⁻¹ as (A11, A22, A12), D = det C."""
    return (1.0 + 2.0 * E[1]) / D, (1.0 + 2.0 * E[0]) / D, -2.0 * E[2] / D


@inner
def moduli(lam, g, A):
    """ℂ = λ A ⊗ A + 2g A ⊙ A as (C11, C22, C66, C12, C16, C26), for A = C⁻¹ from `inverse`.

    (A ⊙ A)_ijkl = (A_ik A_jl + A_il A_jk)/2.
    """
    A11, A22, A12 = A
    return (
        (lam + 2.0 * g) * A11 * A11,
        (lam + 2.0 * g) * A22 * A22,
        lam * A12 * A12 + g * (A11 * A22 + A12 * A12),
        lam * A11 * A22 + 2.0 * g * A12 * A12,
        (lam + 2.0 * g) * A11 * A12,
        (lam + 2.0 * g) * A22 * A12,
    )


@inner
def incompressible(E, c):
    """Return W, S and ℂ at E = (E11, E22, E12), with c = (μ,).

    W = μ/2 (2 tr E − 1 + 1/D) and S = μ (I − A/D) are written without cancellation near E = 0.
    """
    mu = c[0]
    trace, determinant, d = invariants(E)
    D = positive(1.0 + d)
    W = mu * (trace * d - 2.0 * determinant) / D
    s = mu / (D * D)
    square_less_one = d * (2.0 + d)  # D² − 1
    S = s * (square_less_one - 2.0 * E[1]), s * (square_less_one - 2.0 * E[0]), s * 2.0 * E[2]
    return W, S, moduli(2.0 * mu / D, mu / D, inverse(E, D))


@inner
def compressible_stress(E, c):
    """W and S with c = (μ, λ), and the parts of ℂ: g = μ − λ ln J and A = C⁻¹.

    S = μ (I − A) + λ ln J A is written without cancellation near E = 0.
    """
    mu = c[0]
    lam = c[1]
    trace, determinant, d = invariants(E)
    D = positive(1.0 + d)
    log_J = 0.5 * math.log1p(max(d, -1.0))  # no value below −1; there D is NaN
    A = inverse(E, D)
    s = mu / D
    p = lam * log_J
    # D (I − A) = D I − adj C has the diagonal 2 E11 + 4 det E, 2 E22 + 4 det E.
    S11 = s * (2.0 * E[0] + 4.0 * determinant) + p * A[0]
    S22 = s * (2.0 * E[1] + 4.0 * determinant) + p * A[1]
    S12 = s * 2.0 * E[2] + p * A[2]
    W = mu * (trace - log_J) + 0.5 * p * log_J
    return W, (S11, S22, S12), mu - p, A


@inner
def compressible(E, c):
    """c = (μ, λ): W = μ (tr E − ln J) + λ/2 (ln J)²."""
    W, S, g, A = compressible_stress(E, c)
    return W, S, moduli(c[1], g, A)


@inner
def convex_compressible(E, c):
    """`compressible` with the eigenvalues of ℂ in the metric of C, 2g and 2 (λ + g), ≥ 0."""
    W, S, g, A = compressible_stress(E, c)
    shear = max(g, 0.0)
    return W, S, moduli(max(c[1] + g, 0.0) - shear, shear, A)


KERNELS = {
    "incompressible": membrane_loops.kernels(incompressible),
    "compressible": membrane_loops.kernels(compressible, definite_law=convex_compressible),
}
