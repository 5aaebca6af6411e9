"""Published fabrics: numbers of fabrics.toml, and their conversion to constants of `Fabric`.

The head of fabrics.toml says what was measured, how the numbers are read, and what is uncertain.
"""

import itertools
import math
import statistics
import tomllib
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from typing import Any

from fecloth.fabric.uncertainty import numbers_of
from fecloth.validation import known


def constants(name: str) -> dict:
    """Return the constants of a preset as keyword arguments of `Fabric`.

    Raises `InputError` for an unknown name.
    """
    if not isinstance(name, str):  # a scene may have any type here
        name = repr(name)
    known(f"preset = {name!r}", name, names(), "Fabric.preset")
    return dict(_fabrics()[name])


def names() -> tuple[str, ...]:
    """Return the names of the presets, from the lightest to the heaviest."""
    return tuple(sorted(_fabrics(), key=lambda name: _fabrics()[name]["areal_density"]))


def clyde(density: float, thickness: float, moduli: list[float]) -> dict:
    """Return constants from a density [g/m²], a thickness [mm] and four moduli [MPa].

    The moduli belong to weft, coupling, warp and shear, in this order.
    """
    weft, coupling, warp, shear = (1e3 * thickness * a for a in moduli)  # MPa times mm, in N/m
    return {"areal_density": density / 1000, **orthotropic(warp, coupling, weft, shear / 2)}


def rows(name: str) -> dict[str, list[list[float]]]:
    """Return `stretching` [N/m] and `bending` [µN m] of a preset of Wang; {} for others."""
    row = _tables()["wang"]["fabrics"].get(name, {})
    return {key: row[key] for key in ("stretching", "bending") if key in row}


def wang(density: float, stretching: list, bending: list, least: float = 0.0) -> dict:
    """Return constants of `Fabric` by name, from a row of the measurements of Wang et al. (2011).

    Their energy at zero strain is c₁₁E₁₁² + 2 c₁₂E₁₁E₂₂ + c₂₂E₂₂² + 2 c₃₃E₁₂² with the axes
    1 = u, the weft, and 2 = v, the warp. The head of fabrics.toml has the address of the source,
    and says how the numbers are read.

    Parameters
    ----------
    density
        Areal density [kg/m²].
    stretching
        Six rows of c₁₁, c₁₂, c₂₂, c₃₃ [N/m]. Only the first row is used, at zero strain.
    bending
        Rows k [µN m] of edges along u, at 45° and along v; the first column is used, at zero
        curvature. An edge along u resists a curvature along v, the warp.
    least
        Least coupling modulus c₁₂ [N/m]; a smaller one is replaced by it. The simulator of the
        authors replaces negative ones by zero.
    """
    c_weft, c_coupling, c_warp, c_shear = stretching[0]
    # An edge has the energy k l²θ²/8 over the area of its triangles: k = 4 B, here in µN m.
    warp, bias, weft = (1e-6 * row[0] / 4 for row in bending)  # B [N m]
    # Moduli are second derivatives of the energy: by E₁₁ and E₂₂ they are 2 c. The one of shear
    # is c₃₃, because it is by the shear angle 2 E₁₂.
    coupling = 2 * max(c_coupling, least)
    moduli = orthotropic(C11=2 * c_warp, C12=coupling, C22=2 * c_weft, G=c_shear)
    return {
        "areal_density": density,
        **moduli,
        "bending_rigidity": (warp, weft),
        "bias_rigidity": bias,
    }


def orthotropic(C11: float, C12: float, C22: float, G: float) -> dict:
    """Return constants from plane moduli [N/m], where the index 1 is the warp.

    Y₁ = C₁₁ − C₁₂²/C₂₂, Y₂ = C₂₂ − C₁₂²/C₁₁, ν₁₂ = C₁₂/C₂₂.
    """
    return {
        "tensile_stiffness": (C11 - C12**2 / C22, C22 - C12**2 / C11),
        "poisson_ratio": C12 / C22,
        "shear_stiffness": G,
    }


_CONVERSIONS: dict[str, Callable[..., dict]] = {"clyde": clyde, "wang": wang}


