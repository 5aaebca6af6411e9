"""Published fabrics: the numbers of fabrics.toml, as they stand in their sources, as a `Fabric`.

Two kinds of measurement, named apart where they have the same fabric (denim). Both are of a
cloth that is hardly strained: under load real cloth stiffens, which `StVK` does not.

**Clyde, Teran and Tamstorf (2017)**, Modeling and Data-Driven Parameter Estimation for Woven
Fabrics, Symposium on Computer Animation: commercially available tests of each fabric, to which an
orthotropic hyperelastic law was fitted. Quoted are its moduli at zero strain, as transcribed in
github.com/ipc-sim/Codim-IPC, Python/Drivers/FEMDiscreteShellBase.py (`cloth_weftWarpMult`: weft,
coupling, warp, shear [MPa]; `cloth_density` [g/m²]; `cloth_thickness`). Those of cotton, canvas
and silk agree with a second transcription, github.com/navamikairanda/neuralclothsim,
material/*.ini, but for the thickness, which there is 0.253, 0.37 and 0.239 mm: so far is the
stiffness per width uncertain. The energy is a₁₁E₁₁²/2 + a₁₂E₁₁E₂₂ + a₂₂E₂₂²/2 + G₁₂E₁₂², so that
G = G₁₂ h/2. That a₁₁ is the weft rests on that variable's name alone. **Take ν as not
measured**: to the digits printed a₁₂ is half of a₁₁ (cotton, canvas, wool) or of a₂₂ (silk, denim),
which looks like a bound or an assumption of the fit. From it follows ν₁₂ = 1.16 (silk), 0.94
(denim) and 0.5 (the others). Their bending is not given: it is no number of theirs but what a
shell of the whole thickness has, B = a h³/12 (Kirchhoff and Love, as in Kairanda et al. 2024,
NeuralClothSim, eq. 22 and 29), 216 µN m for the warp of the denim, of which Wang et al. measured
16.

**Wang, O'Brien and Ramamoorthi (2011)**, Data-Driven Elastic Models for Cloth: Modeling and
Measurement, ACM Transactions on Graphics 30(4):71, doi.org/10.1145/2010324.1964966: stretched
strips in several directions, and bending, by the authors' own apparatus. Quoted are the row of
zero strain of the tables "stretching" (c₁₁, c₁₂, c₂₂, c₃₃ [N/m]) and the column of zero curvature
of "bending" (k [N m], edges along u and along v) of the authors' data,
graphics.berkeley.edu/papers/Wang-DDE-2011-08/, with the meaning that ARCSim, their laboratory's
simulator, gives them (Narain, Samii and O'Brien 2012, dde.cpp and physics.cpp): the energy
c₁₁E₁₁² + 2 c₁₂E₁₁E₂₂ + c₂₂E₂₂² + 2 c₃₃E₁₂² (they are doubled when read, negative ones are taken as
zero), so that Y is that of 2c, and G = c₃₃. In shear ARCSim disagrees with itself by 2: this is the
energy of its forces (`stretching_force`, and the comment in it), `stretching_energy` has half of
the shear term, G = c₃₃/2. The forces, which move its cloth, are followed here. A hinge has k l²θ²/8
over the area of its edge's two triangles, so that B = k/4 (see `HingeBending`). The direction v is
taken as warp or wale: in the denim it is the stiffer one, and elastane lies in the weft. Of the ten
fabrics navy-sparkle-sweat is left out: its moduli are not positive definite. The authors ask to be
cited; whoever passes their data files on should ask for their terms.
"""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files

from fecloth.errors import InputError
from fecloth.suggest import did_you_mean


def constants(name: str) -> dict:
    """The constants of a preset, as `Fabric` takes them.

    Raises
    ------
    InputError
        For an unknown name.
    """
    name = name if isinstance(name, str) else repr(name)  # as a scene may have anything here
    if name not in _fabrics():
        allowed = f"must be one of {', '.join(names())}"
        raise InputError(f"preset = {name!r}", allowed, "", did_you_mean(name, names()))
    return dict(_fabrics()[name])


def names() -> tuple[str, ...]:
    """The presets, from the lightest to the heaviest."""
    return tuple(sorted(_fabrics(), key=lambda name: _fabrics()[name]["areal_density"]))


def clyde(density: float, thickness: float, moduli: list[float]) -> dict:
    """Constants from g/m², mm and MPa (weft, coupling, warp, shear)."""
    weft, coupling, warp, shear = (1e3 * thickness * a for a in moduli)  # MPa times mm, in N/m
    return {"areal_density": density / 1000, **orthotropic(warp, coupling, weft, shear / 2)}


def wang(density: float, stretching: list[float], bending: list[float]) -> dict:
    """Constants from kg/m², N/m and µN m; an edge along u resists a curvature along v, the warp."""
    c11, c12, c22, c33 = stretching
    moduli = orthotropic(2 * c22, 2 * max(c12, 0.0), 2 * c11, c33)
    return {
        "areal_density": density,
        **moduli,
        "bending_rigidity": tuple(1e-6 * k / 4 for k in bending),
    }


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


_READ = {"clyde": clyde, "wang": wang}


@cache
def _fabrics() -> dict[str, dict]:
    """The constants of every preset, by name."""
    found = {}
    tables = tomllib.loads((files("fecloth.fabric") / "fabrics.toml").read_text(encoding="utf-8"))
    for family, table in tables.items():
        for name, row in table["fabrics"].items():
            source = f"{row.pop('what')}. {table['source']}"
            found[name] = _READ[family](**row) | {"source": source}
    return found
