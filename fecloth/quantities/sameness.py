"""Whether two values are the same to the last bit, so that one may stand for the other."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

PLAIN = (bool, int, float, complex, str, bytes, np.generic, Enum, type(None))


def same(a: Any, b: Any) -> bool:
    """Return whether two values are certainly the same, to the last bit.

    Numbers, texts, arrays, and the lists, tuples, mappings and dataclasses that consist of them
    are compared. Any other values, such as functions, are the same only if they are one object.

    Examples
    --------
    >>> same({"a": (1.0, [2])}, {"a": (1.0, [2])}), same(0.0, -0.0), same(1, 1.0)
    (True, False, False)
    """
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, PLAIN):
        return repr(a) == repr(b)  # unlike ==, it tells 0.0 from −0.0
    if isinstance(a, np.ndarray):
        are_numbers = a.dtype == b.dtype and a.dtype.kind != "O"
        return bool(are_numbers and a.shape == b.shape and a.tobytes() == b.tobytes())
    if isinstance(a, Mapping):
        return same(list(a), list(b)) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if is_dataclass(a):
        names = [field.name for field in fields(a)]
        return all(same(getattr(a, name), getattr(b, name)) for name in names)
    return False
