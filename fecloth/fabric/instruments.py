"""Constants of a fabric from the results of the textile instruments KES-F and FAST.

Sources:

- S. Kawabata, The Standardization and Analysis of Hand Evaluation, 2nd ed., The Textile Machinery
  Society of Japan (1980): extension up to 500 gf/cm and its energy, pure bending, shear.
- A. De Boos and D. Tester, SiroFAST, CSIRO Textile and Fibre Technology, Report WT92.02 (1994):
  extension under 5, 20 and 100 gf/cm, bending length as in British Standard 3356 (1961), bias
  extension under 5 gf/cm. Read in the transcript at github.com/FabriceSalvaire/Patro,
  Patro/TextileTechnology/data/SiroFast.yaml.
- S. Kuijpers, C. Luible-Bär and H. Gong, The Measurement of Fabric Properties for Virtual
  Simulation, IEEE SA Industry Connections (2020): tables of the fields and units of both
  instruments, and G = 123/EB5.
- D. Cooper, The Stiffness of Woven Textiles, Journal of the Textile Institute 51 (1960), T317:
  the bending stiffness along warp, weft and one other direction describes most fabrics.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from fecloth import validation
from fecloth.errors import InputError, did_you_mean, is_number
from fecloth.quantities.units import GF

Pair = tuple[float, float]

KES_UNITS = {
    "W": 1e-2,  # mg/cm², in kg/m²
    "EMT": 1e-2,  # %
    "LT": 1.0,
    "WT": 1e2 * GF,  # gf cm/cm², in N/m
    "G": 1e2 * GF * 180 / math.pi,  # gf/(cm deg), in N/m
    "B": 1e-2 * GF,  # gf cm²/cm, in N m
    "B45": 1e-2 * GF,  # the same of a specimen cut at 45°
    "2HB": GF,  # gf cm/cm, in N
}
"""The fields of KES-F that are used, and their units in SI."""

KES_UNUSED = ["RT", "2HG", "2HG5", "LC", "WC", "RC", "MIU", "MMD", "SMD", "T", "T0", "TM"]

FAST_UNITS = {
    "W": 1e-3,  # g/m², in kg/m²
    "E5": 1e-2,  # %
    "E20": 1e-2,
    "E100": 1e-2,
    "EB5": 1e-2,
    "C": 1e-3,  # mm, in m
    "C45": 1e-3,  # the same of a strip cut at 45°
}
"""The fields of FAST that are used, and their units in SI."""

FAST_UNUSED = ["T2", "T100", "ST", "STR", "F", "RS", "HE"]


def kes(fields: Mapping, load: float, tensile: str) -> dict:
    """Return constants of a fabric by name, in SI, from the fields of KES-F.

    The arguments and the formulas are as for `Fabric.from_kes`. Raises `InputError` for a
    field that is missing, unknown or not positive, for another `load` or `tensile` than allowed,
    and if LT and WT disagree.
    """
    where = "Fabric.from_kes"
    values = _to_si(fields, KES_UNITS, KES_UNUSED, where)
    _check_present(values, ("W", "EMT", "G", "B"), where)
    validation.one_of("tensile", tensile, ("secant", "energy"), where)
    force = _largest_force(load, where)
    if tensile == "secant":
        Y = tuple(secant(force, extension) for extension in values["EMT"])
    else:
        energies = _work(values, force, where)
        strains = [_green_strain(extension) for extension in values["EMT"]]
        Y = tuple(2 * W / E**2 for W, E in zip(energies, strains, strict=True))
    if "LT" in values and "WT" in values:
        _check_agreement(values, force, where)
    constants = {
        "areal_density": values["W"][0],
        "tensile_stiffness": Y,
        "shear_stiffness": sum(values["G"]) / 2,
        "bending_rigidity": values["B"],
    }
    if "B45" in values:
        constants["bias_rigidity"] = values["B45"][0]
    if "2HB" in values:
        constants["bending_hysteresis"] = values["2HB"]
    return constants


def fast(fields: Mapping, load: int) -> dict:
    """Return constants of a fabric by name, in SI, from the fields of FAST.

    The arguments are as for `Fabric.from_fast`. Raises `InputError` for a field that is
    missing, unknown or not positive, and for another `load` than 5, 20 or 100 gf/cm.

    Shear: if the threads are stiff, a force F per width extends a strip cut at 45° by F/(4 G).
    With F = 4.903 N/m this gives G = 1.23/EB5.

    Bending: a strip with the overhang 2 C bends down to 41.5° if B = W g C³ (F. T. Peirce, The
    "Handle" of Cloth as a Measurable Quantity, 1930).
    """
    where = "Fabric.from_fast"
    if load not in (5, 20, 100):
        raise InputError(f"load = {load!r}", "must be 5, 20 or 100 [gf/cm]", where)
    values = _to_si(fields, FAST_UNITS, FAST_UNUSED, where)
    _check_present(values, ("W", f"E{load}", "EB5", "C"), where)
    density = values["W"][0]
    force = 1e2 * GF * load
    constants = {
        "areal_density": density,
        "tensile_stiffness": tuple(secant(force, extension) for extension in values[f"E{load}"]),
        "shear_stiffness": 1.23 / values["EB5"][0],
        "bending_rigidity": tuple(_peirce(density, length) for length in values["C"]),
    }
    if "C45" in values:
        constants["bias_rigidity"] = _peirce(density, values["C45"][0])
    return constants


def _largest_force(load: Any, where: str) -> float:
    """Return the load [gf/cm] in N/m."""
    validation.positive("load", load, "gf/cm", where)
    return 1e2 * GF * load


def kes_curve(fields: Mapping[str, Any], name: str) -> dict[str, list[float]]:
    """Return the columns of a curve of `MembraneTable`, from fields of KES-F.

    The curve `warp` or `weft` is the exponential P = F (e^(a x) − 1)/(e^a − 1) of the part x of
    the extension EMT, with the a that gives the linearity LT. The curve `shear` is a line of the
    slope G, up to 8°, which is how far the instrument shears.

    `fields` may also have the `load` Fm [gf/cm], else it is 500. Returned are the columns
    `stretch` (λ), or for `shear` `angle` [rad], and `force` [N/m], both without the point of
    rest. Raises `InputError` for a field that is missing, unknown or not positive, and for an LT
    outside 0.1 … 1.9.
    """
    where = "MembraneTable"
    kes_fields = {key: value for key, value in fields.items() if key != "load"}
    values = _to_si(kes_fields, KES_UNITS, KES_UNUSED, where)
    x = np.linspace(0.0, 1.0, 17)[1:]
    if name == "shear":
        _check_present(values, ("G",), where)
        angles = math.radians(8.0) * x
        return {"angle": list(angles), "force": list(sum(values["G"]) / 2 * angles)}
    _check_present(values, ("EMT",), where)
    force = _largest_force(fields.get("load", 500.0), where)
    direction = int(name == "weft")  # the place in the pairs (warp, weft)
    extension = values["EMT"][direction]
    linearity = 2 * _work(values, force, where)[direction] / (force * extension)
    if not 0.1 <= linearity <= 1.9:
        raise InputError(f"LT = {linearity:.4g}", "must lie between 0.1 and 1.9", where)
    # The exponential has LT/2 = 1/a − 1/(e^a − 1). Within ±30 this covers 0.1 ≤ LT ≤ 1.9. The
    # limits differ in size, so that their middle is not a = 0, where the formula is 0/0.
    a = scipy.optimize.brentq(lambda a: 1 / a - 1 / np.expm1(a) - linearity / 2, -30.0, 30.5)
    P = force * np.expm1(a * x) / np.expm1(a)
    return {"stretch": list(1 + extension * x), "force": list(P)}


def _peirce(density: float, bending_length: float) -> float:
    """Return B [N m] from an areal density [kg/m²] and a bending length [m], with 9.81 m/s²."""
    return 9.81 * density * bending_length**3


def secant(force: float, extension: float) -> float:
    """Return Y [N/m] of StVK with the force P [N/m] at the extension ε [-].

    Y = P/((1 + ε) E) with Green's strain E = ε + ε²/2.
    """
    return force / ((1 + extension) * _green_strain(extension))


def _green_strain(extension: float) -> float:
    return extension + extension**2 / 2


def _work(values: dict[str, Pair], force: float, where: str) -> Pair:
    """Return the tensile energy WT [N/m], from the field WT or else from LT = WT/(Fm EMT/2)."""
    if "WT" in values:
        return values["WT"]
    _check_present(values, ("LT",), where)
    pairs = zip(values["LT"], values["EMT"], strict=True)
    warp, weft = (LT * force * EMT / 2 for LT, EMT in pairs)
    return warp, weft


def _check_agreement(values: dict[str, Pair], force: float, where: str) -> None:
    """Raise `InputError` if WT is not the energy LT Fm EMT/2 to 10 %; `force` is Fm [N/m].

    The fields `values` must have EMT, WT and LT, in SI.
    """
    without_work = {name: pair for name, pair in values.items() if name != "WT"}
    by_linearity = _work(without_work, force, where)
    for measured, expected in zip(values["WT"], by_linearity, strict=True):
        if abs(measured - expected) > 0.1 * expected:
            unit = KES_UNITS["WT"]
            allowed = f"must be LT Fm EMT / 2 = {expected / unit:.4g} [gf cm/cm²] to 10 %"
            remedy = "Is EMT in %? Was the largest load different from 500 gf/cm?"
            raise InputError(f"WT = {measured / unit:.4g}", allowed, where, remedy)


def _to_si(fields: Mapping, units: Mapping[str, float], unused: list[str], where: str) -> dict:
    """Return the used fields as pairs in SI; raise `InputError` for unknown fields."""
    for name in fields:
        if name not in units and name not in unused:
            allowed = f"unknown field; must be one of {', '.join(units)}"
            remedy = did_you_mean(name, units)
            raise InputError(f"{name} = {fields[name]!r}", allowed, where, remedy)
    given = [name for name in units if name in fields]
    return {name: _pair(name, fields[name], units[name], where) for name in given}


def _pair(name: str, value: Any, unit: float, where: str) -> Pair:
    """Return (warp, weft) in SI from one number for both, or from a list or tuple of two.

    `unit` is the value in SI of the unit of the field `name`. Raises `InputError` for other
    values, for numbers that are not positive, and for two different numbers where a fabric has
    one: its mass, and what is measured at 45°.
    """
    if is_number(value):
        pair = (value, value)
    else:
        pair = value
    is_pair = isinstance(pair, (tuple, list)) and len(pair) == 2
    if not (is_pair and all(is_number(number) and number > 0 for number in pair)):
        raise InputError(f"{name} = {value!r}", "must be a number > 0, or (warp, weft)", where)
    if name in ("W", "EB5", "B45", "C45") and pair[0] != pair[1]:
        raise InputError(f"{name} = {value!r}", "must be one number", where)
    return (unit * pair[0], unit * pair[1])


def _check_present(values: dict, names: tuple[str, ...], where: str) -> None:
    for name in names:
        if name not in values:
            raise InputError(f"{name} is missing", f"required are {', '.join(names)}", where)
