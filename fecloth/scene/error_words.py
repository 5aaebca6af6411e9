"""Messages for mistakes in a scene, with the key of each mistake.

The mistakes are errors of pydantic, and errors that objects raise when they are made.
"""

import re
import reprlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from pydantic import ValidationError

from fecloth.errors import InputError, MeshError, SceneError, did_you_mean

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth")
_ITEM = re.compile(r"(terms|pins|seams|probes)\.(\d+)")
MESH_FILE = 'A mesh file is given by shape = "file" and path = "sheet.msh".'
OTHER_NAMES = {
    "circle": "disk",
    "round": "disk",
    "square": "rectangle",
    "sheet": "rectangle",
    "mesh": "file",
    "ball": "Sphere",
    "cube": "Box",
    "floor": "Plane",
}
"""What else a kind of table is called; the names of kinds that are alike need no entry."""
_KEY = re.compile(r"[^\W\d]\w*(\.\w+)*")


class Mistake(NamedTuple):
    """The words of a `SceneError`: the key with its value, what is allowed, what to do."""

    what: str
    allowed: str
    remedy: str = ""


def scene_error(error: ValidationError, data: Any, where: str, text: str = "") -> SceneError:
    """Return the error for the first mistake in the tables `data` of a scene.

    Its `also` has the errors for the other mistakes. `where` is the file of the scene, and
    `text` its text, in which the line of the mistake is looked for.
    """
    mistakes: list[Mistake] = []
    for item in error.errors(include_url=False):
        key, written = _locate(item["loc"], data)
        mistakes += _describe(item, key, written)
    first, *others = (
        SceneError(what, allowed, where, f"{remedy} {place(what, data, text)}".strip())
        for what, allowed, remedy in dict.fromkeys(mistakes)  # each once, in order
    )
    first.also = tuple(others)
    return first


def place(key: str, data: Any, text: str = "") -> str:
    """Return in words which of the terms, pins or probes a key is in.

    For example "(It is the second [[terms]], StVK, line 14.)", or "" for a key that is in none.
    The line is left out where `text` does not show all tables of the list.
    """
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
    # Only if the file has a header for each table does the nth header belong to the nth table:
    # the list may also be written in one line, or come from an override.
    if len(headers) == len(tables) > 0:
        words.append(f"line {headers[number]}")
    ordinal = ORDINALS[number] if number < len(ORDINALS) else f"{number + 1}th"
    return f"(It is {', '.join([f'the {ordinal} [[{name}]]', *words])}.)"


def _describe(item, key: str, written: Any) -> list[Mistake]:
    """Describe the mistakes in an error `item` of pydantic; `written` is the value at `key`."""
    value = item["input"]
    cause = item.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        errors = (cause, *cause.also)
        return [
            Mistake(with_key(key, error, value), error.allowed, error.remedy) for error in errors
        ]
    return [_describe_wrong_type(item, key, written, value)]


def _describe_wrong_type(item, key: str, written: Any, value: Any) -> Mistake:
    """Describe a value that is no table, no list of tables, or no table of a known kind.

    `written` is what the scene has at `key`, and `value` what pydantic read there. All other
    types are checked by `Table`, whose errors are of type `InputError`.
    """
    if item["type"] == "kind":
        name, kinds = item["msg"].split(": ")
        return _describe_wrong_kind(key, written, name, kinds)
    what = f"{key} = {shorten(value)}"
    if "tuple" in item["type"] and "." not in key:
        return Mistake(what, "must be a list of tables", f"Write [[{key}]] above each of them.")
    return Mistake(what, "must be a table")


def _describe_wrong_kind(key: str, value: Any, name: str, kinds: str) -> Mistake:
    """Describe a `value` at `key` that is no table of one of the `kinds`, a text with commas.

    The kind of such a table is the text at its key `name`, "type" or "shape".
    """
    known_kinds = kinds.split(", ")
    what = f"{key} = {shorten(value)}"
    allowed = f"must be one of {kinds}"
    # The kind is right, but it is written without its table: terms.0.shape = "Sphere".
    if value in known_kinds:
        remedy = f'Write {{ {name} = "{value}" }}.'
        return Mistake(what, f"must be a table with the key {name}", remedy)
    # This may be a key where a name can replace the table, such as time.method = "BDF3".
    if isinstance(value, str):
        return Mistake(what, allowed, _meant(value, known_kinds))
    if not isinstance(value, dict):
        return Mistake(what, f"must be a table whose {name} is one of {kinds}")
    if name not in value:
        # Only [cloth] has a shape as its kind: many look for a key such as file = "a.msh".
        remedy = MESH_FILE if name == "shape" else ""
        return Mistake(f"{key}.{name} is missing", allowed, remedy)
    own_kind = value[name]
    remedy = _meant(own_kind, known_kinds)
    is_name = isinstance(own_kind, str) and own_kind.isidentifier()
    # It may be the user's own class of a term, which only Python can add.
    if is_name and key.startswith("terms") and not key.endswith(".shape"):
        call = f'fc.load_scene("….toml", terms={{"{own_kind}": {own_kind}}})'
        remedy = f"{remedy} For a term of your own: {call}.".strip()
    return Mistake(f"{key}.{name} = {shorten(own_kind)}", allowed, remedy)


def _meant(name: Any, kinds: list[str]) -> str:
    """Return the remedy "Did you mean ...?" with one of the kinds of a table, or ""."""
    other = OTHER_NAMES.get(str(name).lower())
    if other in kinds:
        return f"Did you mean {other!r}?"
    return did_you_mean(name, kinds)


def with_key(key: str, error: InputError, value: Any = None) -> str:
    """Return the `what` of an `InputError` about the table or value at `key`, with that key.

    If the `what` begins with a key of the table, as in "dt = 5", the two keys become one,
    "time.dt = 5". An empty `what` means the `value` itself.
    """
    words = error.what.split(" ", 2)
    if not error.what:
        return f"{key} = {shorten(value)}"
    if len(words) > 1 and words[1] in ("=", "is") and _KEY.fullmatch(words[0]):
        return f"{key}.{error.what}".removeprefix(".")
    return f"{key}: {error.what}".removeprefix(": ")


@contextmanager
def errors_at(key: str, where: str, data: Any = None, text: str = "") -> Iterator[None]:
    """Turn an `InputError` raised within this context into a `SceneError`.

    Its words begin with the `key`, and its place is the file of the scene, `where`. A
    `SceneError` has them already and passes. With `data`, the tables of the scene, and `text`,
    the text of its file, the error also has the type and the line of the table.
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
    """Return the dotted key of a mistake, and the value that `data` has there.

    The `location` by pydantic also has entries that are no keys: the kind of a table, and steps
    within a type. They are left out.
    """
    keys = []
    for entry in location:
        if isinstance(data, dict):
            # The kind "file" of a cloth may be a key, too, that was tried by mistake.
            is_inside = entry in data and data.get("shape") != entry
        elif isinstance(data, (list, tuple)):
            is_inside = isinstance(entry, int) and entry < len(data)
        else:
            is_inside = False
        if is_inside:
            data = data[entry]
            keys.append(str(entry))
    return ".".join(keys), data
