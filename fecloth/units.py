"""Units as people write them on fabrics: "150 g/m^2", "9.6 uN*m". A strict table, no algebra."""

from __future__ import annotations

import math
import re

from .errors import InputError, is_number
from .formula import nearest

GF = 9.80665e-3
"""Gram-force [N], by the standard acceleration of gravity, 9.80665 m/s² (CGPM 1901)."""

AREAL = {"kg/m^2": 1.0, "g/m^2": 1e-3, "mg/cm^2": 1e-2, "oz/yd^2": 0.028349523125 / 0.9144**2}
PER_WIDTH = {
    "N/m": 1.0,
    "kN/m": 1e3,
    "N/cm": 1e2,
    "N/mm": 1e3,
    "gf/cm": 1e2 * GF,
    "kgf/cm": 1e5 * GF,
}
PER_ANGLE = PER_WIDTH | {
    "N/(m*deg)": 180 / math.pi,
    "gf/(cm*deg)": 1e2 * GF * 180 / math.pi,
}
MOMENT = {"N*m": 1.0, "mN*m": 1e-3, "uN*m": 1e-6, "mN*cm": 1e-5, "gf*cm^2/cm": 1e-2 * GF}
HYSTERESIS = {"N": 1.0, "mN": 1e-3, "gf*cm/cm": GF}

OF_FABRIC = {
    "areal_density": AREAL,
    "tensile_stiffness": PER_WIDTH,
    "shear_stiffness": PER_ANGLE,
    "bending_rigidity": MOMENT,
    "bending_hysteresis": HYSTERESIS,
}
"""For each constant of a `Fabric` the units that it may be given in, and their value in SI."""

_QUANTITY = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s+\-.].*)")
_SPELLINGS = str.maketrans({"²": "^2", "·": "*", "⋅": "*", "µ": "u", "μ": "u", " ": "*"})


def quantity(name: str, text: str, units: dict[str, float]) -> float:
    """The value in SI of a number with one of these units.

    ``²``, ``·`` and ``µ`` are read as ``^2``, ``*`` and ``u``; a space between two units as ``*``.

    Raises
    ------
    InputError
        For text that is no number with a unit, and for a unit that is not in the table.

    Examples
    --------
    >>> quantity("areal_density", "150 g/m^2", AREAL)
    0.15
    >>> quantity("bending_rigidity", "9.6 µN m", MOMENT)
    9.6e-06
    """
    allowed = f"must be a number with one of the units {', '.join(units)}"
    match = _QUANTITY.fullmatch(text.strip())
    if not match:
        remedy = 'Write it like "1.5 N/m"; a number without a unit is in SI and has no quotes.'
        raise InputError(f"{name} = {text!r}", allowed, "", remedy)
    number, unit = match.groups()
    unit = unit.translate(_SPELLINGS)
    if unit not in units:
        raise InputError(f"{name} = {text!r}", allowed, "", nearest(unit, units))
    value = float(number) * units[unit]
    if not is_number(value):
        raise InputError(f"{name} = {text!r}", "must be finite")
    return float(f"{value:.15g}")  # 150 g/m^2 is 0.15 kg/m^2, not 0.15000000000000002
