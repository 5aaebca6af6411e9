"""Stretch and shear conditions of Baraff and Witkin, as published or independent of the mesh."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import Array, inner
from fecloth.errors import InputError, floats
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.quantities.units import PER_VOLUME, PER_WIDTH, TIME
from fecloth.terms.loops import bound_condition
from fecloth.terms.loops.bound_condition import LengthCondition, mean_ratio, spring_modulus
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import MEMBRANE

SWAP = np.array([[0.0, 1.0], [1.0, 0.0]])  # 1 − δ_rs


@dataclass(frozen=True)
class BaraffWitkin:
    """C_u = aᵖ (|w_u| − b_u), C_v = aᵖ (|w_v| − b_v), C_s = aᵖ w_u·w_v, each with ½ k C².

    w_u = ∂x/∂u and w_v = ∂x/∂v, the columns of F along warp and weft; a is the triangle's
    reference area [m²].

    Published is p = 1. The energy of a triangle grows with a², so that the cloth's tensile
    stiffness is k_u a [N/m]: refined from h to h/2 it is four times as soft. With p = ½ the
    energy per area is

        W = ½ k_u (|w_u| − b_u)² + ½ k_v (|w_v| − b_v)² + ½ k_s (w_u·w_v)²

    on every mesh: a material. For b = 1 it agrees at rest, to second order in the strain, with
    `StVK` of Y₁ = k_u, Y₂ = k_v, G = k_s and ν = 0. No choice of its constants gives it
    another ν.

    Source: Baraff and Witkin (1998), Large Steps in Cloth Simulation, section 4.2 with eq. 10
    (stretch) and the shear condition after it; force and tangents as in
    `fecloth.terms.loops.condition`.

    Valid for any rotation and small strains, of a few per cent. W is convex in E, but as there
    is no resistance to a change of area a triangle can collapse with bounded energy.

    Cost of the force relative to `StVK`: 3.6 times, of the tangent 4.9 times.

    Parameters
    ----------
    stretch
        (k_u, k_v) [N/m for p = ½, N/m³ for p = 1; J/m⁴ᵖ]. Left out, for p = ½ only: Y of the
        fabric along warp and weft.
    shear
        k_s [N/m or N/m³], likewise; default: the fabric's G.
    rest
        (b_u, b_v): the stretches at rest; other than 1 they shrink or widen the cloth.
    area_exponent
        p: ½ or, as published, 1.
    damping
        τ [s]: each condition is damped with k_d = τ k (eq. 11); 0 for none.
    tangent
        ∂d/∂x of the damping: "symmetric" is the published one, eq. 12 without its first,
        non-symmetric part; "exact" has both parts. ∂d/∂v (eq. 13) is exact in both.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    >>> fabric = fc.Fabric(0.2, (2000.0, 900.0), shear_stiffness=60.0)
    >>> system = fc.System(cloth, fabric, [fc.BaraffWitkin(damping=0.01)])
    >>> published = fc.BaraffWitkin(stretch=(1e6, 1e6), shear=1e5, area_exponent=1.0)
    """

    stretch: Annotated[
        tuple[float, float] | None,
        PER_WIDTH.where(area_exponent=0.5),
        PER_VOLUME.where(area_exponent=1.0),
    ] = None
    shear: Annotated[
        float | None, PER_WIDTH.where(area_exponent=0.5), PER_VOLUME.where(area_exponent=1.0)
    ] = None
    rest: tuple[float, float] = (1.0, 1.0)
    area_exponent: float = 0.5
    damping: Annotated[float, TIME] = 0.0
    tangent: str = "symmetric"

    traits = replace(MEMBRANE, elements=("P1",))

    def __post_init__(self):
        """Raise `InputError` for a parameter that is not allowed.

        Constants of the fabric are for p = ½: other exponents need `stretch` and `shear`.
        """
        where = "BaraffWitkin"
        p = self.area_exponent
        validation.one_of("tangent", self.tangent, ("symmetric", "exact"), where)
        for name in ("stretch", "shear", "rest", "area_exponent", "damping"):
            values = getattr(self, name)
            if values is None:  # from the fabric
                continue
            size = 2 if name in ("stretch", "rest") else 1
            numbers = floats(name, np.ravel(values), where)
            if numbers.shape != (size,) or not (np.isfinite(numbers) & (numbers >= 0)).all():
                count = "two numbers" if size == 2 else "a number"
                allowed = f"must be {count} >= 0"
                raise InputError(f"{name} = {values!r}", allowed, where)
        if p != 0.5 and (self.stretch is None or self.shear is None):
            what = f"area_exponent = {p!r} without stretch and shear"
            allowed = "needs both: the fabric's are per width"
            remedy = "Give them in J/m^(4p), or take area_exponent = 0.5."
            raise InputError(what, allowed, where, remedy)

    def stiffness(self, fabric: Fabric) -> np.ndarray:
        """(3,) k_u, k_v, k_s."""
        stretch = fabric.tensile if self.stretch is None else self.stretch
        shear = fabric.shear if self.shear is None else self.shear
        return np.array([*stretch, shear])

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ = (C11, C22, C66, C12, C16, C26) [N/m] at rest with b = 1; for p = ½."""
        if self.area_exponent != 0.5:
            what = f"area_exponent = {self.area_exponent!r}"
            allowed = "no moduli: they depend on the mesh"
            raise InputError(what, allowed, "BaraffWitkin", "Use area_exponent = 0.5.")
        return np.array([*self.stiffness(fabric), 0.0, 0.0, 0.0])

    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> LengthCondition:
        """Return the conditions on a panel; raise `InputError` for other triangles than P1."""
        cloth = panel.cloth
        m, k = cloth.stencil.shape
        if k != 3:
            raise InputError(f"{cloth.element} triangles", "must be P1", "BaraffWitkin")
        scale = cloth.weights.sum(axis=1) ** self.area_exponent  # aᵖ
        rest = np.broadcast_to((*self.rest, 0.0), (m, 3))
        gradients = panel.gradients[:, 0].reshape(m, 6)
        constants = np.column_stack([scale, rest, gradients])
        stiffness = np.array(panel.each(self.stiffness))
        return BoundBaraffWitkin.bind(
            "BaraffWitkin",
            KERNELS,
            convex=(True, True, False),  # of w_u·w_v the second derivative is indefinite
            panel=panel,
            slots=slots,
            nodes=cloth.stencil,
            constants=constants,
            stiffness=stiffness,
            damping=self.damping * stiffness,
            tangent=self.tangent,
        )


