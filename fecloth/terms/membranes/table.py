"""A membrane of measured curves."""

import math
from dataclasses import dataclass

import numpy as np

from fecloth.compiled.jit import Array, contiguous, inlined
from fecloth.errors import InputError, is_number
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel
from fecloth.terms.loops import membrane, membrane_loops
from fecloth.terms.loops.regge_strain import check_strain
from fecloth.terms.membranes.curves import PIECE_SIZE, Curve, CurveData, pack, read_rows
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import MEMBRANE
from fecloth.validation import one_of

CURVES = ("warp", "weft", "shear")
SIDES = ("held", "free")
BEYOND_LAST = 1 + 1e-6
"""Strain, relative to a curve's last strain, from which on it counts as beyond the curve.

A simulated specimen may be drawn to the last point itself, up to round-off.
"""
FIRST_PIECE = 2 + len(CURVES)
"""The place of the first piece in the constants, see `pack`."""


@dataclass(frozen=True)
class MembraneTable:
    """W = w₁(E11) + w₂(E22) + w₁₂(2 E12) + c E11 E22 with measured curves w′ = S.

    λ is the stretch and P the force per width of the flat cloth, along warp and weft. γ is the
    shear angle, by which the angle between warp and weft has become smaller, and τ the shear
    force per width, whose work per area is ∫ τ dγ:

        S₁ = P/λ      at E11 = (λ² − 1)/2, likewise S₂ of the weft at E22
        S₁₂ = τ/cos γ at 2 E12 = sin γ, mirrored for E12 < 0
        S11 = S₁ + c E22,  S22 = S₂ + c E11,  c = ν √(S₁′ S₂′) at rest

    Between the points S is a monotone cubic in E (PCHIP), and w its exact integral. In
    compression S goes on with the slope at rest, and beyond the last point with the last
    slope; a run that went there gives a warning. A slope at an end is at least a tenth of the
    secant beside it, as PCHIP may have the slope 0 where a curve like a J begins. As all S
    rise, W is convex as long as c is at most √(min S₁′ min S₂′). Where c would be more, it is
    lowered to that, with a warning.

    Source: Fritsch and Butland (1984), A method for constructing local monotone piecewise
    cubic interpolants, SIAM J. Sci. Stat. Comput. 5, 300–304, and for the ends Moler (2004),
    Numerical Computing with MATLAB, as in `scipy.interpolate.PchipInterpolator`. Between the
    two numbers that a KES sheet prints of a curve P is Fung's exponential, Pm (exp(a ε/EMT) −
    1)/(exp(a) − 1) with LT/2 = 1/a − 1/(exp(a) − 1) (Fung 1967, Elasticity of soft tissues in
    simple elongation).

    Valid for loading: unloading follows the same curve. Tension curves are of specimens that
    keep their width, as in KES, or with sides="free" of strips that narrow. Of these the stress
    is S₁ + c E22 = S₁ − ν² S₁′ E11, as S22 = 0 gives E22 = −c E11/S₂′, with the slopes S′ at rest.
    So S₁ is the measured stress, plus ν²/(1 − ν²) times its slope at rest times E11: near rest
    1/(1 − ν²) times as much. The curve of τ is exact where warp and weft keep their length. It is
    assumed that c is constant.

    Cost relative to `StVK`: force 1.6, tangent 1.2, however many points and wherever the
    strains.

    Parameters
    ----------
    warp, weft
        A CSV file with the columns `stretch` and `force [N/m]`, rows (k, 2) of both, a mapping
        of columns, or a KES sheet with EMT and LT or WT as in `Fabric.from_kes`. In place of
        `force` there may be a column `stiffness`: dS/dE [N/m] from the point before, which
        `fit` may choose. The point (1, 0) is added. Left out: a straight line, from the fabric.
    shear
        The same with `angle [rad]` (or [deg]) and `force [N/m]`, or a sheet with G.
    poisson
        ν = √(ν₁₂ ν₂₁), -1 < ν < 1. Left out: from the fabric.
    strain
        On P2: "interpolated", which does not lock where the cloth bends (`regge_strain`),
        or "pointwise", the Green strain itself. P1 has one constant strain in a triangle.
    sides
        "held" or "free": how the strips of the curves of warp and weft were tested.

    Raises
    ------
    InputError
        For what cannot be read, a curve that begins elsewhere than at rest, a row where S does
        not rise, an angle of 90° or a stretch of 4 or more, and another `poisson`.
    """

    warp: CurveData | None = None
    weft: CurveData | None = None
    shear: CurveData | None = None
    poisson: float | None = None
    strain: str = "interpolated"
    sides: str = "held"

    def __post_init__(self) -> None:
        """Replace the data of curves by their points; raise `InputError` as the class says."""
        check_strain(self.strain, "MembraneTable")
        one_of("sides", self.sides, SIDES, "MembraneTable")
        if self.poisson is not None and not (is_number(self.poisson) and abs(self.poisson) < 1):
            allowed = "must lie between -1 and 1"
            raise InputError(f"poisson = {self.poisson!r}", allowed, "MembraneTable")
        for name in CURVES:
            if (data := getattr(self, name)) is not None:
                object.__setattr__(self, name, read_rows(name, data))

    def curves(self, fabric: Fabric) -> list[Curve]:
        """S₁, S₂ and S₁₂ over E11, E22 and 2 E12.

        Where the term has no curve, it is a straight line with the modulus of the fabric.
        """
        curves = []
        for name, stiffness in zip(CURVES, fabric.moduli()[:3], strict=True):
            rows = getattr(self, name)
            if rows is None:
                curves.append(Curve.straight(stiffness))
            else:
                curve = Curve.through(name, rows)
                if self.sides == "free" and name != "shear":
                    nu = self.ratio(fabric)
                    curve = curve.steeper(nu**2 / (1 - nu**2) * curve.rest)
                curves.append(curve)
        return curves

    def ratio(self, fabric: Fabric) -> float:
        """ν: `poisson`, else √(ν₁₂ ν₂₁) of the fabric."""
        if self.poisson is not None:
            return self.poisson
        C = fabric.moduli()
        return float(C[3] / math.sqrt(C[0] * C[1]))  # C12/√(C11 C22)

    def coupling(self, fabric: Fabric) -> tuple[float, float]:
        """c [N/m] for ν at rest, and the largest |c| for which W is convex at every strain."""
        warp, weft, _ = self.curves(fabric)
        most = math.sqrt(warp.least_slope() * weft.least_slope())  # c² ≤ S₁′ S₂′
        return self.ratio(fabric) * math.sqrt(warp.rest * weft.rest), most

    def moduli(self, fabric: Fabric) -> np.ndarray:
        """(6,) ℂ at E = 0 [N/m]."""
        c, most = self.coupling(fabric)
        at_rest = [curve.rest for curve in self.curves(fabric)]
        return np.array([*at_rest, np.clip(c, -most, most), 0.0, 0.0])

    def constants(self, fabric: Fabric) -> np.ndarray:
        """(p,) the coefficients of the curves, see `pack`."""
        return pack(self.moduli(fabric)[3], self.curves(fabric))

    traits = MEMBRANE
    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> membrane.BoundMembrane:
        c = panel.each(self.constants)
        strain = self.strain
        bound = membrane.bind("MembraneTable", KERNELS, c, panel, slots, strain)
        ends = np.array([curve.end for curve in self.curves(panel.fabrics[0])])
        return BoundTable(**vars(bound), ends=ends)


