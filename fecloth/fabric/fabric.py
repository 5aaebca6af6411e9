"""One cloth's measured constants, in the textile field's words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth.errors import InputError, is_number
from fecloth.fabric import instruments, presets
from fecloth.quantities.unit_fields import reads_units
from fecloth.quantities.units import AREAL, HYSTERESIS, MOMENT, PER_ANGLE, PER_WIDTH

Pair = float | tuple[float, float]

MEASURABLE = 1e12  # in SI units; what is beyond it, or less than its inverse, is no fabric's


@reads_units
@dataclass(frozen=True)
class Fabric:
    """Constants of a woven, knitted or coated sheet; SI, all stiffness per width.

    Numbers are in SI; texts such as "150 g/m^2" may have the units of scenes.

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
    bending_hysteresis
        2HB, what the moment per width differs between bending and unbending [N]. It is kept with
        the fabric; no term models it.
    source
        Who measured it and how.

    Raises
    ------
    InputError
        For a constant that is not finite or not positive, or an inadmissible Poisson ratio.

    Examples
    --------
    >>> fabric = Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.25)
    >>> fabric.shear
    400.0
    >>> Fabric("150 g/m^2", ("20 N/cm", "9 N/cm"), shear_stiffness=60.0).tensile_stiffness
    (2000.0, 900.0)
    """

    areal_density: Annotated[float, AREAL]
    tensile_stiffness: Annotated[Pair, PER_WIDTH]
    poisson_ratio: float = 0.0
    shear_stiffness: Annotated[float | None, PER_ANGLE] = None
    bending_rigidity: Annotated[Pair | None, MOMENT] = None
    bending_hysteresis: Annotated[Pair | None, HYSTERESIS] = None
    source: str = ""

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
        for value in _pair("bending_hysteresis", self.bending_hysteresis) or ():
            _positive("bending_hysteresis", value, "N")

    @classmethod
    def preset(cls, name: str) -> Fabric:
        """A published fabric; `presets` has their names, and where each number comes from.

        Raises
        ------
        InputError
            For an unknown name.

        Examples
        --------
        >>> Fabric.preset("silk").areal_density
        0.083
        """
        return cls(**presets.constants(name))

    @staticmethod
    def presets() -> tuple[str, ...]:
        """Names of the published fabrics, from the lightest to the heaviest."""
        return presets.names()

    @classmethod
    def from_kes(
        cls,
        fields: Mapping[str, float | tuple[float, float]],
        poisson_ratio: float = 0.0,
        load: float = 500.0,
        tensile: str = "secant",
        source: str = "KES-F",
    ) -> Fabric:
        """Fabric from what Kawabata's instruments print, in their units.

        Parameters
        ----------
        fields
            W [mg/cm²], EMT [%], G [gf/(cm deg)], B [gf cm²/cm] and, if given, LT [-],
            WT [gf cm/cm²] and 2HB [gf cm/cm]; one number or (warp, weft). Others of KES-F are
            accepted and not read. Of G in two directions the mean is taken.
        poisson_ratio
            ν₁₂, which KES-F does not measure.
        load
            The greatest tensile load Fm [gf/cm]; 500 unless the instrument was set otherwise.
        tensile
            ``"secant"``: Y bears Fm at EMT, Y = Fm / ((1 + ε)(ε + ε²/2)); ``"energy"``: Y stores
            WT = LT Fm EMT / 2 at EMT, Y = 2 WT / (ε + ε²/2)². In the test the clamps hinder the
            contraction across; that is neglected, as with ν = 0.
        source
            Kept with the fabric.

        Raises
        ------
        InputError
            For a field that is missing, unknown or not positive, or LT and WT that disagree.

        Notes
        -----
        S. Kawabata, The Standardization and Analysis of Hand Evaluation, 2nd ed. (1980).

        Examples
        --------
        >>> fabric = Fabric.from_kes({"W": 20.0, "EMT": (4.0, 6.0), "G": 0.8, "B": (0.1, 0.05)})
        >>> fabric.bending[0]  # 1 gf cm²/cm = 98.07 µN m
        9.80665e-06
        """
        return cls(
            **instruments.kes(fields, load, tensile), poisson_ratio=poisson_ratio, source=source
        )

    @classmethod
    def from_fast(
        cls,
        fields: Mapping[str, float | tuple[float, float]],
        poisson_ratio: float = 0.0,
        load: int = 100,
        source: str = "FAST",
    ) -> Fabric:
        """Fabric from what the FAST instruments print, in their units.

        Parameters
        ----------
        fields
            W [g/m²], E5, E20 or E100 [%] (that of `load`), EB5 [%] and the bending length C [mm];
            one number or (warp, weft). Others of FAST are accepted and not read.
        poisson_ratio
            ν₁₂, which FAST does not measure.
        load
            5, 20 or 100 [gf/cm]: Y bears it at the extension of that name, as in `from_kes`.
        source
            Kept with the fabric.

        Raises
        ------
        InputError
            For a field that is missing, unknown or not positive.

        Notes
        -----
        B = 9.81e-6 W C³ µN m and G = 123 / EB5 N/m in these units: A. De Boos and D. Tester,
        SiroFAST, CSIRO Textile and Fibre Technology, Report WT92.02 (1994).

        Examples
        --------
        >>> fabric = Fabric.from_fast({"W": 168, "E100": (2.0, 4.0), "EB5": 3.0, "C": (15, 14.5)})
        >>> fabric.shear
        41.0
        """
        return cls(**instruments.fast(fields, load), poisson_ratio=poisson_ratio, source=source)

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


def _pair(name: str, value: Pair | None) -> tuple[float, float] | None:
    if value is None:
        return None
    if np.ndim(value) == 0:
        return (value, value)
    if len(value) != 2:
        raise InputError(f"{name} = {value!r}", "must be a number or (warp, weft)", "Fabric")
    return tuple(value)


def _positive(name: str, value: float, unit: str, where: str = "Fabric") -> None:
    if not (is_number(value) and value > 0):
        raise InputError(f"{name} = {value!r}", f"must be a finite number > 0 [{unit}]", where)
    if not 1 / MEASURABLE <= value <= MEASURABLE:
        allowed = f"must be between {1 / MEASURABLE:g} and {MEASURABLE:g} [{unit}]"
        raise InputError(f"{name} = {value!r}", allowed, where, "Is it in SI units?")