@dataclass(frozen=True, eq=False)
class BoundBaraffWitkin(LengthCondition):
    """`BaraffWitkin` on a cloth; constants aᵖ, b_u, b_v, b_s = 0, gradients (3, 2) by rows."""

    @property
    def differences(self) -> Array:
        """∂w_u/∂x and ∂w_v/∂x."""
        return self.constants[:, 4:].reshape(-1, 3, 2).swapaxes(1, 2)

    def rest_over_step(self, e0: Array, e: Array) -> Array:
        """The constants with other values at rest, for the force over the step.

        b_u and b_v are as for springs along w_u and w_v. b_s is chosen so that w_u·w_v − b_s is
        the mean of w_u·w_v at both ends of the step.
        """
        rest = self.constants.copy()
        rest[:, 1:3] *= mean_ratio(e0, e)
        rest[:, 3] = -np.sum(np.prod(e - e0, axis=1), axis=1)
        return rest

    def moduli_over_step(self, e0: Array, e: Array) -> Array:
        """(m, 2, 2, 3, 3) a²ᵖ times the moduli of both springs and of the shear.

        e₀ and e (m, 2, 3) are w_u and w_v at the begin and at the mean of the step. The springs
        k_u and k_v are on the diagonal. The shear has k_s (w̃_r ⊗ w̃₁_s + S̄ (1 − δ_rs) I) with
        w̃_u = w_v, w̃_v = w_u, w̃₁ at the end of the step, and the mean S̄ of w_u·w_v.
        """
        k = np.einsum("err->er", self.stiffness) * self.constants[:, :1] ** 2  # k_u, k_v, k_s
        S = np.sum(np.prod(e, axis=1), axis=1) - self.rest_over_step(e0, e)[:, 3]
        # w̃_r ⊗ w̃₁_s: w_u and w_v change places by ::-1
        swapped = e[:, ::-1, None, :, None] * (2.0 * e - e0)[:, None, ::-1, None, :]
        shear = swapped + S[:, None, None, None, None] * np.einsum("rs,ij->rsij", SWAP, np.eye(3))
        moduli: Array = k[:, 2, None, None, None, None] * shear
        stretch = k[:, :2, None, None] * spring_modulus(self.constants[:, 1:3], e0, e)
        moduli[:, [0, 1], [0, 1]] += stretch
        return moduli

    def add_stress(self, x, out) -> None:
        """out (m, 4) += S11, S22, S12 [N/m] and W [J/m²]: S = ∂W/∂E with |w_u|² = 1 + 2 E11.

        W is the energy of a triangle over its area, also for p = 1.
        """
        F = self.vectors(x).swapaxes(1, 2)
        all_triangles = np.arange(len(F))
        k, C, _ = self._conditions(F, all_triangles)
        out[:, :3] += self.stress_of(F, all_triangles)
        out[:, 3] += 0.5 * np.sum(k * C * C, axis=1)

    def stress_of(self, F: Array, triangles: Array) -> Array:
        """S11, S22, S12 (r, 3) [N/m] of deformation gradients F (r, 3, 2) = (w_u, w_v)."""
        k, C, length = self._conditions(F, triangles)
        S: Array = k * C
        S[:, :2] /= length
        return S

    def _conditions(self, F: Array, triangles: Array) -> tuple[Array, Array, Array]:
        """Return the stiffness per area, C (both (r, 3)), and the lengths of w_u and w_v."""
        c = self.constants[triangles]
        per_area = c[:, 0] ** 2 / self.area[triangles]
        k = np.einsum("err->er", self.stiffness[triangles]) * per_area[:, None]
        length = np.linalg.norm(F, axis=1)
        C = np.column_stack([length - c[:, 1:3], np.sum(F[..., 0] * F[..., 1], axis=1)])
        return k, C, length

    @property
    def area(self) -> np.ndarray:
        """(m,) reference areas, from the gradients: 1 / (2 A) = |∂N₁ × ∂N₂|."""
        G = self.constants[:, 4:].reshape(-1, 3, 2)
        return 0.5 / np.abs(G[:, 0, 0] * G[:, 1, 1] - G[:, 0, 1] * G[:, 1, 0])


