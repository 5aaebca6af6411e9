"""The table of a fabric with other constants."""

from collections.abc import Mapping
from typing import Any

from fecloth.errors import InputError, did_you_mean, is_number
from fecloth.fabric.merging import merged
from fecloth.fabric.uncertainty import CONSTANTS

FABRIC = "fabric"
Values = Mapping[str, float]


def fabric_with(table: Mapping[str, Any], values: Values) -> dict[str, Any]:
    """Return a copy of the table of a fabric with other constants, without their uncertainties.

    `values` are by names such as "fabric.density", or "fabric.tensile_stiffness.0" for the first
    number of a pair; names of other tables are passed over. Raise `InputError` for a name that
    is no constant of a fabric, and for a pair of which one number is missing.
    """
    fabric = {key: value for key, value in table.items() if key != "uncertainty"}
    replaced = [name.split(".")[1] for name in values if name.startswith(f"{FABRIC}.")]
    if stated := merged(table.get("uncertainty") or {}, replaced, {}):
        fabric["uncertainty"] = stated
    for name, value in values.items():
        table_name, _, rest = name.partition(".")
        key, _, number = rest.partition(".")
        if table_name != FABRIC:
            continue
        if key not in CONSTANTS:
            allowed = f"is no constant of a fabric; these are {', '.join(CONSTANTS)}"
            raise InputError(f"parameter {name!r}", allowed, "fit", did_you_mean(key, CONSTANTS))
        if number:
            _put_in_pair(fabric, key, number, value, values)
        else:
            fabric[key] = value
    # `_put_in_pair` leaves None where the fabric has no number
    for key, value in fabric.items():
        if isinstance(value, list) and None in value:
            allowed = "needs both numbers of the pair, .0 and .1, in parameters or [fabric]"
            raise InputError(f"fabric.{key}", allowed, "fit")
    return fabric


def _put_in_pair(
    fabric: dict[str, Any], key: str, number: str, value: float, values: Values
) -> None:
    """Set one number of the pair `key` in the table `fabric`: of warp, "0", or of weft, "1".

    The other number stays; it is None if the table has none. `values` are all constants that
    will be set. Raise `InputError` for another `number`. Also raise it if the table has one
    number for both directions and `values` has only one of the pair.
    """
    name = f"{FABRIC}.{key}.{number}"
    parameter = f"parameter {name!r}"
    old = fabric.get(key)
    name_of_other = f"{FABRIC}.{key}.{1 - int(number == '1')}"
    if is_number(old) and name_of_other not in values:
        allowed = "is one of two, but the fabric has one number for both directions"
        raise InputError(parameter, allowed, "fit", f"Fit {FABRIC}.{key}.")
    if number not in ("0", "1"):
        raise InputError(parameter, "must end with .0 (warp) or .1 (weft)", "fit")
    pair = list(old) if isinstance(old, list | tuple) else [old, old]
    pair[int(number)] = value
    fabric[key] = pair
