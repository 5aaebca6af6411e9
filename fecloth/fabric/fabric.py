"""The measured constants of a fabric."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, brief, did_you_mean, is_number
from fecloth.fabric import instruments, presets
from fecloth.fabric.uncertainty import Uncertainty
from fecloth.quantities import toml_file
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import AREAL, HYSTERESIS, MOMENT, PER_ANGLE, PER_WIDTH

Pair = float | tuple[float, float]

# In SI units. A larger constant, or one below its inverse, is a mistake in a unit.
MAX_CONSTANT = 1e12


@checks_arguments
@dataclass(frozen=True)
class Fabric:
    """Constants of a woven, knitted or coated sheet; SI, all stiffness per width.

    Numbers are in SI; texts such as "150 g/m^2" may have the units of scenes. Raises
    `InputError` for a constant that is not finite or not positive, or an inadmissible Poisson
    ratio.

    Parameters
    ----------
    areal_density
        ρ, mass per reference area [kg/m²].
    tensile_stiffness
        Y, tensile force per width and strain [N/m]; one number, or (warp, weft).
    poisson_ratio
        ν₁₂ [-]: a cloth stretched along the warp by ε contracts along the weft by ν₁₂ ε.
        ν₁₂² must be less than Y₁/Y₂, so that the plane stiffness is positive definite.
    shear_stiffness
        G, shear force per width and shear angle [N/m]. Default for an isotropic fabric:
        G = Y / (2 (1 + ν)). A fabric with two different tensile stiffnesses must state it.
    bending_rigidity
        B, moment per width and curvature [N m] of a cloth bent to a cylinder; one number,
        (warp, weft), or None if unknown. A term that needs it then raises an error. A narrow
        strip, free to curve across, has B (1 − ν_b²).
    bending_poisson_ratio
        ν_b [-] of bending: a strip bent to the curvature κ along the warp and free across
        takes −ν_b κ √(B₁/B₂) there. −1 < ν_b < 1.
    bias_rigidity
        B₄₅ [N m], for a cylinder at 45° to the warp. Default: Huber's estimate, for which the
        rigidity of twist is D₆₆ = (1 − ν_b) √(B₁ B₂) / 2. It must exceed
        (B₁ + B₂ + 2 ν_b √(B₁ B₂)) / 4.
    bending_hysteresis
        2HB, difference of the moment per width between bending and unbending [N]; one number or
        (warp, weft), 0 for none. `BendingFriction` needs it; no other term uses it.
    source
        Who measured the constants, and how.
    uncertainty
        Standard uncertainties of the constants by key, as ``{"tensile_stiffness.0": 12.0,
        "shear_stiffness": "5 %"}``, and their `correlation`. No result depends on it.

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
    bending_poisson_ratio: float = 0.0
    bias_rigidity: Annotated[float | None, MOMENT] = None
    bending_hysteresis: Annotated[Pair | None, HYSTERESIS] = None
    source: str = ""
    uncertainty: Uncertainty | Mapping[str, Any] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Replace a table of uncertainties by an `Uncertainty`, and check all constants.

        Raises `InputError` as the class says.
        """
        object.__setattr__(self, "uncertainty", Uncertainty.read(self.uncertainty))
        _check_positive("areal_density", self.areal_density, "kg/m²")
        for value in self.tensile:
            _check_positive("tensile_stiffness", value, "N/m")
        warp, weft = self.tensile
        limit = math.sqrt(warp / weft)
        if not (is_number(self.poisson_ratio) and abs(self.poisson_ratio) < limit):
            what = f"poisson_ratio = {self.poisson_ratio!r}"
            allowed = f"must lie between -{limit:.4g} and {limit:.4g} (ν₁₂² < Y₁/Y₂)"
            remedy = "Outside these limits stretching would release energy."
            raise InputError(what, allowed, "Fabric", remedy)
        if self.shear_stiffness is None and warp != weft:
            what = "shear_stiffness is missing"
            allowed = "an orthotropic fabric needs it [N/m]"
            remedy = "Give shear_stiffness, or one tensile stiffness for an isotropic fabric."
            raise InputError(what, allowed, "Fabric", remedy)
        _check_positive("shear_stiffness", self.shear, "N/m")
        for value in self.bending or ():
            _check_positive("bending_rigidity", value, "N m")
        self._check_bending()
        for value in self.hysteresis or ():
            validation.positive("bending_hysteresis", value, "N", "Fabric", or_zero=True)
            if value:  # not zero, which is allowed here: not a mistake in a unit either
                _check_positive("bending_hysteresis", value, "N")

    def _check_bending(self) -> None:
        """Raise `InputError` if a plate of these constants would release energy.

        So it would if its stiffness `plate` were not positive definite. The error is also raised
        for a `bias_rigidity` that is not positive, or without a `bending_rigidity`.
        """
        nu = self.bending_poisson_ratio
        bias = self.bias_rigidity
        if not (is_number(nu) and abs(nu) < 1):
            allowed = "must lie between -1 and 1"
            raise InputError(f"bending_poisson_ratio = {nu!r}", allowed, "Fabric")
        if bias is None:
            return
        _check_positive("bias_rigidity", bias, "N m")
        if self.bending is None:
            allowed = "needs a bending_rigidity as well [N m]"
            raise InputError(f"bias_rigidity = {bias!r}", allowed, "Fabric")
        warp, weft = self.bending
        least = (warp + weft + 2 * nu * math.sqrt(warp * weft)) / 4
        if not bias > least:
            allowed = f"must exceed (B₁ + B₂ + 2 ν_b √(B₁ B₂))/4 = {least:.4g} N m"
            remedy = "Below it the fabric would twist without work."
            raise InputError(f"bias_rigidity = {bias!r}", allowed, "Fabric", remedy)

    @classmethod
    def preset(cls, name: str) -> Self:
        """Create a published fabric; `presets` returns the names.

        The sources of the numbers are in the file fecloth/fabric/fabrics.toml. Raises
        `InputError` for an unknown name.

        Examples
        --------
        >>> Fabric.preset("silk").areal_density
        0.083
        """
        return cls(**presets.constants(name))

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read the table [fabric] of a TOML file: constants, and their uncertainty.

        Raises `InputError` if the file has no such table, or another key than the fields.
        """
        return cls(**constants_in(path))

    @staticmethod
    def presets() -> tuple[str, ...]:
        """Return the names of the published fabrics, from the lightest to the heaviest."""
        return presets.names()

    @classmethod
    def from_kes(
        cls,
        fields: Mapping[str, float | tuple[float, float]],
        poisson_ratio: float = 0.0,
        load: float = 500.0,
        tensile: str = "secant",
        source: str = "KES-F",
        bending_poisson_ratio: float = 0.0,
    ) -> Self:
        """Create a fabric from the results of Kawabata's instruments (KES-F), in their units.

        Raises `InputError` for a field that is missing, unknown or not positive, or if LT and WT
        disagree, or for a B45 below what B₁ and B₂ allow (see `bias_rigidity`).

        Parameters
        ----------
        fields
            W [mg/cm²], EMT [%], G [gf/(cm deg)], B [gf cm²/cm] and optionally LT [-],
            WT [gf cm/cm²], 2HB [gf cm/cm] and B45 [gf cm²/cm]; one number or (warp, weft) each.
            Other fields of KES-F are ignored. If G has two values, their mean is used. B45, one
            number, is B of a specimen cut at 45°, which not every laboratory measures.
        poisson_ratio
            ν₁₂, which KES-F does not measure.
        load
            Largest tensile load Fm [gf/cm]. It is 500 in the standard setting of the instrument.
        tensile
            ``"secant"``: Y gives the load Fm at the extension EMT, Y = Fm / ((1 + ε)(ε +
            ε²/2)). ``"energy"``: Y gives the energy WT = LT Fm EMT / 2 at EMT, Y = 2 WT / (ε +
            ε²/2)². In the test the clamps prevent the lateral contraction. This is neglected,
            as with ν = 0.
        source
            Text that is stored in the fabric.
        bending_poisson_ratio
            ν_b, which KES-F does not measure: 0 unless another source has it.

        Notes
        -----
        S. Kawabata, The Standardization and Analysis of Hand Evaluation, 2nd ed. (1980). Without
        B45 the rigidity of twist is Huber's estimate.

        Examples
        --------
        >>> fabric = Fabric.from_kes({"W": 20.0, "EMT": (4.0, 6.0), "G": 0.8, "B": (0.1, 0.05)})
        >>> fabric.bending[0]  # 1 gf cm²/cm = 98.07 µN m
        9.80665e-06
        >>> fabric.bias_rigidity, fabric.bending_poisson_ratio  # neither was measured
        (None, 0.0)
        """
        return cls(
            **instruments.kes(fields, load, tensile),
            poisson_ratio=poisson_ratio,
            bending_poisson_ratio=bending_poisson_ratio,
            source=source,
        )

    @classmethod
    def from_fast(
        cls,
        fields: Mapping[str, float | tuple[float, float]],
        poisson_ratio: float = 0.0,
        load: int = 100,
        source: str = "FAST",
        bending_poisson_ratio: float = 0.0,
    ) -> Self:
        """Create a fabric from the results of the FAST instruments, in their units.

        Raises `InputError` for a field that is missing, unknown or not positive, or for a C45
        too short for C (see `bias_rigidity`).

        Parameters
        ----------
        fields
            W [g/m²], E5, E20 or E100 [%] (the one of `load`), EB5 [%] and the bending length
            C [mm]; one number or (warp, weft) each. Optionally C45 [mm], the bending length of a
            strip cut at 45°, which not every laboratory measures. Other fields are ignored.
        poisson_ratio, bending_poisson_ratio, source
            As for `from_kes`: FAST measures neither ratio.
        load
            5, 20 or 100 [gf/cm]. Y gives this load at the extension E5, E20 or E100, by the
            secant formula of `from_kes`.

        Notes
        -----
        B = 9.81e-6 W C³ µN m and G = 123 / EB5 N/m in these units: A. De Boos and D. Tester,
        SiroFAST, CSIRO Textile and Fibre Technology, Report WT92.02 (1994). The rigidity of
        twist is as in `from_kes`, with C45 in place of B45.

        Examples
        --------
        >>> fields = {"W": 168, "E100": (2.0, 4.0), "EB5": 3.0, "C": (15, 14.5)}
        >>> Fabric.from_fast(fields).shear
        41.0
        """
        return cls(
            **instruments.fast(fields, load),
            poisson_ratio=poisson_ratio,
            bending_poisson_ratio=bending_poisson_ratio,
            source=source,
        )

    @classmethod
    def sheet(cls, E: float, nu: float, thickness: float, rho: float) -> Self:
        """Create the fabric of a homogeneous isotropic sheet of thickness h.

        Its constants are Y = E h, B = E h³ / (12 (1 − ν²)), ν_b = ν and the areal density ρ h.
        Raises `InputError` for E, thickness or density not positive, or nu outside (-1, 0.5],
        the limits of ν for a solid that stores energy in every deformation.

        Parameters
        ----------
        E, nu, thickness, rho
            Young's modulus [Pa], Poisson's ratio [-], thickness h [m], density [kg/m³].

        Examples
        --------
        >>> Fabric.sheet(E=2e5, nu=0.3, thickness=5e-4, rho=400.0).tensile_stiffness
        100.0
        """
        _check_positive("E", E, "Pa", "Fabric.sheet")
        _check_positive("thickness", thickness, "m", "Fabric.sheet")
        _check_positive("rho", rho, "kg/m³", "Fabric.sheet")
        if not -1.0 < nu <= 0.5:
            raise InputError(f"nu = {nu!r}", "must be in (-1, 0.5]", "Fabric.sheet")
        return cls(
            areal_density=rho * thickness,
            tensile_stiffness=E * thickness,
            poisson_ratio=nu,
            bending_rigidity=E * thickness**3 / (12 * (1 - nu**2)),
            bending_poisson_ratio=nu,
        )

    @property
    def tensile(self) -> tuple[float, float]:
        """(Y₁, Y₂), tensile stiffness along warp and weft [N/m]."""
        return _pair("tensile_stiffness", self.tensile_stiffness)

    @property
    def shear(self) -> float:
        """Shear stiffness G [N/m]."""
        if self.shear_stiffness is not None:
            return self.shear_stiffness
        return self.tensile[0] / (2 * (1 + self.poisson_ratio))

    @property
    def bending(self) -> tuple[float, float] | None:
        """(B₁, B₂), bending rigidity along warp and weft [N m], or None."""
        return _optional_pair("bending_rigidity", self.bending_rigidity)

    @property
    def hysteresis(self) -> tuple[float, float] | None:
        """(2HB₁, 2HB₂), hysteresis of bending along warp and weft [N], or None."""
        return _optional_pair("bending_hysteresis", self.bending_hysteresis)

    def plate(self) -> np.ndarray:
        """(3, 3) bending stiffness D [N m] on (κ₁₁, κ₂₂, 2κ₁₂) along warp and weft.

        D₁₁ = B₁, D₂₂ = B₂, D₁₂ = ν_b √(B₁B₂) and D₆₆ = (H − D₁₂)/2. H = (4 B₄₅ − B₁ − B₂)/2
        gives the rigidity B₄₅ at 45°; without it H = √(B₁B₂) (Huber; Timoshenko and
        Woinowsky-Krieger 1959, Theory of Plates and Shells, section 86). The fabric must have
        a bending rigidity.
        """
        assert self.bending is not None
        warp, weft = self.bending
        geometric_mean = math.sqrt(warp * weft)
        if self.bias_rigidity is None:
            H = geometric_mean
        else:
            H = (4 * self.bias_rigidity - warp - weft) / 2
        D12 = self.bending_poisson_ratio * geometric_mean
        return np.array([[warp, D12, 0.0], [D12, weft, 0.0], [0.0, 0.0, (H - D12) / 2]])

    def isotropic(self, where: str) -> tuple[float, float]:
        """Return (Y [N/m], ν) for an isotropic law.

        Raises `InputError` if the stiffness depends on the direction: if Y differs between warp
        and weft, or if G is not Y/(2 (1 + ν)).

        Parameters
        ----------
        where
            Name of the law, for the error message.
        """
        warp, weft = self.tensile
        nu = self.poisson_ratio
        isotropic_shear = warp / (2 * (1 + nu))
        remedy = "StVK supports orthotropic fabrics."
        if warp != weft:
            what = f"the fabric's tensile_stiffness = ({warp!r}, {weft!r})"
            raise InputError(what, "must be one number: the law is isotropic", where, remedy)
        # G may differ by the round-off of another formula for it.
        if abs(self.shear - isotropic_shear) > 1e-9 * isotropic_shear:
            allowed = f"must be Y/(2 (1 + ν)) = {isotropic_shear:.6g}: the law is isotropic"
            what = f"the fabric's shear_stiffness = {self.shear!r}"
            raise InputError(what, allowed, where, remedy)
        return warp, nu

    def moduli(self) -> np.ndarray:
        """Plane-stress moduli ℂ in the order (C11, C22, C66, C12, C16, C26) [N/m].

        They act on (E11, E22, 2 E12). With ν₂₁ = ν₁₂ Y₂/Y₁ (symmetry): C11 = Y₁/(1 − ν₁₂ν₂₁),
        C22 = Y₂/(1 − ν₁₂ν₂₁), C12 = ν₁₂ C22, C66 = G, C16 = C26 = 0. Source: orthotropic plane
        stress in R. M. Jones, Mechanics of Composite Materials (1999), section 2.4.
        """
        warp, weft = self.tensile
        nu = self.poisson_ratio
        determinant = 1 - nu**2 * weft / warp
        c22 = weft / determinant
        return np.array([warp / determinant, c22, self.shear, nu * c22, 0.0, 0.0])


