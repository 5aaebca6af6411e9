"""The records that restart files can hold, marked where they are defined."""

from typing import TypeVar

from fecloth.errors import InputError

C = TypeVar("C", bound=type)

RECORDS: dict[str, type] = {}  # by the name of the class, as restart files have it


def remembered(cls: C) -> C:
    """Mark a frozen dataclass as one that restart files can hold, and return it.

    Its fields may be numbers, texts, None, finite arrays of float64, mappings, tuples and marked
    records. The memory of an integrator, whose arrays are (n, 3), and the record of a term that
    keeps a history need this mark; without it, a run with restart files is refused.
    """
    name = cls.__name__
    parameters = getattr(cls, "__dataclass_params__", None)
    if parameters is None or not parameters.frozen:
        raise InputError(f"class {name}", "must be a frozen dataclass", "remembered")
    known = RECORDS.get(name, cls)
    if (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
        remedy = f"{known.__module__} has a class of this name: give yours another."
        raise InputError(f"class {name}", "must have a name of its own", "remembered", remedy)
    RECORDS[name] = cls
    return cls
