"""Units as people write them: "150 g/m^2", "5 ms", "9.6 uN*m". Fixed tables, no algebra of units.

The type of a field names its dimension, as in ``width: Annotated[float, LENGTH]``. From there
`in_si` takes the units that a text may have, and error messages take the SI unit.
"""

import math
import re
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from fecloth.errors import InputError, did_you_mean, is_number

GF = 9.80665e-3
"""Gram-force [N], by the standard acceleration of gravity, 9.80665 m/s² (CGPM 1901)."""
_INCH, _FOOT, _POUND = 0.0254, 0.3048, 0.45359237  # [m], [kg]: the agreement of 1959


@dataclass(frozen=True, eq=False)
class Dimension:
    """The units that a quantity may have."""

    units: Mapping[str, float]  # name of each unit → its value in SI; the first one is the SI unit
    # Other fields and their values, if the quantity has this dimension only with these values.
    only: tuple[tuple[str, object], ...] = ()

    @property
    def si(self) -> str:
        """Name of the SI unit."""
        return next(iter(self.units))

    def __repr__(self) -> str:
        return self.si

    def where(self, **values: object) -> "Dimension":
        """The same dimension, for a quantity that has it only if other fields have these values."""
        return replace(self, only=tuple(values.items()))

    def holds(self, table: Mapping[str, object]) -> bool:
        """Whether the quantity has this dimension beside the other fields of the table."""
        return all(table.get(key) == value for key, value in self.only)


