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
    """Return constants from a row of the measurements of Wang.

    Parameters
    ----------
    density
        Areal density [kg/m²].
    stretching
        Rows [N/m], of which the first is used, at zero strain.
    bending
        Rows [µN m] for edges along u, at 45° and along v; the first column is used, at zero
        curvature. An edge along u resists a curvature along v, the warp.
    least
        Least coupling modulus; a smaller one is replaced by it.
    """
    c11, c12, c22, c33 = stretching[0]
    warp, bias, weft = (1e-6 * row[0] / 4 for row in bending)
    return {
        "areal_density": density,
        **orthotropic(2 * c22, 2 * max(c12, least), 2 * c11, c33),
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
    """Return the constants of all presets by name, with their source and uncertainty.

    For the uncertainty of Wang's fabrics negative couplings count as printed; in the constants
    they are zero.
    """
    fabrics: dict[str, dict] = {}
    kinds: dict[str, tuple] = {}
    printed: dict[str, dict] = {}
    for family, table in _tables().items():
        for name, published in table["fabrics"].items():
            row = dict(published)
            source = f"{row.pop('what')}. {table['source']}"
            kinds[name] = family, row.pop("kind", family), row.pop("thicknesses", [])
            fabrics[name] = _CONVERSIONS[family](**row) | {"source": source}
            if family == "wang":
                printed[name] = wang(**row, least=-math.inf)
            else:
                printed[name] = fabrics[name]
    for name, (family, kind, thicknesses) in kinds.items():
        of_source = [printed[other] for other in kinds if kinds[other][0] == family]
        of_kind = [printed[other] for other in kinds if kind in kinds[other]]
        fabrics[name]["uncertainty"] = _uncertainty(of_source, of_kind, kind, thicknesses)
    return fabrics


def _uncertainty(
    of_source: list[dict], of_kind: list[dict], kind: str, thicknesses: list[float]
) -> dict:
    """Return the table of the uncertainty of a preset.

    It is the spread among the fabrics of the source, or of the kind where the kind has several.
    If two thicknesses were printed for a fabric, their difference says how uncertain its
    stiffness is.
    """
    table = spread(of_source)
    words = f"spread of {len(of_source)} fabrics of the source"
    if thicknesses:
        taken, other = thicknesses
        part = f"{100 * abs(taken - other) / math.sqrt(2) / taken:.0f} %"
        stiff = ["tensile_stiffness.0", "tensile_stiffness.1", "shear_stiffness"]
        table |= dict.fromkeys(stiff, part)
        table["correlation"] = tuple((a, b, 1.0) for a, b in itertools.combinations(stiff, 2))
        words = f"two printed thicknesses, {taken} and {other} mm; of ν the {words}"
    elif of_kind != of_source:
        table |= spread(of_kind)
        by_kind = f"spread of {len(of_kind)} fabrics of the kind {kind}"
        words = f"{by_kind}; where these have none: {words}"
    return table | {"source": words}


def spread(fabrics: list[dict]) -> dict[str, Any]:
    """Return the standard deviation of each constant among fabrics.

    The deviation is of the logarithms, in per cent; for ν, which may be zero, it is of the
    numbers. A constant of one fabric alone is left out.
    """
    rows = [numbers_of(constants) for constants in fabrics]
    table: dict[str, Any] = {}
    for key in [key for row in rows for key in row if key != "areal_density"]:
        values = [row[key] for row in rows if key in row]
        if len(values) < 2:
            continue
        if key == "poisson_ratio":
            table[key] = round(statistics.stdev(values), 2)
        else:
            table[key] = f"{100 * statistics.stdev(map(math.log, values)):.0f} %"
    return table
