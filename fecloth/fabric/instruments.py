"""A fabric's constants from what the textile laboratories' instruments print: KES-F and FAST.

S. Kawabata, The Standardization and Analysis of Hand Evaluation, 2nd ed., The Textile Machinery
Society of Japan (1980): extension up to 500 gf/cm, its energy, pure bending, shear.
A. De Boos and D. Tester, SiroFAST, CSIRO Textile and Fibre Technology, Report WT92.02 (1994):
extension under 5, 20 and 100 gf/cm, bending length as in British Standard 3356 (1961), bias
extension under 5 gf/cm; read in the transcript at github.com/FabriceSalvaire/Patro,
Patro/TextileTechnology/data/SiroFast.yaml, as the report is not free.
Both instruments' fields and units, and G = 123/EB5, are tabulated in S. Kuijpers, C. Luible-Bär
and H. Gong, The Measurement of Fabric Properties for Virtual Simulation, IEEE SA Industry
Connections (2020), which is free to read, and warns that no two instruments' numbers agree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from fecloth.errors import InputError, is_number
from fecloth.quantities.units import GF
from fecloth.suggest import did_you_mean

Pair = tuple[float, float]

KES = {
    "W": 1e-2,  # mg/cm², in kg/m²
    "EMT": 1e-2,  # %
    "LT": 1.0,
    "WT": 1e2 * GF,  # gf cm/cm², in N/m
    "G": 1e2 * GF * 180 / math.pi,  # gf/(cm deg), in N/m
    "B": 1e-2 * GF,  # gf cm²/cm, in N m
    "2HB": GF,  # gf cm/cm, in N
}
"""The fields of KES-F that are read, and their units in SI."""

KES_UNUSED = ["RT", "2HG", "2HG5", "LC", "WC", "RC", "MIU", "MMD", "SMD", "T", "T0", "TM"]

FAST = {
    "W": 1e-3,  # g/m², in kg/m²
    "E5": 1e-2,  # %
    "E20": 1e-2,
    "E100": 1e-2,
    "EB5": 1e-2,
    "C": 1e-3,  # mm, in m
}
"""The fields of FAST that are read, and their units in SI."""

FAST_UNUSED = ["T2", "T100", "ST", "STR", "F", "RS", "HE"]


def kes(fields: Mapping, load: float, tensile: str) -> dict:
    """Constants of `Fabric.from_kes`, by name; see there."""
    where = "Fabric.from_kes"
    read = _read(fields, KES, KES_UNUSED, where)
    _require(read, ("W", "EMT", "G", "B"), where)
    if not (is_number(load) and load > 0):
        raise InputError(f"load = {load!r}", "must be a number > 0 [gf/cm]", where)
    force = 1e2 * GF * load
    if tensile == "secant":
        Y = tuple(secant(force, extension) for extension in read["EMT"])
    elif tensile == "energy":
        work = _work(read, force, where)
        Y = tuple(2 * w / _green(e) ** 2 for w, e in zip(work, read["EMT"], strict=True))
    else:
        raise InputError(f"tensile = {tensile!r}", 'must be "secant" or "energy"', where)
    if "LT" in read and "WT" in read:
        _agree(read, force, where)
    return {
        "areal_density": read["W"][0],
        "tensile_stiffness": Y,
        "shear_stiffness": sum(read["G"]) / 2,
        "bending_rigidity": read["B"],
        "bending_hysteresis": read.get("2HB"),
    }


def fast(fields: Mapping, load: int) -> dict:
    """Constants of `Fabric.from_fast`, by name; see there.

    A strip cut at 45° is drawn out by F/(4 G), threads being stiff: 4.903 N/m make G = 1.23/EB5.
    One that overhangs by 2 C sinks to 41.5° if B = W g C³ (F. T. Peirce, The "Handle" of Cloth as
    a Measurable Quantity, 1930).
    """
    where = "Fabric.from_fast"
    if load not in (5, 20, 100):
        raise InputError(f"load = {load!r}", "must be 5, 20 or 100 [gf/cm]", where)
    read = _read(fields, FAST, FAST_UNUSED, where)
    _require(read, ("W", f"E{load}", "EB5", "C"), where)
    density = read["W"][0]
    return {
        "areal_density": density,
        "tensile_stiffness": tuple(secant(1e2 * GF * load, e) for e in read[f"E{load}"]),
        "shear_stiffness": 1.23 / read["EB5"][0],
        "bending_rigidity": tuple(9.81 * density * c**3 for c in read["C"]),
    }


def secant(force: float, extension: float) -> float:
    """Y [N/m] with which StVK, pulled alone, bears `force` [N/m] at `extension` [-].

    P = (1 + ε) Y E with E = ε + ε²/2; the force over the extension, if that is small.

    Examples
    --------
    >>> round(secant(490.3325, 0.05), 1)
    9111.9
    """
    return force / ((1 + extension) * _green(extension))


def _green(extension: float) -> float:
    return extension + extension**2 / 2


def _work(read: dict[str, Pair], force: float, where: str) -> Pair:
    """WT [N/m], or what LT says of it: LT = WT / (Fm EMT / 2)."""
    if "WT" in read:
        return read["WT"]
    _require(read, ("LT",), where)
    return tuple(lt * force * e / 2 for lt, e in zip(read["LT"], read["EMT"], strict=True))


def _agree(read: dict[str, Pair], force: float, where: str) -> None:
    by_linearity = _work({k: v for k, v in read.items() if k != "WT"}, force, where)
    for given, expected in zip(read["WT"], by_linearity, strict=True):
        if abs(given - expected) > 0.1 * expected:
            raise InputError(
                f"WT = {given / KES['WT']:.4g}",
                f"must be LT Fm EMT / 2 = {expected / KES['WT']:.4g} [gf cm/cm²], within a tenth",
                where,
                "Is EMT in %, and was the greatest load another than 500 gf/cm?",
            )


def _read(fields: Mapping, units: Mapping[str, float], unused: list[str], where: str) -> dict:
    """The fields as (warp, weft) in SI."""
    for name in fields:
        if name not in units and name not in unused:
            allowed = f"unknown field; those that are read are {', '.join(units)}"
            remedy = did_you_mean(name, units)
            raise InputError(f"{name} = {fields[name]!r}", allowed, where, remedy)
    return {name: _pair(name, fields[name], units[name], where) for name in units if name in fields}


def _pair(name: str, value, unit: float, where: str) -> Pair:
    pair = (value, value) if is_number(value) else value
    good = isinstance(pair, (tuple, list)) and len(pair) == 2
    if not (good and all(is_number(one) and one > 0 for one in pair)):
        raise InputError(f"{name} = {value!r}", "must be a number > 0, or (warp, weft)", where)
    if name in ("W", "EB5") and pair[0] != pair[1]:
        raise InputError(f"{name} = {value!r}", "must be one number", where)
    return (unit * pair[0], unit * pair[1])


def _require(read: dict, names: tuple[str, ...], where: str) -> None:
    for name in names:
        if name not in read:
            raise InputError(f"{name} is missing", f"needed are {', '.join(names)}", where)
