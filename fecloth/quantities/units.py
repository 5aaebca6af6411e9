"""Units as people write them: "150 g/m^2", "5 ms", "9.6 uN*m". Fixed tables, no algebra of units:
units.toml has their values in SI, and the sources.

The type of a field names its dimension, as in ``width: Annotated[float, LENGTH]``. From there
`in_si` takes the units that a text may have, and error messages take the SI unit.
"""

import re
import tomllib
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from fecloth.errors import InputError, did_you_mean, is_number


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

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], Any]) -> Any:
        """The JSON schema of a quantity in a file: a text may stand in place of each number."""
        return _or_text(handler(schema))


def _or_text(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_or_text(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "number":
        return schema | {"type": ["number", "string"]}
    return {key: _or_text(value) for key, value in schema.items()}


_FILE = Path(__file__).with_name("units.toml")
DIMENSIONS = {
    name: Dimension(units)
    for name, units in tomllib.loads(_FILE.read_text(encoding="utf-8")).items()
}
LENGTH = DIMENSIONS["length"]
ANGLE = DIMENSIONS["angle"]
VOLUME = DIMENSIONS["volume"]
TIME = DIMENSIONS["time"]
RATE = DIMENSIONS["rate"]
SPEED = DIMENSIONS["speed"]
ACCELERATION = DIMENSIONS["acceleration"]
FORCE = DIMENSIONS["force"]
PRESSURE = DIMENSIONS["pressure"]
DENSITY = DIMENSIONS["density"]
RESISTANCE = DIMENSIONS["resistance"]
DAMPER = DIMENSIONS["damper"]
AREAL = DIMENSIONS["areal"]
PER_WIDTH = DIMENSIONS["per_width"]
PER_ANGLE = DIMENSIONS["per_angle"]
PER_VOLUME = DIMENSIONS["per_volume"]
MOMENT = DIMENSIONS["moment"]
HYSTERESIS = DIMENSIONS["hysteresis"]
GF = FORCE.units["gf"]
"""Gram-force [N]."""

_QUANTITY = re.compile(r"([-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?+)\s*+((?:1?/)?[^\W\d_].*)")
_SPELLINGS = str.maketrans({"²": "^2", "³": "^3", "·": "*", "⋅": "*", "µ": "u", "μ": "u", " ": "*"})


def is_quantity(text: str) -> bool:
    """Whether a text looks like a number with a unit, known or unknown. No formula does."""
    match = _QUANTITY.fullmatch(text.strip())
    return match is not None and not match[2].startswith("/")


def quantity(name: str, text: str, dimension: Dimension, other: str = "") -> float:
    """The value in SI of a number with one of the units of the dimension.

    ``²``, ``³``, ``·`` and ``µ`` mean ``^2``, ``^3``, ``*`` and ``u``; a space between two
    units means ``*``. Error messages have the `name` of the quantity, and what `other` text is
    allowed, such as ", or a formula".
    """
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
    formula = str in kinds
    word = any(get_origin(kind) is Literal for kind in kinds)
    if (formula or word or not refuse) and not is_quantity(value):
        return value
    return quantity(key, value, dimension, ", or a formula" if formula else "")


def _kinds(hint: Any) -> list[Any]:
    """The members of a union of types, without annotations."""
    if get_origin(hint) is Annotated:
        return _kinds(get_args(hint)[0])
    union = get_origin(hint) in (Union, types.UnionType)
    if union:
        return [kind for arg in get_args(hint) for kind in _kinds(arg)]
    return [hint]
