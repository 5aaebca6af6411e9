"""Scene files as text: TOML in, overrides of single values, TOML out."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

from fecloth.errors import SceneError
from fecloth.quantities.units import is_quantity
from fecloth.suggest import closest

LARGEST = 1_000_000  # bytes; beyond it the file is some other kind of file
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_WORD = re.compile(r"[A-Za-z_][\w./-]*")
_NAMED = (  # where a name may stand in place of a table, and the key of that table which it is
    (re.compile(r"fabric|fabrics\.[^.]+"), "preset"),
    (re.compile(r"time\.method"), "type"),
)


def read(path: str | Path) -> dict:
    """The tables of a TOML file.

    Raises
    ------
    SceneError
        For a path that is no readable file, and for text that is not TOML, with its line.
    """
    path = Path(path)
    text = _text(path)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError, and integers without end
        raise SceneError(f"not TOML ({error})", where=str(path)) from None


def _text(path: Path) -> str:
    where = str(path)
    if problem := file_problem(path):
        raise SceneError(problem[0], "must be a scene file", where, problem[1])
    try:
        data = path.read_bytes() if path.stat().st_size <= LARGEST else None
    except OSError as error:
        raise SceneError(f"cannot be read ({error.strerror})", where=where) from None
    if data is None:
        allowed = f"a scene is a text of at most {LARGEST}"
        raise SceneError(f"has {path.stat().st_size} bytes", allowed, where)
    try:
        return data.decode("utf-8-sig")  # editors on Windows put a mark before the text
    except UnicodeDecodeError as error:
        what = f"is not UTF-8 text (byte {error.start})"
        raise SceneError(what, "must be a scene in TOML", where) from None


def file_problem(path: Path) -> tuple[str, str] | None:
    """Why a path is no regular file, and a remedy, the closest name in its folder; else None."""
    try:
        if path.is_file():
            return None
        if path.exists():
            return ("is a folder" if path.is_dir() else "is not a regular file"), ""
        if not path.parent.is_dir():
            return "no such file", f"There is no folder {path.parent}."
        return "no such file", _similar(path) or f"Look into {path.parent.resolve()}."
    except OSError as error:  # a name too long, a folder without access
        return f"cannot be opened ({error.strerror})", ""


def _similar(path: Path) -> str:
    """A remedy that names the closest file of that kind in the path's folder; empty if none is."""
    there = sorted(path.parent.iterdir())
    kind = (path.suffix, closest(path.suffix, sorted({one.suffix for one in there})))
    stems = {one.stem: one.name for one in there if not path.suffix or one.suffix in kind}
    close = closest(path.stem, stems)
    return f"Did you mean {stems[close]!r}?" if close else ""


def overridden(data: dict, overrides: Iterable[str]) -> dict:
    """A copy of the tables with values replaced, as by ``["time.dt=0.005", "terms.0.time=0.02"]``.

    Keys are TOML's dotted keys, with numbers (from 0) for the items of lists. Values are TOML; a
    plain word that is none, such as ``time.method=backward_euler``, is taken as a string, and so is
    a number with a unit, such as ``time.dt=5 ms``. Where a name stands for a table, as in
    ``fabric = "silk"``, a key of that table leaves the rest to the name.

    Raises
    ------
    SceneError
        For an override that cannot be read, or whose key leads through no table.

    Examples
    --------
    >>> overridden({"time": {"dt": 0.1}, "terms": [{"k": 1}]}, ["time.dt=0.2", "terms.0.k=3"])
    {'time': {'dt': 0.2}, 'terms': [{'k': 3}]}
    >>> overridden({"fabric": "silk"}, ["fabric.areal_density=0.2"])
    {'fabric': {'preset': 'silk', 'areal_density': 0.2}}
    """
    data = _copied(data)
    for text in overrides:
        keys, value = _override(text)
        _set(data, keys, value, text)
    return data


def _copied(value):
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    return [_copied(item) for item in value] if isinstance(value, list) else value


def _override(text: str) -> tuple[list[str], object]:
    key, equals, value = text.partition("=")
    value = value.strip()
    where = f"override {text!r}"
    if not (equals and key.strip() and value):
        raise SceneError("no key=value", 'write it like "time.dt=0.005"', where)
    try:
        chain = tomllib.loads(f"{key} = 0")
        keys = _keys(chain)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"key {key!r} is not a dotted key ({error})", where=where) from None
    try:
        (value,) = tomllib.loads(f"value = {value}").values()
    except (ValueError, RecursionError) as error:
        if not (_WORD.fullmatch(value) or is_quantity(value)):
            raise SceneError(f"value {value!r} is not TOML ({error})", where=where) from None
    return keys, value


def _keys(chain) -> list[str]:
    """["a", "b"] of {"a": {"b": 0}}."""
    if chain == 0:
        return []
    ((key, rest),) = chain.items()
    return [key, *_keys(rest)]


def _set(data: dict, keys: list[str], value, text: str) -> None:
    place, where = data, f"override {text!r}"
    for depth, key in enumerate(keys):
        if isinstance(place, list):
            if not (re.fullmatch("[0-9]{1,9}", key) and int(key) < len(place)):
                what, last = f"item {key!r} of {'.'.join(keys[:depth])}", len(place) - 1
                raise SceneError(what, f"must be 0 to {last}" if place else "is empty", where)
            key = int(key)
        elif not isinstance(place, dict):
            raise SceneError(f"{'.'.join(keys[:depth])} = {place!r}", "is no table", where)
        if depth == len(keys) - 1:
            place[key] = value
        else:
            inner = place[key] if isinstance(key, int) else place.setdefault(key, {})
            place[key] = place = _table(inner, ".".join(keys[: depth + 1]))


def _table(value, key: str):
    """The value, or the table that it stands for if it is a name."""
    for keys, name in _NAMED if isinstance(value, str) else ():
        if keys.fullmatch(key):
            return {name: value}
    return value


def written(data: dict) -> str:
    """TOML text of nested dicts, lists, strings and numbers; None and empty ones are left out.

    Examples
    --------
    >>> print(written({"mass": "lumped", "time": {"dt": 0.01}, "terms": [{"type": "StVK"}]}))
    mass = "lumped"
    <BLANKLINE>
    [time]
    dt = 0.01
    <BLANKLINE>
    [[terms]]
    type = "StVK"
    <BLANKLINE>
    """
    tables, lines = [], []
    for key, value in data.items():
        items = value if isinstance(value, (list, tuple)) else [value]
        if _left_out(value):
            continue
        if not all(isinstance(item, dict) for item in items):
            lines.append(f"{_key(key)} = {_value(value)}")
            continue
        head = f"[{_key(key)}]" if isinstance(value, dict) else f"[[{_key(key)}]]"
        tables += ["\n".join([head, *_entries(item)]) for item in items]
    return "\n\n".join([*(["\n".join(lines)] if lines else []), *tables]) + "\n"


def _left_out(value) -> bool:
    return value is None or (isinstance(value, (dict, list, tuple)) and not value)


def _entries(table: dict) -> list[str]:
    return [f"{_key(k)} = {_value(v)}" for k, v in table.items() if not _left_out(v)]


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _value(key)


def _value(value) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case dict():
            return f"{{ {', '.join(_entries(value))} }}"
        case list() | tuple():
            return f"[{', '.join(_value(item) for item in value)}]"
    return repr(value)
