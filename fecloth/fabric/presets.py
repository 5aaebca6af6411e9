"""Published fabrics: the numbers of fabrics.toml, and their conversion to constants of a `Fabric`.

The fabrics come from two publications, which use different measurements. Where both have the same
fabric (denim), the names of the presets differ. Both describe cloth at small strain. Real
cloth becomes stiffer under load; `StVK` does not.

**Clyde, Teran and Tamstorf (2017)**, Modeling and Data-Driven Parameter Estimation for Woven
Fabrics, Symposium on Computer Animation. They fitted an orthotropic hyperelastic law to
commercially available tests of each fabric.

- The presets use its moduli at zero strain, as transcribed in github.com/ipc-sim/Codim-IPC,
  Python/Drivers/FEMDiscreteShellBase.py (`cloth_weftWarpMult`: weft, coupling, warp, shear [MPa];
  `cloth_density` [g/m²]; `cloth_thickness`).
- The moduli of cotton, canvas and silk agree with a second transcription,
  github.com/navamikairanda/neuralclothsim, material/*.ini. The thickness does not: there it is
  0.253, 0.37 and 0.239 mm. The stiffness per width is uncertain by this ratio.
- The energy is a₁₁E₁₁²/2 + a₁₂E₁₁E₂₂ + a₂₂E₂₂²/2 + G₁₂E₁₂². Therefore G = G₁₂ h/2.
- The only evidence that a₁₁ belongs to the weft is the name of the variable.
- **Treat ν as not measured.** To the printed digits a₁₂ is half of a₁₁ (cotton, canvas, wool) or
  half of a₂₂ (silk, denim). This looks like a bound or an assumption of the fit. It gives
  ν₁₂ = 1.16 (silk), 0.94 (denim) and 0.5 (the others).
- The presets have no bending rigidity. The publication uses the rigidity of a shell with the whole
  thickness, B = a h³/12 (Kirchhoff and Love, as in Kairanda et al. 2024, NeuralClothSim, eq. 22 and
  29). For the warp of the denim this is 216 µN m; Wang et al. measured 16 µN m.

**Wang, O'Brien and Ramamoorthi (2011)**, Data-Driven Elastic Models for Cloth: Modeling and
Measurement, ACM Transactions on Graphics 30(4):71, doi.org/10.1145/2010324.1964966. They stretched
strips in several directions, and bent them, with their own apparatus.

- The presets use the data of the authors, graphics.berkeley.edu/papers/Wang-DDE-2011-08/: the row
  of zero strain of the tables "stretching" (c₁₁, c₁₂, c₂₂, c₃₃ [N/m]) and the column of zero
  curvature of "bending" (k [N m], edges along u, at 45° and along v).
- The numbers have the meaning of ARCSim, the simulator of their laboratory (Narain, Samii and
  O'Brien 2012, dde.cpp and physics.cpp). The energy is c₁₁E₁₁² + 2 c₁₂E₁₁E₂₂ + c₂₂E₂₂² + 2 c₃₃E₁₂².
  ARCSim doubles the numbers when it reads them, and replaces negative ones by zero. Therefore Y
  follows from the moduli 2c, and G = c₃₃.
- In shear ARCSim is inconsistent by a factor of 2. The energy above belongs to its forces
  (`stretching_force`, and the comment in it). `stretching_energy` has half of the shear term,
  G = c₃₃/2. The presets follow the forces, because these move the cloth in ARCSim.
- A hinge has the energy k l²θ²/8 over the area of its two triangles. Therefore B = k/4 (see
  `HingeBending`).
- Of the three rows of "bending" the row of edges at 45° gives the rigidity on the bias, and with it
  the rigidity of twist. They did not measure Poisson's ratio of bending: no preset has one.
- The direction v is taken as warp or wale. In the denim it is the stiffer direction, and the
  elastane is in the weft.
- Of the ten fabrics navy-sparkle-sweat is omitted, because its moduli are not positive definite.
- The authors ask to be cited. Ask for their terms before you redistribute their data files.
"""

import tomllib
from collections.abc import Callable
from functools import cache
from importlib.resources import files

from fecloth.errors import InputError
from fecloth.suggest import did_you_mean


def constants(name: str) -> dict:
    """Constants of a preset as keyword arguments of `Fabric`."""
    name = name if isinstance(name, str) else repr(name)  # a scene may have any type here
    if name not in _fabrics():
        allowed = f"must be one of {', '.join(names())}"
        raise InputError(
            f"preset = {name!r}", allowed, "Fabric.preset", did_you_mean(name, names())
        )
    return dict(_fabrics()[name])


def names() -> tuple[str, ...]:
    """Names of the presets, from the lightest to the heaviest."""
    return tuple(sorted(_fabrics(), key=lambda name: _fabrics()[name]["areal_density"]))


def clyde(density: float, thickness: float, moduli: list[float]) -> dict:
    """Constants from the density [g/m²], thickness [mm] and moduli [MPa].

    The moduli are weft, coupling, warp and shear.
    """
    weft, coupling, warp, shear = (1e3 * thickness * a for a in moduli)  # MPa times mm, in N/m
    return {"areal_density": density / 1000, **orthotropic(warp, coupling, weft, shear / 2)}


def wang(density: float, stretching: list[float], bending: list[float]) -> dict:
    """Constants from the density [kg/m²], `stretching` [N/m] and `bending` [µN m].

    `bending` is in the order of edges along u, at 45° and along v. An edge along u resists a
    curvature along v, the warp.
    """
    c11, c12, c22, c33 = stretching
    moduli = orthotropic(2 * c22, 2 * max(c12, 0.0), 2 * c11, c33)
    warp, bias, weft = (1e-6 * k / 4 for k in bending)
    return {
        "areal_density": density,
        **moduli,
        "bending_rigidity": (warp, weft),
        "bias_rigidity": bias,
    }


def orthotropic(C11: float, C12: float, C22: float, G: float) -> dict:
    """Constants from plane moduli [N/m], where the index 1 is the warp.

    Y₁ = C₁₁ − C₁₂²/C₂₂, Y₂ = C₂₂ − C₁₂²/C₁₁, ν₁₂ = C₁₂/C₂₂.

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


_CONVERSIONS: dict[str, Callable[..., dict]] = {"clyde": clyde, "wang": wang}


@cache
def _fabrics() -> dict[str, dict]:
    """The constants of every preset, by name."""
    fabrics = {}
    tables = tomllib.loads((files("fecloth.fabric") / "fabrics.toml").read_text(encoding="utf-8"))
    for family, table in tables.items():
        for name, row in table["fabrics"].items():
            source = f"{row.pop('what')}. {table['source']}"
            fabrics[name] = _CONVERSIONS[family](**row) | {"source": source}
    return fabrics
