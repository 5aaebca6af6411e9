"""All combinations of the values of keys, the runs of each, and which of them are refused."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain, islice, product
from typing import TypeVar

import numpy as np

from fecloth.errors import InputError, closest, did_you_mean
from fecloth.simulation.quantity import Quantity
from fecloth.study.runs import Row, Run, Runs, announce, run_quantities
from fecloth.study.scene_source import describe_values
from fecloth.study.status import REFUSED, failure

SPACINGS: dict[str, Callable] = {"log": np.geomspace, "lin": np.linspace}
FORM = (
    "must be a key and its values, as "
    '"fabric.bending_rigidity=1e-6:1e-4:log:9" or "time.method=bdf2,newmark"'
)
MOST_VALUES = 10_000  # values of a key: more are a slip of the keyboard, and fill the memory
Choice = TypeVar("Choice")
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


def plan(
    make: Callable[[Choice], Sequence[Run]], choices: Sequence[Choice]
) -> list[list[Run | Row]]:
    """Return the runs that `make` makes of each choice.

    If `make` raises `InputError`, a row with the reason takes the place of the runs of this
    choice. If all are refused, raise `InputError`.
    """
    planned = list[list[Run | Row]]()
    refusals = list[InputError]()
    for choice in choices:
        try:
            planned.append([*make(choice)])
        except InputError as error:
            refusals.append(error)
            planned.append([failure(REFUSED, error)])
    if len(refusals) == len(planned) == 1:  # of a single choice the reason alone is clear
        raise refusals[0]
    if len(refusals) == len(planned):
        raise InputError(f"every value: {refusals[0]}")
    return planned


def run_planned(
    planned: Sequence[Sequence[Run | Row]], quantities: Sequence[Quantity], how: Runs
) -> list[list[Row]]:
    """Make all runs of a plan in one list, and return the rows of each choice.

    First print their size, and refuse what takes far too long; see `announce`.
    """
    runs = list(chain.from_iterable(planned))
    announce(runs, how)
    rows = iter(run_quantities(runs, quantities, how))
    return [list(islice(rows, len(of_choice))) for of_choice in planned]


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
    rest, _, last = key.rpartition(".")
    if last.isdigit():  # of a pair
        last = f"{rest.rpartition('.')[2]}.{last}"
    return f"{last} = {value}"


def known_names(
    what: str, names: Sequence[str], known: Iterable[str], allowed: str = "", where: str = ""
) -> list[str]:
    """Return the names as the scene writes them, each once.

    Capitals and underscores do not count, so that "BDF2" is "bdf2". Raises `InputError` for an
    unknown name.

    Parameters
    ----------
    what
        What the names are of, for the error: "method", "element" or "model".
    names
        Names as the user wrote them.
    known
        Names as the scene writes them.
    allowed, where
        What the error says is allowed, and where the name stands.
    """
    names_of_scene: dict[str, None] = {}  # a dict keeps the order, and each name once
    for name in names:
        nearest = closest(name, known)
        if not nearest or _plain(nearest) != _plain(name):
            allowed = allowed or f"must be one of {', '.join(known)}"
            raise InputError(f"{what} {name!r}", allowed, where, did_you_mean(name, known))
        names_of_scene[nearest] = None
    return list(names_of_scene)


def _plain(name: str) -> str:
    """Return a name without capitals and underscores."""
    return str(name).lower().replace("_", "")
