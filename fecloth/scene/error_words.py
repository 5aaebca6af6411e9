"""Messages for mistakes in a scene, with the key of each mistake.

The mistakes are errors of pydantic, and errors that objects raise when they are made.
"""

import re
import reprlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pydantic import ValidationError

from fecloth.errors import InputError, MeshError, SceneError, did_you_mean

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")
_ITEM = re.compile(r"(terms|pins|probes)\.(\d+)")
MESH_FILE = 'A mesh file is given by shape = "file" and path = "sheet.msh".'
_KEY = re.compile(r"[^\W\d]\w*(\.\w+)*")


def scene_error(error: ValidationError, data: Any, where: str, text: str = "") -> SceneError:
    """Return the first mistake in the tables `data` of a scene; its `also` has the others.

    `where` is the file of the scene, and `text` its text, for the number of the line.
    """
    mistakes: list[tuple[str, str, str]] = []
    for item in error.errors(include_url=False):
        key, written = _locate(item["loc"], data)
        mistakes += _describe(item, key, written)
    first, *others = (
        SceneError(what, allowed, where, f"{remedy} {place(what, data, text)}".strip())
        for what, allowed, remedy in dict.fromkeys(mistakes)
    )
    first.also = tuple(others)
    return first


def place(key: str, data: Any, text: str = "") -> str:
    """Return which table of a list a key is in, in words, or ""."""
    if not (match := _ITEM.match(key)):
        return ""
    name = match[1]
    number = int(match[2])
    tables = data.get(name, ()) if isinstance(data, dict) else ()
    table = tables[number] if number < len(tables) else None
    if isinstance(table, dict) and "type" in table:
        words = [str(table.get("type", ""))]
    else:
        words = []
    lines = (line.split("#")[0].replace(" ", "").strip() for line in text.splitlines())
    headers = [i for i, line in enumerate(lines, 1) if line == f"[[{name}]]"]
    if len(headers) == len(tables) > 0:  # all are written so, and none comes from an override
        words.append(f"line {headers[number]}")
    ordinal = ORDINALS[number] if number < len(ORDINALS) else f"{number + 1}th"
    return f"(It is {', '.join([f'the {ordinal} [[{name}]]', *words])}.)"


def _describe(item, key: str, written: Any) -> list[tuple[str, str, str]]:
    """Return (what, allowed, remedy) of each mistake; `written` is the value at `key`."""
    value = item["input"]
    cause = item.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        errors = (cause, *cause.also)
        return [(with_key(key, error, value), error.allowed, error.remedy) for error in errors]
    return [_describe_wrong_type(item, key, written, value)]


def _describe_wrong_type(item, key: str, written: Any, value: Any) -> tuple[str, str, str]:
    if item["type"] == "kind":
        name, kinds = item["msg"].split(": ")
        return _describe_wrong_kind(key, written, name, kinds)
    what = f"{key} = {shorten(value)}"
    if "tuple" in item["type"] and "." not in key:
        return what, "must be a list of tables", f"Write [[{key}]] above each of them."
    return what, "must be a table", ""


def _describe_wrong_kind(key: str, value: Any, name: str, kinds: str) -> tuple[str, str, str]:
    """Describe a table whose key `name` is none of the `kinds`, a text with commas."""
    allowed = f"must be one of {kinds}"
    if value in kinds.split(", "):  # where no name may replace a table
        remedy = f'Write {{ {name} = "{value}" }}.'
        return f"{key} = {shorten(value)}", f"must be a table with the key {name}", remedy
    if isinstance(value, str):  # a name may replace a table
        return f"{key} = {shorten(value)}", allowed, did_you_mean(value, kinds.split(", "))
    if not isinstance(value, dict):
        return f"{key} = {shorten(value)}", f"must be a table whose {name} is one of {kinds}", ""
    if name not in value:
        remedy = MESH_FILE if name == "shape" else ""
        return f"{key}.{name} is missing", allowed, remedy
    own = value[name]
    remedy = did_you_mean(own, kinds.split(", "))
    is_name = isinstance(own, str) and own.isidentifier()
    if is_name and key.startswith("terms") and not key.endswith(".shape"):
        how = f'For a term of your own: fc.load_scene("….toml", terms={{"{own}": {own}}}).'
        remedy = f"{remedy} {how}".strip()
    return f"{key}.{name} = {shorten(own)}", allowed, remedy


def with_key(key: str, error: InputError, value: Any = None) -> str:
    """Return the `what` of an `InputError` about the table or value at `key`, with that key."""
    first = error.what.split(" ", 2)
    if not error.what:
        return f"{key} = {shorten(value)}"
    if len(first) > 1 and first[1] in ("=", "is") and _KEY.fullmatch(first[0]):
        return f"{key}.{error.what}".removeprefix(".")
    return f"{key}: {error.what}".removeprefix(": ")


@contextmanager
def errors_at(key: str, where: str, data: Any = None, text: str = "") -> Iterator[None]:
    """Turn an `InputError` of an object into a `SceneError` with the scene's file and key.

    With `data`, the tables of the scene, and `text`, the text of its file, the error also has
    the type and the line of the table.
    """
    try:
        yield
    except SceneError:
        raise
    except InputError as error:
        what = with_key(key, error)
        if isinstance(error, MeshError) and key == "cloth":  # its `where` is the mesh file
            what = f"{key}: {error.where}: {error.what}"
        remedy = f"{error.remedy} {place(key, data, text)}".strip()
        raise SceneError(what, error.allowed, where, remedy) from error


def shorten(value: Any) -> str:
    """Return the value as text of limited length, tuples as lists."""
    return reprlib.repr(list(value) if isinstance(value, tuple) else value)


def _locate(location: tuple, data: Any) -> tuple[str, Any]:
    """Return the key of an error, without pydantic's entries for kinds, and the value there."""
    keys = []
    for entry in location:
        if isinstance(data, dict):
            is_inside = entry in data and data.get("shape") != entry
        elif isinstance(data, (list, tuple)):
            is_inside = isinstance(entry, int) and entry < len(data)
        else:
            is_inside = False
        if is_inside:
            data = data[entry]
            keys.append(str(entry))
    return ".".join(keys), data