@inner
def conditions(y, c, order, C, g, H):
    """C = aᵖ (|w_u| − b_u, |w_v| − b_v, w_u·w_v − b_s), w_u = Σ y_a G_a1, w_v = Σ y_a G_a2.

    Fill C, and g and H, its derivatives, up to `order`, in the form of
    `fecloth.terms.loops.condition`. c are the constants of `BoundBaraffWitkin`. The derivatives
    of |w_u| at w_u = 0, where it has none, are set to 0.
    """
    scale = c[0]
    G = c[4:]
    wu = (
        y[0, 0] * G[0] + y[1, 0] * G[2] + y[2, 0] * G[4],
        y[0, 1] * G[0] + y[1, 1] * G[2] + y[2, 1] * G[4],
        y[0, 2] * G[0] + y[1, 2] * G[2] + y[2, 2] * G[4],
    )
    wv = (
        y[0, 0] * G[1] + y[1, 0] * G[3] + y[2, 0] * G[5],
        y[0, 1] * G[1] + y[1, 1] * G[3] + y[2, 1] * G[5],
        y[0, 2] * G[1] + y[1, 2] * G[3] + y[2, 2] * G[5],
    )
    lu = math.sqrt(wu[0] * wu[0] + wu[1] * wu[1] + wu[2] * wu[2])
    lv = math.sqrt(wv[0] * wv[0] + wv[1] * wv[1] + wv[2] * wv[2])
    C[0] = scale * (lu - c[1])
    C[1] = scale * (lv - c[2])
    C[2] = scale * (wu[0] * wv[0] + wu[1] * wv[1] + wu[2] * wv[2] - c[3])
    if order == 0:
        return
    iu = 0.0  # 1/|w_u|
    if lu > 0.0:
        iu = 1.0 / lu
    iv = 0.0  # 1/|w_v|
    if lv > 0.0:
        iv = 1.0 / lv
    for a in range(3):
        Gu, Gv = scale * G[2 * a], scale * G[2 * a + 1]
        for i in range(3):
            g[0, a, i] = Gu * wu[i] * iu
            g[1, a, i] = Gv * wv[i] * iv
            g[2, a, i] = Gu * wv[i] + Gv * wu[i]
    if order == 1:
        return
    for a in range(3):
        for b in range(3):
            hu = scale * G[2 * a] * G[2 * b] * iu
            hv = scale * G[2 * a + 1] * G[2 * b + 1] * iv
            hs = scale * (G[2 * a] * G[2 * b + 1] + G[2 * a + 1] * G[2 * b])
            for i in range(3):
                for j in range(3):
                    unit = 1.0 if i == j else 0.0
                    H[0, a, i, b, j] = hu * (unit - wu[i] * wu[j] * iu * iu)
                    H[1, a, i, b, j] = hv * (unit - wv[i] * wv[j] * iv * iv)
                    H[2, a, i, b, j] = hs * unit


KERNELS = bound_condition.ConditionKernels(conditions)