LENGTH = Dimension(
    {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3, "in": _INCH, "ft": _FOOT}
)
ANGLE = Dimension({"rad": 1.0, "deg": math.pi / 180})
VOLUME = Dimension({"m^3": 1.0, "L": 1e-3, "mL": 1e-6, "cm^3": 1e-6, "mm^3": 1e-9})
TIME = Dimension({"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0})
RATE = Dimension({"1/s": 1.0, "1/ms": 1e3, "1/min": 1 / 60, "1/h": 1 / 3600})
SPEED = Dimension(
    {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6, "mph": 5280 * _FOOT / 3600}
)
ACCELERATION = Dimension({"m/s^2": 1.0, "cm/s^2": 1e-2, "mm/s^2": 1e-3, "N/kg": 1.0})
FORCE = Dimension({"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "gf": GF, "kgf": 1e3 * GF})
PRESSURE = Dimension(
    {
        "Pa": 1.0,
        "hPa": 1e2,
        "kPa": 1e3,
        "MPa": 1e6,
        "mbar": 1e2,
        "bar": 1e5,
        "atm": 101325.0,
        "psi": 1e3 * GF * _POUND / _INCH**2,
        "N/m^2": 1.0,
        "kN/m^2": 1e3,
    }
)
DENSITY = Dimension(
    {"kg/m^3": 1.0, "g/m^3": 1e-3, "g/L": 1.0, "g/cm^3": 1e3, "Pa*s^2/m^2": 1.0, "N*s^2/m^4": 1.0}
)
RESISTANCE = Dimension({"Pa*s/m": 1.0, "mPa*s/m": 1e-3, "N*s/m^3": 1.0, "kg/(m^2*s)": 1.0})
DAMPER = Dimension({"N*s/m": 1.0, "mN*s/m": 1e-3, "N*s/mm": 1e3, "kg/s": 1.0, "g/s": 1e-3})
AREAL = Dimension(
    {"kg/m^2": 1.0, "g/m^2": 1e-3, "mg/cm^2": 1e-2, "oz/yd^2": _POUND / 16 / (3 * _FOOT) ** 2}
)
PER_WIDTH = Dimension(
    {
        "N/m": 1.0,
        "mN/m": 1e-3,
        "kN/m": 1e3,
        "N/cm": 1e2,
        "N/mm": 1e3,
        "gf/cm": 1e2 * GF,
        "kgf/cm": 1e5 * GF,
    }
)
PER_ANGLE = Dimension(
    {**PER_WIDTH.units, "N/(m*deg)": 180 / math.pi, "gf/(cm*deg)": 1e2 * GF * 180 / math.pi}
)
PER_VOLUME = Dimension({"N/m^3": 1.0, "kN/m^3": 1e3, "N/cm^3": 1e6, "J/m^4": 1.0})
MOMENT = Dimension({"N*m": 1.0, "mN*m": 1e-3, "uN*m": 1e-6, "mN*cm": 1e-5, "gf*cm^2/cm": 1e-2 * GF})
HYSTERESIS = Dimension({"N": 1.0, "mN": 1e-3, "gf*cm/cm": GF})

_QUANTITY = re.compile(r"([-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?+)\s*+((?:1?/)?[^\W\d_].*)")
_SPELLINGS = str.maketrans({"²": "^2", "³": "^3", "·": "*", "⋅": "*", "µ": "u", "μ": "u", " ": "*"})


def is_quantity(text: str) -> bool:
    """Whether a text looks like a number with a unit, known or unknown. No formula does."""
    match = _QUANTITY.fullmatch(text.strip())
    return match is not None and not match[2].startswith("/")


def quantity(name: str, text: str, dimension: Dimension, other: str = "") -> float:
    """The value in SI of a number with one of the units of the dimension."""
    # ``²``, ``³``, ``·`` and ``µ`` mean ``^2``, ``^3``, ``*`` and ``u``; a space between two units
    # means ``*``. Error messages have the `name` of the quantity, and what `other` text is allowed,
    # such as ", or a formula".
    units = dimension.units
    allowed = f"must be a number with one of the units {', '.join(units)}{other}"
    match = _QUANTITY.fullmatch(text.strip())
    if not match:
        remedy = f'Write it like "1.5 {dimension.si}"; a number without a unit is in SI and has no '
        raise InputError(f"{name} = {text!r}", allowed, "", remedy + "quotes.")
    number, unit = match.groups()
    unit = unit.translate(_SPELLINGS)
    unit = f"1{unit}" if unit.startswith("/") else unit
    if unit not in units:
        raise InputError(f"{name} = {text!r}", allowed, "", did_you_mean(unit, units))
    value = float(Decimal(repr(float(number))) * Decimal(repr(units[unit])))
    if not is_number(value):
        raise InputError(f"{name} = {text!r}", "must be finite")
    return value  # by exact decimals: 150 g/m^2 is 0.15 kg/m^2, not 0.15000000000000002


@dataclass(frozen=True)
class Measured:
    """What a field holds: its type, the dimensions that it may have, and its default."""

    hint: Any
    dimensions: tuple[Dimension, ...]
    default: Any


def in_si(
    values: Mapping[str, Any], fields: Mapping[str, Measured], refuse_other_text: bool = True
) -> dict[str, Any]:
    """The values, with each text that is a number with a unit replaced by its value in SI."""
    known = {key: field.default for key, field in fields.items()} | dict(values)
    read = dict(values)
    for key, value in values.items():
        for dimension in fields[key].dimensions:
            if dimension.holds(known):
                read[key] = _value(key, value, fields[key].hint, dimension, refuse_other_text)
    return read


def _value(key: str, value: Any, hint: Any, dimension: Dimension, refuse: bool) -> Any:
    """The value in SI if it is a text where the type has a number; of a list each item."""
    kinds = _kinds(hint)
    items = [get_args(kind)[0] for kind in kinds if get_origin(kind) in (tuple, Sequence)]
    if isinstance(value, tuple | list) and items:
        return type(value)(_value(key, item, items[0], dimension, refuse) for item in value)
    if not isinstance(value, str) or float not in kinds:
        return value
    formula, word = str in kinds, any(get_origin(kind) is Literal for kind in kinds)
    if (formula or word or not refuse) and not is_quantity(value):
        return value
    return quantity(key, value, dimension, ", or a formula" if formula else "")


def _kinds(hint: Any) -> list[Any]:
    """The members of a union of types, without annotations."""
    if get_origin(hint) is Annotated:
        return _kinds(get_args(hint)[0])
    union = get_origin(hint) in (Union, types.UnionType)
    return [kind for arg in get_args(hint) for kind in _kinds(arg)] if union else [hint]
