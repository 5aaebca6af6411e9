"""Units as people write them: "150 g/m^2", "5 ms", "9.6 uN*m".

There are fixed tables and no algebra of units: units.toml has their values in SI, and the
sources.

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
    """The units that a quantity may have.

    Attributes
    ----------
    units
        Name of each unit → its value in SI; the first unit is the SI unit.
    only
        Names and values of other fields, if the quantity has this dimension only with them.
    """

    units: Mapping[str, float]
    only: tuple[tuple[str, object], ...] = ()

    @property
    def si(self) -> str:
        """Name of the SI unit."""
        return next(iter(self.units))

    def __repr__(self) -> str:
        return self.si

    def where(self, **values: object) -> "Dimension":
        """Return the same dimension for quantities that need these values of other fields."""
        return replace(self, only=tuple(values.items()))

    def holds(self, table: Mapping[str, object]) -> bool:
        """Whether the quantity has this dimension, given the other fields of its table."""
        return all(table.get(key) == value for key, value in self.only)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], Any]) -> Any:
        """Return the JSON schema of a quantity: a text may stand in place of each number."""
        return _or_text(handler(schema))


def _or_text(schema: Any) -> Any:
    """Allow a text in a JSON schema wherever it has a number."""
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
    """Whether a text looks like a number with a unit, known or unknown; no formula does."""
    match = _QUANTITY.fullmatch(text.strip())
    return match is not None and not match[2].startswith("/")


def quantity(name: str, text: str, dimension: Dimension, other: str = "") -> float:
    """Return the value in SI of a text with a number and a unit of the dimension.

    ``²``, ``³``, ``·`` and ``µ`` mean ``^2``, ``^3``, ``*`` and ``u``; a space between two
    units means ``*``. The value is exact in decimals: 150 g/m^2 is 0.15 kg/m^2 and not
    0.15000000000000002. Raises `InputError` for another text, for a unit of another dimension,
    and for a value that is not finite. The message has the `name` of the quantity, and says what
    `other` text is allowed, such as ", or a formula".
    """
    units = dimension.units
    allowed = f"must be a number with one of the units {', '.join(units)}{other}"
    match = _QUANTITY.fullmatch(text.strip())
    if not match:
        remedy = f'Write it like "1.5 {dimension.si}"; '
        remedy += "a number without a unit is in SI and has no quotes."
        raise InputError(f"{name} = {text!r}", allowed, remedy=remedy)
    number, unit = match.groups()
    unit = unit.translate(_SPELLINGS)
    if unit.startswith("/"):
        unit = f"1{unit}"  # "/s" is the unit "1/s" of the tables
    if unit not in units:
        raise InputError(f"{name} = {text!r}", allowed, remedy=did_you_mean(unit, units))
    # The product of the decimals as they are written; binary numbers would be rounded before.
    value = float(Decimal(repr(float(number))) * Decimal(repr(units[unit])))
    if not is_number(value):
        raise InputError(f"{name} = {text!r}", "must be finite")
    return value


@dataclass(frozen=True)
class Measured:
    """What a field holds.

    Attributes
    ----------
    hint
        Its type.
    dimensions
        The dimensions that it may have.
    default
        Its default.
    """

    hint: Any
    dimensions: tuple[Dimension, ...]
    default: Any


def in_si(
    values: Mapping[str, Any], fields: Mapping[str, Measured], refuse_other_text: bool = True
) -> dict[str, Any]:
    """Return the values; a text that is a number with a unit becomes its value in SI.

    Raises `InputError` for a text where only a number is allowed. Without `refuse_other_text` it
    leaves a text that does not look like a number with a unit as it is.
    """
    known = {key: field.default for key, field in fields.items()} | dict(values)
    read = dict(values)
    for key, value in values.items():
        for dimension in fields[key].dimensions:
            if dimension.holds(known):
                read[key] = _value(key, value, fields[key].hint, dimension, refuse_other_text)
    return read


def _value(key: str, value: Any, hint: Any, dimension: Dimension, refuse_other_text: bool) -> Any:
    """Return the value of the field `key`, of the type `hint`, with texts replaced by SI values.

    A text becomes a number where the type allows a number; in a list or tuple, each item does.
    A text that does not look like a number with a unit is returned as it is where the type
    allows a formula or a word, or if not `refuse_other_text`; else it raises `InputError`, as a
    text with an unknown unit does.
    """
    types_allowed = _members(hint)
    item_types = [
        get_args(member)[0] for member in types_allowed if get_origin(member) in (tuple, Sequence)
    ]
    if isinstance(value, tuple | list) and item_types:
        item_type = item_types[0]
        return type(value)(
            _value(key, item, item_type, dimension, refuse_other_text) for item in value
        )
    if not isinstance(value, str) or float not in types_allowed:
        return value
    may_be_formula = str in types_allowed
    may_be_word = any(get_origin(member) is Literal for member in types_allowed)
    may_be_other = may_be_formula or may_be_word or not refuse_other_text
    if may_be_other and not is_quantity(value):
        return value
    other = ", or a formula" if may_be_formula else ""
    return quantity(key, value, dimension, other)


def _members(hint: Any) -> list[Any]:
    """Return the members of a union of types, without annotations."""
    if get_origin(hint) is Annotated:
        return _members(get_args(hint)[0])
    if get_origin(hint) in (Union, types.UnionType):
        return [member for arg in get_args(hint) for member in _members(arg)]
    return [hint]
