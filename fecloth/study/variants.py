"""A problem with all combinations of the values of its keys, and which of them it refuses."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import Any, TypeVar

import numpy as np

from fecloth.errors import InputError
from fecloth.study.change import FIRST_LEVEL, Change, Level, describe_values
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.status import REFUSED, failure
from fecloth.study.workload import Workload

SPACINGS: dict[str, Callable] = {"log": np.geomspace, "lin": np.linspace}
FORM = (
    "must be a key and its values, as "
    '"fabric.bending_rigidity=1e-6:1e-4:log:9" or "time.method=bdf2,newmark"'
)
MOST_VALUES = 10_000  # values of a key: more are a slip of the keyboard, and fill the memory
Made = TypeVar("Made")
Over = str | Iterable[str] | Mapping[str, Sequence]


def parse_range(text: str) -> tuple[str, list]:
    """Return the key and its values of a text such as "h=0.1:0.2:lin:3" or "h=0.1,0.2".

    After a:b come "log" or "lin" (equal ratios or equal differences) and the number of values
    from a to b. Raise `InputError` for a text of another form, and for more than `MOST_VALUES`
    values or values that are not finite.
    """
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (key and equals and values):
        raise InputError(f"values {text!r}", FORM)
    if ":" not in values:
        return key, [_value(word.strip()) for word in values.split(",")]
    try:
        start, stop, spacing, count = values.split(":")
        numbers = SPACINGS[spacing.strip()](float(start), float(stop), int(count))
    except (ValueError, KeyError) as error:
        raise InputError(f"values {text!r}", FORM) from error
    if not (1 <= len(numbers) <= MOST_VALUES and np.isfinite(numbers).all()):
        raise InputError(f"values {text!r}", f"must have 1 to {MOST_VALUES} finite values")
    # without the round-off in the last digits
    return key, [float(f"{number:.12g}") for number in numbers]


def read_ranges(over: Over) -> dict[str, list]:
    """Return the list of values of each key, from texts or from a mapping.

    Raise `InputError` for a text of another form than `parse_range` takes, and for no values.
    """
    if isinstance(over, Mapping):
        ranges = {key: _read_values(key, values) for key, values in over.items()}
    elif isinstance(over, str):
        ranges = dict([parse_range(over)])
    else:
        ranges = dict(map(parse_range, over))
    if not ranges or not all(ranges.values()):
        raise InputError(f"values {over!r}", FORM)
    return ranges


def _read_values(key: str, values: object) -> list:
    """Return the values of a key in a mapping; a text is read as after "key="."""
    if isinstance(values, str):
        return parse_range(f"{key}={values}")[1]
    if not isinstance(values, Iterable) or isinstance(values, Mapping):
        raise InputError(f"values of {key} = {values!r}", "must be a list")
    return list(values)


def _value(text: str) -> int | float | str:
    """Return a text as a number, if it is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def combine(ranges: Mapping[str, Sequence]) -> list[dict]:
    """Return all combinations of the values; the last key changes fastest."""
    return [dict(zip(ranges, values, strict=True)) for values in product(*ranges.values())]


def with_first_values(opened: Problem, ranges: Mapping[str, Sequence]) -> Problem:
    """Return the problem to vary; a function gets the first value of each key."""
    if isinstance(opened, SceneProblem):
        return opened
    return opened.changed(Change.of({key: values[0] for key, values in ranges.items()}))


def vary(opened: Problem, values: Mapping[str, object]) -> Problem:
    """Return the problem with a combination of values, without its mesh."""
    if values:
        return opened.changed(Change.of(values))
    return opened


def make_or_refuse(make: Callable[[Any], Made], values: Iterable) -> list[Made | dict]:
    """Return what `make` makes of each value, in the order of the values.

    If `make` raises `InputError`, a row (a dict) with the reason takes its place. If all values
    are refused, raise `InputError`.
    """
    results = list[Made | dict]()
    refusals = list[InputError]()
    for value in values:
        try:
            results.append(make(value))
        except InputError as error:
            refusals.append(error)
            results.append(failure(REFUSED, error))
    if len(refusals) == len(results) == 1:  # of a single value the reason alone is clear
        raise refusals[0]
    if len(refusals) == len(results):
        raise InputError(f"every value: {refusals[0]}")
    return results


def split_refused(made: Mapping[str, Made | dict]) -> tuple[dict[str, Made], dict[str, dict]]:
    """Return two dicts by name: what was made, and the rows (dicts) of what was refused."""
    kept = {}
    refused = {}
    for name, item in made.items():
        if isinstance(item, dict):
            refused[name] = item
        else:
            kept[name] = item
    return kept, refused


def size_of(opened: Problem, variant: Problem) -> Workload:
    """Predict the size of a variant without its mesh.

    For a function it follows from the size of `opened`, which the variant is made of.
    """
    if isinstance(variant, SceneProblem) or isinstance(opened, SceneProblem):
        return variant.workload(FIRST_LEVEL)
    level = Level(h=_divide(opened.h, variant.h), dt=_divide(opened.dt, variant.dt))
    return opened.workload(level)


def _divide(before: float | None, now: float | None) -> float:
    """Return by what a size was divided; 1 where it is not known."""
    if before and now:
        return before / now
    return 1.0


def name_variant(values: Mapping[str, object]) -> str:
    """Return a short name: texts stand for themselves, numbers have their key."""
    return ", ".join(_name_value(key, value) for key, value in values.items())


def _name_value(key: str, value: object) -> str:
    """Return the name of a value of a key, as a part of the name of a variant.

    It is the text itself, "key = number" without the tables of the key, or the type of a table
    with its other values in brackets.
    """
    if isinstance(value, Mapping):
        name = value.get("type", key)
        others = describe_values({k: v for k, v in value.items() if k != "type"})
        return f"{name} ({others})" if others else str(name)
    if isinstance(value, str):
        return value
    return f"{key.rpartition('.')[2]} = {value}"
