"""Texts with units as values of fields: one reading for scene tables and for Python's dataclasses.

The type of a field says what it measures, as in ``width: Annotated[float, LENGTH]``.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import types
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from fecloth.errors import InputError
from fecloth.quantities.units import Dimension, is_quantity, quantity

Class = TypeVar("Class", bound=type)


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


def reads_units(cls: Class) -> Class:
    """Let a dataclass take texts with units in the fields that have a dimension, as scenes do.

    Examples
    --------
    >>> import fecloth as fc
    >>> fc.Gravity((0, 0, "-981 cm/s^2")).acceleration
    (0, 0, -9.81)
    """
    create = cls.__init__  # type: ignore[misc]  # of the class itself, not of an instance
    signature = inspect.signature(cls)

    @functools.wraps(create)
    def __init__(self: Any, *positional: Any, **named: Any) -> None:
        if any(map(_has_text, (*positional, *named.values()))):
            given = signature.bind(*positional, **named).arguments
            positional, named = (), _read(cls, given)
        create(self, *positional, **named)

    cls.__init__ = __init__  # type: ignore[misc]  # of the class itself, not of an instance
    return cls


def _read(cls: type, values: Mapping[str, Any]) -> dict[str, Any]:
    try:
        return in_si(values, _fields(cls), refuse_other_text=False)
    except InputError as error:
        raise InputError(error.what, error.allowed, cls.__name__, error.remedy) from None


@functools.cache
def _fields(cls: type) -> dict[str, Measured]:
    hints = get_type_hints(cls, include_extras=True)
    fields = {}
    for field in dataclasses.fields(cls):
        marks = getattr(hints[field.name], "__metadata__", ())
        dimensions = tuple(mark for mark in marks if isinstance(mark, Dimension))
        fields[field.name] = Measured(hints[field.name], dimensions, field.default)
    return fields


def _has_text(value: Any) -> bool:
    if isinstance(value, tuple | list):
        return any(map(_has_text, value))
    return isinstance(value, str)


def _value(key: str, value: Any, hint: Any, dimension: Dimension, refuse: bool) -> Any:
    """The value in SI if it is a text where the type has a number; of a list each item."""
    kinds = _kinds(hint)
    items = [get_args(kind)[0] for kind in kinds if get_origin(kind) is tuple]
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
