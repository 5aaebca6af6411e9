"""The table [fabric] of a scene file: constants, a preset, or readings of an instrument."""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

from pydantic import BaseModel, model_validator

from fecloth.errors import InputError, brief
from fecloth.fabric import presets
from fecloth.fabric.fabric import Fabric
from fecloth.scene.table_model import table_of

_FabricFields: Any = table_of(Fabric)  # a base class made at run time


class Shorthands(BaseModel, use_attribute_docstrings=True):
    """Keys of [fabric] that constants replace when it is read."""

    preset: str | None = None
    """Name of a published fabric, which gives the constants that are left out."""
    kes: dict | None = None
    """What a KES-F instrument prints; see `fecloth/fabric/README.md`."""
    fast: dict | None = None
    """What a FAST instrument prints; see `fecloth/fabric/README.md`."""


class FabricTable(_FabricFields):
    """A fabric's constants; ``preset``, ``kes`` or ``fast`` gives the constants that are left out.

    `kes` and `fast` have the fields of `Fabric.from_kes` and `Fabric.from_fast`, in the
    units of the instruments, with `load` and `tensile` among them.
    """

    shorthands: ClassVar = Shorthands.model_fields

    @model_validator(mode="before")
    @classmethod
    def _fill_from_shorthand(cls, data: Any) -> Any:
        if isinstance(data, str):  # fabric = "cotton"
            data = {"preset": data}
        if not isinstance(data, dict):
            return data
        used = [key for key in cls.shorthands if key in data]
        if len(used) > 1:
            raise InputError(f"{used[0]} and {used[1]} are given", "give one of them")
        rest = {key: value for key, value in data.items() if key not in used}
        if not used:
            return rest
        constants = _constants(used[0], data[used[0]])
        if "bending_rigidity" in rest:  # the rigidity on the bias belongs to the replaced pair
            constants.pop("bias_rigidity", None)
        return {**constants, **rest}


def _constants(key: str, value: Any) -> dict:
    """Return the constants of a preset, or constants from the readings of an instrument."""
    if key == "preset":
        return presets.constants(value)
    if not isinstance(value, dict):
        allowed = 'must be a table of instrument readings, as in { W = 20.0, "2HB" = 0.05 }'
        raise InputError(f"{key} = {brief(value)}", allowed)
    make, names = _INSTRUMENTS[key]
    settings = {name: value[name] for name in names if name in value}
    fields = {name: one for name, one in value.items() if name not in settings}
    try:
        return dataclasses.asdict(make(fields, **settings))
    except InputError as error:
        raise InputError(f"{key}.{error.what}", error.allowed, "", error.remedy) from None


_INSTRUMENTS: dict[str, tuple[Callable[..., Fabric], tuple[str, ...]]] = {
    "kes": (Fabric.from_kes, ("load", "tensile")),
    "fast": (Fabric.from_fast, ("load",)),
}
