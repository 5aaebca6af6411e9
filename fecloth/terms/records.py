"""The records that restart files can hold, and their slopes."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from fecloth.errors import InputError

C = TypeVar("C", bound=type)

RECORDS: dict[str, type] = {}  # by the name of the class, as restart files have it


def remembered(cls: C) -> C:
    """Mark a frozen dataclass as a record that restart files can hold, and return it.

    Its fields may be numbers, texts, None, finite arrays of float64, mappings, tuples and marked
    records. The memory of an integrator, whose arrays are (n, 3), and the record of a term need
    this mark; without it, a run with restart files is refused.

    Raises `InputError` for a class that is no frozen dataclass, and for a name that another
    marked class has.
    """
    name = cls.__name__
    parameters = getattr(cls, "__dataclass_params__", None)
    if parameters is None or not parameters.frozen:
        raise InputError(f"class {name}", "must be a frozen dataclass", "remembered")
    # A module that is imported again marks its classes again: the same names are no conflict.
    marked_before = RECORDS.get(name, cls)
    before = (marked_before.__module__, marked_before.__qualname__)
    if before != (cls.__module__, cls.__qualname__):
        remedy = f"{marked_before.__module__} has a class of this name: give yours another."
        raise InputError(f"class {name}", "must have a name of its own", "remembered", remedy)
    RECORDS[name] = cls
    return cls


def slope(plus: Any, minus: Any, width: float) -> Any:
    """Return the difference quotient (plus − minus)/width of two records of the same class.

    `plus` and `minus` are records, mappings, tuples, or values in them. The slope of a record or
    a mapping is a dict, with the slopes of its parts by their names; of a tuple it is a tuple.
    Only numbers and arrays of type float have a slope. All other values have None, and so has a
    record without parts.

    Raises
    ------
    ValueError
        For arrays of different shapes, and for tuples or mappings of different lengths or keys.

    Examples
    --------
    >>> slope((1.5, "a"), (1.0, "a"), 0.25)
    (2.0, None)
    """
    if isinstance(plus, float | np.floating | np.ndarray):
        array = np.asarray(plus)
        if array.dtype.kind != "f" or minus is None:  # whole numbers, such as counts
            return None
        if array.shape != np.shape(minus):
            raise ValueError(f"arrays of shapes {array.shape} and {np.shape(minus)}")
        return (plus - minus) / width
    if isinstance(plus, tuple):
        if all(isinstance(part, str) for part in (*plus, *minus)):  # texts may differ in number
            return None
        return tuple(slope(p, m, width) for p, m in zip(plus, minus, strict=True))
    names = _names(plus)
    if names != _names(minus):
        raise ValueError(f"different contents: {names} and {_names(minus)}")
    return {name: slope(_part(plus, name), _part(minus, name), width) for name in names} or None


def shift(record: Any, slopes: Any, size: float) -> Any:
    """Return a copy of the record with its numbers increased by size × slopes.

    `slopes` come from `slope`. Values without a slope (None) stay as they are.
    """
    if slopes is None or record is None:
        return record
    if isinstance(record, tuple):
        return tuple(shift(part, s, size) for part, s in zip(record, slopes, strict=True))
    if isinstance(slopes, Mapping):
        parts = {name: shift(_part(record, name), s, size) for name, s in slopes.items()}
        if isinstance(record, Mapping):
            return {**record, **parts}
        return replace(record, **parts)
    return record + size * slopes


def _names(record: Any) -> list[str]:
    """The names of the parts of a mapping or a dataclass; none of any other value."""
    if isinstance(record, Mapping):
        return list(record)
    if is_dataclass(record):
        return [field.name for field in fields(record)]
    return []


def _part(record: Any, name: str) -> Any:
    """The part of a mapping or a dataclass with a name."""
    if isinstance(record, Mapping):
        return record[name]
    return getattr(record, name)
