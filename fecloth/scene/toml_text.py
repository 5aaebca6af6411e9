"""The tables of a scene: read from a file, written as TOML, with values replaced."""

import copy
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import tomli_w

from fecloth.errors import InputError, SceneError
from fecloth.quantities import toml_file
from fecloth.quantities.units import is_quantity


def read(path: str | Path) -> dict:
    """Return the tables of the file of a scene; raise `SceneError` if it cannot be read."""
    try:
        return toml_file.read(path, "a scene file")
    except InputError as error:
        raise SceneError(error.what, error.allowed, error.where, error.remedy) from None


def to_toml(data: dict) -> str:
    """Return nested dicts, lists, strings and numbers as TOML, without None and empty ones."""
    return tomli_w.dumps(without_empty(data))


def without_empty(value):
    """Return the value without None, and without empty values of tables; with lists for tuples."""
    if isinstance(value, dict):
        return {key: without_empty(item) for key, item in value.items() if not _is_empty(item)}
    if isinstance(value, list | tuple):
        return [without_empty(item) for item in value if item is not None]
    return value


def _is_empty(value) -> bool:
    return value is None or (isinstance(value, dict | list | tuple) and not value)


# --- single values replaced ---------------------------------------------------------------


_WORD = re.compile(r"[A-Za-z_][\w./-]*")
_NAMED = (  # where a name may replace a table, and the key of the table for that name
    (re.compile(r"fabric|fabrics\.[^.]+"), "preset"),
    (re.compile(r"time\.method"), "type"),
)


def override(data: dict, overrides: Iterable[str]) -> dict:
    """Return the tables with values replaced, as by ``["time.dt=0.005", "terms.0.time=0.02"]``.

    Keys are TOML's dotted keys, with numbers (from 0) for the items of lists. Values are TOML; a
    plain word, such as ``time.method=backward_euler``, and a number with a unit, such as
    ``time.dt=5 ms``, are read as strings. If a name replaces a table, as in ``fabric = "silk"``,
    an override of one key leaves the other keys to the name.
    """
    data = copy.deepcopy(data)
    for text in overrides:
        keys, value = _parse_override(text)
        _set_value(data, keys, value, text)
    return data


def with_values(data: dict, values: Mapping[str, Any]) -> dict:
    """Return the tables with other values, by dotted keys as for `override`.

    A text is read as after ``key=``, so that "5 ms" is a time and "true" is no text. Any other
    value is taken as it is. None marks what `without_empty` removes: a key, or an item of a list.
    The values are set in their order.
    """
    data = copy.deepcopy(data)
    for key, value in values.items():
        if isinstance(value, str):
            keys, value = _parse_override(f"{key}={value}")
        else:
            keys = _parse_key(key, f"override {key!r}")
        _set_value(data, keys, value, f"{key}={value}")
    return data


def flatten(data: object, key: str = "") -> dict[str, Any]:
    """Return the values of tables and lists by dotted keys: {"terms.0.type": "StVK", …}.

    `key` is the dotted key of `data` itself, "" for a whole scene. Empty tables and lists have
    no value.
    """
    if not isinstance(data, Mapping | list | tuple):
        return {key: data}
    items: Iterable[tuple] = data.items() if isinstance(data, Mapping) else enumerate(data)
    prefix = f"{key}." if key else ""
    flat: dict[str, Any] = {}
    for name, value in items:
        flat |= flatten(value, f"{prefix}{name}")
    return flat


def flatten_tables(tables: Mapping[str, Any], key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables by dotted keys; a list is a value.

    So ``tip.x = [1, 0.1]``, which TOML reads as a table in a table, has the key "tip.x".
    """
    for name, value in tables.items():
        full_key = f"{key}.{name}" if key else str(name)
        if isinstance(value, Mapping):
            yield from flatten_tables(value, full_key)
        else:
            yield full_key, value


def _parse_override(text: str) -> tuple[list[str], object]:
    """Return the keys, ["a", "b"], and the value, 1, of an override, "a.b=1".

    Raise `SceneError` for a text that is no override. A value that is not TOML stays a text if
    it is a plain word or a number with a unit.
    """
    key, equals, value = text.partition("=")
    value = value.strip()
    where = f"override {text!r}"
    if not (equals and key.strip() and value):
        raise SceneError("no key=value", 'write it like "time.dt=0.005"', where)
    keys = _parse_key(key, where)
    try:
        (value,) = toml_file.parse(f"value = {value}").values()
    except ValueError as error:
        if not (_WORD.fullmatch(value) or is_quantity(value)):
            raise SceneError(f"value {value!r} is not TOML ({error})", where=where) from None
    return keys, value


def _parse_key(key: str, where: str) -> list[str]:
    """Return the parts of a dotted key, by TOML's own rules; else raise `SceneError`."""
    try:
        return _keys(toml_file.parse(f"{key} = 0"))
    except ValueError as error:
        raise SceneError(f"key {key!r} is not a dotted key ({error})", where=where) from None


def _keys(chain) -> list[str]:
    """Return the keys of nested tables, each with one key: ["a", "b"] of {"a": {"b": 0}}."""
    if chain == 0:
        return []
    ((key, rest),) = chain.items()
    return [key, *_keys(rest)]


def _set_value(data: dict, keys: list[str], value, text: str) -> None:
    """Change `data`, tables and lists, so that the dotted key `keys` has the value.

    Missing tables are made, and a name on the way becomes the table that it replaces. Raise
    `SceneError`, which names the override by its `text`, for an item that a list does not have,
    and for a key within a plain value.
    """
    place = data
    where = f"override {text!r}"
    for depth, key in enumerate(keys):
        if isinstance(place, list):
            if not (re.fullmatch("[0-9]{1,9}", key) and int(key) < len(place)):
                what = f"item {key!r} of {'.'.join(keys[:depth])}"
                allowed = f"must be 0 to {len(place) - 1}" if place else "is empty"
                raise SceneError(what, allowed, where)
            key = int(key)
        elif not isinstance(place, dict):
            raise SceneError(f"{'.'.join(keys[:depth])} = {place!r}", "is no table", where)
        if depth == len(keys) - 1:
            place[key] = value
            continue
        if isinstance(key, int):
            inner = place[key]
        else:
            inner = place.setdefault(key, {})
        place[key] = _table_for_name(inner, ".".join(keys[: depth + 1]))
        place = place[key]


def _table_for_name(value, key: str):
    """Return the value, or the table that a name replaces."""
    if isinstance(value, str):
        for keys, name in _NAMED:
            if keys.fullmatch(key):
                return {name: value}
    return value