@dataclass(frozen=True, eq=False)
class BoundTable(membrane.BoundMembrane):
    """`MembraneTable` on a cloth.

    Attributes
    ----------
    ends
        (3,) The strains E11, E22 and 2 E12 up to which the curves were measured.
    """

    ends: np.ndarray

    def beyond(self, x: Array, t: float) -> float:
        """Area [m²], at rest, of the cloth whose strain is beyond a measured curve."""
        nodes, A, w, _, rest = self.elements
        E = np.zeros(rest.shape)
        self.kernels.add_strain(*self.strain.shape, nodes, A, rest, 1.0, x, x, E)
        E[:, :, 2] = 2 * abs(E[:, :, 2])
        share = (self.ends * BEYOND_LAST < E).any(axis=2).mean(axis=1)
        return float(self.loop.select(share * w.sum(axis=1)).sum())


@inlined
def above_rest(c, k, E):
    """w, S and dS/dE of the curve k at E ≥ 0; the constants c are as `pack` lays them out."""
    at = E * c[1 + k]  # the strain in cells
    last = c[1 + len(CURVES)]
    if not at < last:  # beyond the last point, also for NaN
        at = last
    # Unsigned indices save the test whether an index counts from the end.
    cell = np.uintp(at)
    q = np.uintp(FIRST_PIECE + PIECE_SIZE * k) + np.uintp(PIECE_SIZE * len(CURVES)) * cell
    while c[q + np.uintp(6)] <= E:  # a point lies in the cell, below E
        q = np.uintp(c[q + np.uintp(7)])  # to the next piece
    t = E - c[q]
    w = c[q + np.uintp(1)]
    a0 = c[q + np.uintp(2)]
    a1, a2, a3 = c[q + np.uintp(3)], c[q + np.uintp(4)], c[q + np.uintp(5)]
    w += t * (a0 + t * (a1 * 0.5 + t * (a2 * (1.0 / 3.0) + t * (a3 * 0.25))))
    return w, a0 + t * (a1 + t * (a2 + t * a3)), a1 + t * (2.0 * a2 + t * (3.0 * a3))


@inlined
def on_curve(c, k, E):
    """w, S and dS/dE of the curve k at E, with the slope at rest in compression."""
    above = 0.0
    if E > 0.0:
        above = E
    w, S, slope = above_rest(c, k, above)
    below = E - above
    rest = c[np.uintp(FIRST_PIECE + PIECE_SIZE * k + 3)]
    return w + 0.5 * rest * below * below, S + rest * below, slope


@inlined
def law(E, c):
    """W, S and ℂ of the curves; the constants c are as `pack` lays them out."""
    c = contiguous(c)
    w1, S1, C11 = on_curve(c, 0, E[0])
    w2, S2, C22 = on_curve(c, 1, E[1])
    w3, S3, C66 = above_rest(c, 2, abs(2.0 * E[2]))
    C12 = c[0]
    S = S1 + C12 * E[1], S2 + C12 * E[0], math.copysign(S3, E[2])
    return w1 + w2 + w3 + C12 * E[0] * E[1], S, (C11, C22, C66, C12, 0.0, 0.0)


KERNELS = membrane_loops.kernels(law)
