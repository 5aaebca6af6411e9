"""The type of a key: what a file can hold, in which units, and a description in words."""

import types
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ForwardRef, Literal, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from fecloth.quantities import units
from fecloth.quantities.units import Dimension, Measured


def fields(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the keys of a table but `type`, which names it."""
    return {key: field for key, field in table.model_fields.items() if key != "type"}


def writable(hint: Any) -> Any:
    """Return the part of a type that a file can hold.

    Of a union, functions and arrays are left out, and also lists, because the lists of a file
    are read as tuples. If nothing remains, the whole union stays.
    """
    origin = get_origin(hint)
    args = get_args(hint)
    if origin is Annotated:
        return Annotated[(writable(args[0]), *args[1:])]
    if origin in (Union, types.UnionType):
        kept = [
            member
            for member in args
            if get_origin(member) not in (Callable, list) and member is not np.ndarray
        ]
        return Union[tuple(map(writable, kept or args))]  # noqa: UP007
    if origin is tuple:
        return tuple[tuple(map(writable, args))]  # type: ignore[misc]  # made at run time
    return hint


def dimensions(field: FieldInfo) -> list[Dimension]:
    """Return the dimensions of a field; several if they depend on other keys."""
    return [item for item in field.metadata if isinstance(item, Dimension)]


def in_si(table: dict, fields: Mapping[str, FieldInfo]) -> dict:
    """Return the table with each text that is a number with a unit replaced by its SI value."""
    measured = {
        key: Measured(field.annotation, tuple(dimensions(field)), field.default)
        for key, field in fields.items()
    }
    return units.in_si(table, measured)


_WORDS = {  # singular and plural
    float: ("a finite number", "finite numbers"),
    int: ("a whole number", "whole numbers"),
    str: ("a string", "strings"),
    bool: ("true or false", "true or false"),
    dict: ("a table", "tables"),
}
_LIMITS = (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<="))


def phrase(field: FieldInfo) -> str:
    """Describe the values of a field, e.g. "a finite number > 0 [s]"."""
    kinds = _describe_type(field.annotation) + _describe_limits(field.metadata)
    units = " or ".join(dimension.si for dimension in dimensions(field))
    if units:
        return f"{kinds} [{units}]"
    return kinds


def meaning(field: FieldInfo) -> str:
    """Return what the key means, on one line: the string below the field."""
    return " ".join((field.description or "").split())


def _describe_limits(metadata) -> str:
    """Describe the limits of a number in the metadata of its type.

    For example " > 0", " >= 0 and < 1", or "" for a number without limits.
    """
    # An item is a limit, or a `Field` of pydantic that contains limits.
    flat = [part for item in metadata for part in getattr(item, "metadata", [item])]
    limits = [
        f" {sign} {getattr(part, name)}"
        for part in flat
        for name, sign in _LIMITS
        if hasattr(part, name)
    ]
    return " and".join(limits)


def _describe_type(hint, many: bool = False) -> str:
    """Describe the values of a type in words, in the plural for `many`.

    For example "a finite number", "one of laid, shaken", or "a list of 3 finite numbers".
    """
    origin = get_origin(hint)
    args = get_args(hint)
    if origin is Annotated:
        return _describe_type(args[0], many) + _describe_limits(args[1:])
    if origin is Literal:
        if len(args) > 1:
            return f"one of {', '.join(map(str, args))}"
        return repr(args[0])
    if origin in (Union, types.UnionType):
        kinds = [_describe_type(kind, many) for kind in args if kind is not types.NoneType]
        return " or ".join(dict.fromkeys(kinds))
    if origin is tuple:
        name = "lists" if many else "a list"
        items = _describe_type(args[0], many=True)
        if args[-1] is Ellipsis:
            return f"{name} of {items}"
        return f"{name} of {len(args)} {items}"
    table = "tables" if many else "a table"
    if holds_tables(hint):
        return table
    if origin is dict:
        return f"{table} of {_describe_type(args[1], many=True)}"
    if hint in _WORDS:
        return _WORDS[hint][many]
    return "only in Python"


def options(hint) -> tuple[str, ...]:
    """Return the literal words that a field allows, such as "auto"."""
    if get_origin(hint) is Literal:
        return get_args(hint)
    return tuple(option for arg in get_args(hint) for option in options(arg))


def holds_tables(hint) -> bool:
    """Return whether a field's values are tables or contain tables."""
    if isinstance(hint, ForwardRef) or (isinstance(hint, type) and issubclass(hint, BaseModel)):
        return True
    return get_origin(hint) is not Literal and any(holds_tables(a) for a in get_args(hint))
