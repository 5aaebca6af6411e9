"""Published fabrics: the numbers as they stand in their sources, and how they become a `Fabric`.

Two families of measurements, named apart where they have the same fabric (denim). Both are initial
moduli, of a cloth that is hardly strained: under load real cloth stiffens, which `StVK` does not.

**Clyde, Teran and Tamstorf (2017)**, Modeling and Data-Driven Parameter Estimation for Woven
Fabrics, Symposium on Computer Animation: commercially available tests of each fabric, to which an
orthotropic hyperelastic law was fitted. Quoted are its moduli at zero strain, as transcribed in
github.com/ipc-sim/Codim-IPC, Python/Drivers/FEMDiscreteShellBase.py (`cloth_weftWarpMult`: weft,
coupling, warp, shear [MPa]; `cloth_density` [g/m²]; `cloth_thickness`). Those of cotton, canvas
and silk agree with a second transcription, github.com/navamikairanda/neuralclothsim,
material/*.ini, but for the thickness, which there is 0.253, 0.37 and 0.239 mm: so far is the
stiffness per width uncertain. The energy is a₁₁E₁₁²/2 + a₁₂E₁₁E₂₂ + a₂₂E₂₂²/2 + G₁₂E₁₂², so that
G = G₁₂ h/2. Their bending was not transcribed, and is not given.

**Wang, O'Brien and Ramamoorthi (2011)**, Data-Driven Elastic Models for Cloth: Modeling and
Measurement, ACM Transactions on Graphics 30(4):71, doi.org/10.1145/2010324.1964966: stretched
strips in several directions, and bending, by the authors' own apparatus. Quoted are the row of
zero strain of the tables "stretching" (c₁₁, c₁₂, c₂₂, c₃₃ [N/m]) and the column of zero curvature
of "bending" (k [N m], edges along u and along v) of the authors' data,
graphics.berkeley.edu/papers/Wang-DDE-2011-08/, with the meaning that ARCSim, their laboratory's
simulator, gives them (Narain, Samii and O'Brien 2012, dde.cpp and physics.cpp): the energy
c₁₁E₁₁² + 2 c₁₂E₁₁E₂₂ + c₂₂E₂₂² + 2 c₃₃E₁₂² (they are doubled when read, negative ones are taken as
zero), so that Y is that of 2c, and G = c₃₃; and k l²θ²/8 over the area of an edge's two triangles,
so that B = k/4 (see `HingeBending`). The direction v is taken as warp or wale: in the denim it is
the stiffer one, and elastane lies in the weft. Of the ten fabrics navy-sparkle-sweat is left out:
its moduli are not positive definite. The authors ask to be cited; whoever passes their data files
on should ask for their terms.
"""

from __future__ import annotations

from .errors import InputError
from .formula import nearest

_CLYDE_WORDS = (
    "Clyde, Teran and Tamstorf, SCA 2017, moduli at zero strain of an orthotropic law fitted to "
    "tests of the fabric; as transcribed in github.com/ipc-sim/Codim-IPC; bending not given"
)
_WANG_WORDS = (
    "Wang, O'Brien and Ramamoorthi, ACM TOG 30(4):71, 2011, doi.org/10.1145/2010324.1964966, "
    "{name}: moduli at zero strain and bending, by the authors' apparatus; read as ARCSim does"
)

# name: (what it is, g/m², thickness [mm], weft a11, a12, warp a22, G12 [MPa])
CLYDE = {
    "silk": ("silk, woven", 83, 0.18, 4.3, 4.971, 9.942, 0.57),
    "cotton": ("cotton, woven", 103.6, 0.18, 15.557, 7.779, 25.004, 1.076),
    "canvas": ("canvas, woven", 294, 0.53, 5.366, 2.683, 19.804, 2.009),
    "denim-clyde": ("denim, woven", 400, 0.66, 4.793, 4.515, 9.029, 2.448),
    "wool-coating": ("wool coating, woven", 480.6, 1.28, 2.29, 1.145, 2.219, 0.371),
}