def constants_in(path: str | Path) -> dict[str, Any]:
    """Return the arguments of `Fabric` by name, from the table [fabric] of a TOML file.

    Lists become tuples. Raises `InputError` for a file that cannot be read or is not TOML, that
    has no such table, or whose table has a key that is no argument. The values are not checked.
    """
    names = [constant.name for constant in fields(Fabric)]
    where = "Fabric.read"
    tables = toml_file.read(path)
    if not isinstance(table := tables.get("fabric"), dict):
        raise InputError(f"{path} has no table [fabric]", f"of {', '.join(names)}", where)
    for key in sorted(table.keys() - set(names)):
        allowed = f"unknown key; the keys are {', '.join(names)}"
        what = f"{path}: fabric.{key} = {brief(table[key])}"
        raise InputError(what, allowed, where, did_you_mean(key, names))
    tuples = {key: tuple(value) for key, value in table.items() if isinstance(value, list)}
    return table | tuples


def _optional_pair(name: str, value: Pair | None) -> tuple[float, float] | None:
    if value is None:
        return None
    return _pair(name, value)


def _pair(name: str, value: Any) -> tuple[float, float]:
    """Return (warp, weft) from one number for both, or two; raise `InputError` for others."""
    if np.ndim(value) == 0:
        return (value, value)
    if len(value) != 2:
        raise InputError(f"{name} = {value!r}", "must be a number or (warp, weft)", "Fabric")
    warp, weft = value
    return warp, weft


def _check_positive(name: str, value: float, unit: str, where: str = "Fabric") -> None:
    """Raise `InputError` for a value that is not positive, or that is a mistake in a unit."""
    if not (is_number(value) and value > 0):
        raise InputError(f"{name} = {value!r}", f"must be a finite number > 0 [{unit}]", where)
    if not 1 / MAX_CONSTANT <= value <= MAX_CONSTANT:
        allowed = f"must be between {1 / MAX_CONSTANT:g} and {MAX_CONSTANT:g} [{unit}]"
        raise InputError(f"{name} = {value!r}", allowed, where, "Is the value in SI units?")
