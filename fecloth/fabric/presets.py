"""Published fabrics: the numbers of fabrics.toml, and their conversion to constants of a `Fabric`.

The head of fabrics.toml says what was measured, how the numbers are read, and what is uncertain.
"""

import tomllib
from collections.abc import Callable
from functools import cache
from importlib.resources import files

from fecloth.errors import InputError, did_you_mean


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
    """Constants from [g/m²], thickness [mm] and moduli [MPa]: weft, coupling, warp and shear."""
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
    """Constants from plane moduli [N/m], where the index 1 is the warp."""
    # Y₁ = C₁₁ − C₁₂²/C₂₂, Y₂ = C₂₂ − C₁₂²/C₁₁, ν₁₂ = C₁₂/C₂₂.
    return {
        "tensile_stiffness": (C11 - C12**2 / C22, C22 - C12**2 / C11),
        "poisson_ratio": C12 / C22,
        "shear_stiffness": G,
    }


_CONVERSIONS: dict[str, Callable[..., dict]] = {"clyde": clyde, "wang": wang}


@cache
def _fabrics() -> dict[str, dict]:
    fabrics = {}
    tables = tomllib.loads((files("fecloth.fabric") / "fabrics.toml").read_text(encoding="utf-8"))
    for family, table in tables.items():
        for name, row in table["fabrics"].items():
            source = f"{row.pop('what')}. {table['source']}"
            fabrics[name] = _CONVERSIONS[family](**row) | {"source": source}
    return fabrics