@cache
def _tables() -> dict[str, Any]:
    return tomllib.loads((files("fecloth.fabric") / "fabrics.toml").read_text(encoding="utf-8"))


@cache
def _fabrics() -> dict[str, dict]:
    """Return, by the name of each preset, the arguments of `Fabric`.

    They are its constants, its source and its uncertainty. For the uncertainty of Wang's fabrics
    negative couplings count as printed; in the constants they are zero.
    """
    fabrics: dict[str, dict] = {}
    # Of each preset: the name of its publication, its kind (where the table has none, that name
    # again), and the printed thicknesses.
    origins: dict[str, tuple[str, str, list[float]]] = {}
    as_printed: dict[str, dict] = {}  # the same, but with negative couplings
    for publication, table in _tables().items():
        for name, published in table["fabrics"].items():
            row = dict(published)
            source = f"{row.pop('what')}. {table['source']}"
            kind = row.pop("kind", publication)
            thicknesses = row.pop("thicknesses", [])
            origins[name] = publication, kind, thicknesses
            fabrics[name] = _CONVERSIONS[publication](**row) | {"source": source}
            if publication == "wang":
                as_printed[name] = wang(**row, least=-math.inf)
            else:
                as_printed[name] = fabrics[name]
    for name, (publication, kind, thicknesses) in origins.items():
        of_source = [as_printed[other] for other in origins if origins[other][0] == publication]
        # Where `kind` is the name of a publication, these are all its fabrics.
        of_kind = [as_printed[other] for other in origins if kind in origins[other]]
        fabrics[name]["uncertainty"] = _uncertainty(of_source, of_kind, kind, thicknesses)
    return fabrics


def _uncertainty(
    of_source: list[dict], of_kind: list[dict], kind: str, thicknesses: list[float]
) -> dict:
    """Return the table of the uncertainty of a preset, for `Uncertainty.read`.

    It is the spread among the fabrics of the source, or of the kind where the kind has several.
    If two thicknesses were printed for a fabric, their difference says how uncertain its
    stiffness is.

    Parameters
    ----------
    of_source, of_kind
        The constants of all fabrics of its source, and of all fabrics of its kind.
    kind
        Name of the kind.
    thicknesses
        [the thickness taken, the other printed one] in mm; or [].
    """
    table = spread(of_source)
    words = f"spread of {len(of_source)} fabrics of the source"
    if thicknesses:
        taken, other = thicknesses
        # The standard deviation of two numbers is their difference over √2.
        relative_deviation = f"{100 * abs(taken - other) / math.sqrt(2) / taken:.0f} %"
        stiffness_keys = ["tensile_stiffness.0", "tensile_stiffness.1", "shear_stiffness"]
        table |= dict.fromkeys(stiffness_keys, relative_deviation)
        # All stiffness is proportional to the one thickness: it is wrong by one factor.
        pairs = itertools.combinations(stiffness_keys, 2)
        table["correlation"] = tuple((first, second, 1.0) for first, second in pairs)
        words = f"two printed thicknesses, {taken} and {other} mm; of ν the {words}"
    elif of_kind != of_source:
        table |= spread(of_kind)
        by_kind = f"spread of {len(of_kind)} fabrics of the kind {kind}"
        words = f"{by_kind}; where these have none: {words}"
    return table | {"source": words}


def spread(fabrics: list[dict]) -> dict[str, Any]:
    """Return the standard deviation of each constant among fabrics, by the constant's key.

    The deviation is of the logarithms, as a text in per cent; for ν, which may be zero, it is of
    the numbers. A constant that fewer than two fabrics have is left out, and so is the areal
    density, which a user can weigh. `fabrics` are the constants of each.
    """
    rows = [numbers_of(constants) for constants in fabrics]
    table: dict[str, Any] = {}
    keys = [key for row in rows for key in row if key != "areal_density"]
    for key in keys:
        values = [row[key] for row in rows if key in row]
        if len(values) < 2:
            continue
        if key == "poisson_ratio":
            table[key] = round(statistics.stdev(values), 2)
        else:
            table[key] = f"{100 * statistics.stdev(map(math.log, values)):.0f} %"
    return table