# name: (what it is, the authors' name, kg/m², c11, c12, c22, c33 [N/m], k along u and v [µN m])
WANG = {
    "polyester-jacket": (
        ("polyester, for jackets", "tango-red-jet-set", 0.113)
        + (43.067627, 54.373299, 171.424835, 14.314700, 14.293814, 20.345654)
    ),
    "polyester-tablecloth": (
        ("polyester, for tablecloths", "white-dots-on-blk", 0.128)
        + (2002.08618, 0.345588, 2027.48559, 19.189022, 51.713814, 31.282822)
    ),
    "interlock": (
        ("60 % cotton 40 % polyester, interlock knit, for T-shirts", "gray-interlock", 0.187)
        + (16.593832, -14.695990, 34.477123, 36.860302, 23.191698, 14.267624)
    ),
    "swimwear": (
        ("87 % nylon 13 % spandex, for swimsuits", "white-swim-solid", 0.204)
        + (47.971176, 6.834521, 104.615456, 60.773663, 60.237942, 51.018833)
    ),
    "trousers": (
        ("65 % cotton 35 % polyester, for trousers", "royal-target", 0.220)
        + (2016.55456, 9.170511, 2034.97644, 104.759674, 125.409805, 125.409805)
    ),
    "blanket": (
        ("polyester, for blankets", "pink-ribbon-brown", 0.228)
        + (151.503906, 106.028160, 244.830673, 30.250183, 117.070122, 59.774277)
    ),
    "rib-knit": (
        ("95 % cotton 5 % spandex, rib knit, for underwear", "ivory-rib-knit", 0.276)
        + (42.871021, -0.234556, 65.166023, 83.175644, 46.237591, 32.243889)
    ),
    "ponte-roma": (
        ("60 % polyester 40 % rayon, ponte roma knit, for jackets", "camel-ponte-roma", 0.284)
        + (31.146198, -12.802702, 44.028667, 31.896357, 36.348366, 37.157593)
    ),
    "denim-wang": (
        ("99 % cotton 1 % spandex, denim", "11oz-black-denim", 0.324)
        + (205.352005, 10.234077, 1013.88629, 53.387184, 64.196457, 96.951576)
    ),
}


def constants(name: str) -> dict:
    """The constants of a preset, as `Fabric` takes them.

    Raises
    ------
    InputError
        For an unknown name.
    """
    name = name if isinstance(name, str) else repr(name)  # as a scene may have anything here
    if name in CLYDE:
        words, density, *moduli = CLYDE[name]
        return clyde(density, *moduli) | {"source": f"{words}. {_CLYDE_WORDS}"}
    if name in WANG:
        words, theirs, *moduli = WANG[name]
        return wang(*moduli) | {"source": f"{words}. {_WANG_WORDS.format(name=theirs)}"}
    allowed = f"must be one of {', '.join(names())}"
    raise InputError(f"preset = {name!r}", allowed, "", nearest(name, names()))


def names() -> tuple[str, ...]:
    """The presets, from the lightest to the heaviest."""
    density = {name: row[1] / 1000 for name, row in CLYDE.items()}
    density |= {name: row[2] for name, row in WANG.items()}
    return tuple(sorted(density, key=density.get))


def clyde(density, thickness, weft, coupling, warp, shear) -> dict:
    """Constants from g/m², mm and MPa."""
    stiffness = 1e3 * thickness  # MPa times mm, in N/m
    moduli = orthotropic(*(stiffness * a for a in (warp, coupling, weft)), stiffness * shear / 2)
    return {"areal_density": density / 1000, **moduli}


def wang(density, c11, c12, c22, c33, k_u, k_v) -> dict:
    """Constants from kg/m², N/m and µN m; an edge along u resists a curvature along v, the warp."""
    moduli = orthotropic(2 * c22, 2 * max(c12, 0.0), 2 * c11, c33)
    bending = (1e-6 * k_u / 4, 1e-6 * k_v / 4)
    return {"areal_density": density, **moduli, "bending_rigidity": bending}


def orthotropic(C11: float, C12: float, C22: float, G: float) -> dict:
    """Y₁ = C₁₁ − C₁₂²/C₂₂, Y₂ = C₂₂ − C₁₂²/C₁₁, ν₁₂ = C₁₂/C₂₂ of plane moduli [N/m], 1 the warp.

    Examples
    --------
    >>> orthotropic(4.0, 1.0, 2.0, 0.5)["tensile_stiffness"]
    (3.5, 1.75)
    """
    return {
        "tensile_stiffness": (C11 - C12**2 / C22, C22 - C12**2 / C11),
        "poisson_ratio": C12 / C22,
        "shear_stiffness": G,
    }
