"""One cloth's measured constants, in the textile field's words."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .errors import InputError, is_number

Pair = float | tuple[float, float]


@dataclass(frozen=True)
class Fabric:
    """Constants of a woven, knitted or coated sheet; SI, all stiffness per width.

    Parameters
    ----------
    areal_density
        ρ, mass per reference area [kg/m²].
    tensile_stiffness
        Y, tensile force per width and strain [N/m]; one number, or (warp, weft).
    poisson_ratio
        ν₁₂: stretched along the warp by ε, the cloth contracts along the weft by ν₁₂ ε [-].
        Admissible if ν₁₂² < Y₁/Y₂ (the plane stiffness is then positive definite).
    shear_stiffness
        G, shear force per width and shear angle [N/m]. Left out, an isotropic fabric has
        G = Y / (2 (1 + ν)); a fabric with two tensile stiffnesses must state it.
    bending_rigidity
        B, moment per width and curvature [N m]; one number, (warp, weft), or None: not known,
        and a term that needs it says so.

    Raises
    ------
    InputError
        For a constant that is not finite or not positive, or an inadmissible Poisson ratio.

    Examples
    --------
    >>> fabric = Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.25)
    >>> fabric.shear
    400.0
    """

    areal_density: float
    tensile_stiffness: Pair
    poisson_ratio: float = 0.0
    shear_stiffness: float | None = None
    bending_rigidity: Pair | None = None

    def __post_init__(self):
        _positive("areal_density", self.areal_density, "kg/m²")
        if not is_number(self.poisson_ratio):
            raise InputError(
                f"poisson_ratio = {self.poisson_ratio!r}", "must be a number", "Fabric"
            )
        for value in self.tensile:
            _positive("tensile_stiffness", value, "N/m")
        warp, weft = self.tensile
        limit = math.sqrt(warp / weft)
        if not abs(self.poisson_ratio) < limit:
            raise InputError(
                f"poisson_ratio = {self.poisson_ratio!r}",
                f"must lie between -{limit:.4g} and {limit:.4g} (ν₁₂² < Y₁/Y₂)",
                "Fabric",
                "Beyond it the cloth would gain energy by stretching.",
            )
        if self.shear_stiffness is None and warp != weft:
            raise InputError(
                "shear_stiffness is missing",
                "an orthotropic fabric needs it [N/m]",
                "Fabric",
                "Give shear_stiffness, or one tensile stiffness for an isotropic fabric.",
            )
        _positive("shear_stiffness", self.shear, "N/m")
        for value in self.bending or ():
            _positive("bending_rigidity", value, "N m")

    @classmethod
    def sheet(cls, E: float, nu: float, thickness: float, rho: float) -> Fabric:
        """Fabric of a homogeneous isotropic sheet: Y = E h, B = E h³ / (12 (1 − ν²)), ρ h.

        Parameters
        ----------
        E, nu, thickness, rho
            Young's modulus [Pa], Poisson's ratio [-], thickness h [m], density [kg/m³].

        Examples
        --------
        >>> Fabric.sheet(E=2e5, nu=0.3, thickness=5e-4, rho=400.0).tensile_stiffness
        100.0
        """
        for name, value, unit in (
            ("E", E, "Pa"),
            ("thickness", thickness, "m"),
            ("rho", rho, "kg/m³"),
        ):
            _positive(name, value, unit, "Fabric.sheet")
        if not -1.0 < nu <= 0.5:
            raise InputError(f"nu = {nu!r}", "must lie in (-1, 0.5]", "Fabric.sheet")
        return cls(
            areal_density=rho * thickness,
            tensile_stiffness=E * thickness,
            poisson_ratio=nu,
            bending_rigidity=E * thickness**3 / (12 * (1 - nu**2)),
        )

    @property
    def tensile(self) -> tuple[float, float]:
        """(Y₁, Y₂), warp and weft [N/m]."""
        return _pair("tensile_stiffness", self.tensile_stiffness)

    @property
    def shear(self) -> float:
        """G [N/m]."""
        if self.shear_stiffness is not None:
            return self.shear_stiffness
        return self.tensile[0] / (2 * (1 + self.poisson_ratio))

    @property
    def bending(self) -> tuple[float, float] | None:
        """(B₁, B₂), warp and weft [N m], or None."""
        if self.bending_rigidity is None:
            return None
        return _pair("bending_rigidity", self.bending_rigidity)

    def isotropic(self, where: str) -> tuple[float, float]:
        """(Y [N/m], ν), for a term `where` that cannot have two directions.

        Raises
        ------
        InputError
            If the stiffness depends on the direction.
        """
        (warp, weft), nu = self.tensile, self.poisson_ratio
        shear, remedy = warp / (2 * (1 + nu)), "StVK takes orthotropic fabrics."
        if warp != weft:
            what = f"the fabric's tensile_stiffness = ({warp!r}, {weft!r})"
            raise InputError(what, "must be one number: the law is isotropic", where, remedy)
        if abs(self.shear - shear) > 1e-9 * shear:
            allowed = f"must be Y/(2 (1 + ν)) = {shear:.6g}: the law is isotropic"
            what = f"the fabric's shear_stiffness = {self.shear!r}"
            raise InputError(what, allowed, where, remedy)
        return warp, nu

    def moduli(self) -> np.ndarray:
        """Plane-stress moduli ℂ in the order (C11, C22, C66, C12, C16, C26) [N/m].

        With ν₂₁ = ν₁₂ Y₂/Y₁ (symmetry): C11 = Y₁/(1 − ν₁₂ν₂₁), C22 = Y₂/(1 − ν₁₂ν₂₁),
        C12 = ν₁₂ C22, C66 = G, acting on (E11, E22, 2 E12). Orthotropic plane stress as in
        R. M. Jones, Mechanics of Composite Materials (1999), section 2.4.
        """
        warp, weft = self.tensile
        nu = self.poisson_ratio
        determinant = 1 - nu**2 * weft / warp
        c22 = weft / determinant
        return np.array([warp / determinant, c22, self.shear, nu * c22, 0.0, 0.0])


def _pair(name: str, value: Pair) -> tuple[float, float]:
    if np.ndim(value) == 0:
        return (value, value)
    if len(value) != 2:
        raise InputError(f"{name} = {value!r}", "must be a number or (warp, weft)", "Fabric")
    return tuple(value)


def _positive(name: str, value: float, unit: str, where: str = "Fabric") -> None:
    if not (is_number(value) and value > 0):
        raise InputError(f"{name} = {value!r}", f"must be a finite number > 0 [{unit}]", where)
