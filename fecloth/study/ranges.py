"""The values of a key in a sweep, as KEY=a:b:log:n or KEY=v1,v2,v3."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from fecloth.errors import InputError

SPACINGS: dict[str, Callable] = {"log": np.geomspace, "lin": np.linspace}
FORM = 'write it like "fabric.bending_rigidity=1e-6:1e-4:log:9" or "time.method=bdf2,newmark"'
MOST = 10_000  # values


def parse_range(text: str) -> tuple[str, list]:
    """Return the key and its values: a:b:log:n, a:b:lin:n, or a list with commas.

    Examples
    --------
    >>> parse_range("fabric.tensile_stiffness=10:1000:log:3")
    ('fabric.tensile_stiffness', [10.0, 100.0, 1000.0])
    >>> parse_range("time.method=bdf2, newmark"), parse_range("cloth.h=0.1,0.05")
    (('time.method', ['bdf2', 'newmark']), ('cloth.h', [0.1, 0.05]))
    """
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (key and equals and values):
        raise InputError(f"--over {text!r}", FORM)
    if ":" not in values:
        return key, [_value(one.strip()) for one in values.split(",")]
    try:
        first, last, spacing, count = values.split(":")
        numbers = SPACINGS[spacing.strip()](float(first), float(last), int(count))
    except (ValueError, KeyError) as error:
        raise InputError(f"--over {text!r}", FORM) from error
    if not (len(numbers) and len(numbers) <= MOST and np.isfinite(numbers).all()):
        raise InputError(f"--over {text!r}", f"must have 1 to {MOST} finite values")
    return key, [float(f"{number:.12g}") for number in numbers]


def read_ranges(over: str | Iterable[str] | Mapping[str, Sequence]) -> dict[str, list]:
    """Return the values by key, of texts or of a mapping."""
    if isinstance(over, Mapping):
        found = {key: list(values) for key, values in over.items()}
    else:
        found = dict(parse_range(text) for text in ([over] if isinstance(over, str) else over))
    empty = [key for key, values in found.items() if not values]
    if empty or not found:
        raise InputError(f"over = {over!r}", FORM)
    return found


def _value(text: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
