"""What a table of a scene may hold: pydantic models whose every mistake becomes a `SceneError`.

A number may be text with a unit where the type of its key names what it measures, as in
``Annotated[float, LENGTH]``; see `units`. A table holds it in SI.
"""

from __future__ import annotations

import dataclasses
import re
import reprlib
import typing
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, ClassVar, ForwardRef, Literal, Union

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Tag,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)

from fecloth.errors import InputError, MeshError, SceneError
from fecloth.scene.type_words import holds_tables, in_si, options, phrase, writable
from fecloth.suggest import did_you_mean

_KEY = re.compile(r"[^\W\d]\w*(\.\w+)*")


class Table(BaseModel):
    """A table whose keys are the fields: an unknown or missing one is refused with its remedy."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
    )

    shorthands: ClassVar[tuple[str, ...]] = ()  # keys that stand for others, resolved before

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        fields = cls.model_fields
        if refusals := _unknown(data, fields, cls.shorthands) or _missing(data, fields):
            refusals[0].also = tuple(refusals[1:])
            raise refusals[0]
        return in_si(data, fields)

    @field_validator("*", mode="wrap")
    @classmethod
    def _worded(cls, value: Any, handler, info) -> Any:
        field = cls.model_fields[info.field_name]
        try:
            return handler(value)
        except ValidationError as error:
            ours = any(e["type"] == "value_error" for e in error.errors())
            if ours or holds_tables(field.annotation):
                raise
            words = options(field.annotation)
            remedy = did_you_mean(value, words) if isinstance(value, str) else ""
            raise InputError("", f"must be {phrase(field)}", "", remedy) from None


def _unknown(data: dict, fields: Mapping, shorthands: tuple[str, ...]) -> list[InputError]:
    known = (*fields, *shorthands)
    allowed = f"unknown key; the keys are {', '.join(known)}"
    return [
        InputError(f"{key} = {_short(value)}", allowed, "", did_you_mean(key, known))
        for key, value in data.items()
        if key not in fields
    ]


def _missing(data: dict, fields: Mapping) -> list[InputError]:
    return [
        InputError(f"{key} is missing", f"must be {phrase(field)}")
        for key, field in fields.items()
        if field.is_required() and key not in data
    ]


class Made(Table):
    """A table that stands for an object of the class `makes`, built when the table is read."""

    makes: ClassVar[type]

    @model_validator(mode="after")
    def _makeable(self):
        self.make()
        return self

    def make(self):
        """The object; its own refusals are part of the validation."""
        names = [field.name for field in dataclasses.fields(self.makes) if field.init]
        values = {name: getattr(self, name) for name in names}
        return self.makes(**{k: v.make() if isinstance(v, Made) else v for k, v in values.items()})


def table_of(cls: type, name: str = "", **more) -> type[Made]:
    """The table of a dataclass: its fields are the keys; with a name, `type` is that name.

    A field annotated ``object`` holds another term, as the law of a damping does. A field that
    also takes a function takes all but that.
    """
    hints = typing.get_type_hints(cls, include_extras=True)
    fields: dict[str, Any] = {"type": (Literal[name], ...)} if name else {}
    for field in dataclasses.fields(cls):
        if not field.init:
            continue
        hint = writable(hints[field.name])
        hint = Union[ForwardRef("Term"), None] if hint is object else hint  # noqa: UP007
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        fields[field.name] = (hint, ... if default is dataclasses.MISSING else default)
    model = create_model(f"{cls.__name__}Table", __base__=Made, **(fields | more))
    model.makes = cls
    return model


def one_of(key: str, tables: Mapping[str, type[Table]]) -> Any:
    """A table of one of several kinds, told apart by the string under `key`."""

    def tag(data):
        value = data.get(key) if isinstance(data, dict) else getattr(data, key, None)
        return value if isinstance(value, str) else None

    tagged = tuple(Annotated[table, Tag(name)] for name, table in tables.items())
    discriminator = Discriminator(
        tag,
        custom_error_type="kind",
        custom_error_message=f"{key}: {', '.join(tables)}",  # read again by `_kind`
    )
    return Annotated[Union[tagged], discriminator]  # noqa: UP007


def as_tuples(value: Any) -> Any:
    """Lists as tuples throughout, as frozen tables hold them."""
    if isinstance(value, dict):
        return {key: as_tuples(item) for key, item in value.items()}
    return tuple(as_tuples(item) for item in value) if isinstance(value, (list, tuple)) else value


def exactly_one(table: Table, *keys: str) -> None:
    """Refuse a table that has none of these keys, or several."""
    given = [key for key in keys if getattr(table, key) is not None]
    if len(given) != 1:
        what = f"{' and '.join(given)} are given" if given else f"{keys[0]} is missing"
        raise InputError(what, f"give exactly one of {', '.join(keys)}")


# --- pydantic's errors in our words -------------------------------------------------------------


def scene_error(error: ValidationError, data: Any, where: str) -> SceneError:
    """The first mistake of the scene `data` from the file `where`, with the others' messages."""
    found = (
        told
        for item in error.errors(include_url=False)
        for told in _described(item, *_found(item["loc"], data))
    )
    first, *others = (SceneError(*told[:2], where, told[2]) for told in dict.fromkeys(found))
    first.also = tuple(others)
    return first


def _described(item, key: str, written: Any) -> list[tuple[str, str, str]]:
    """What, allowed and remedy of each mistake; `written` is what the file has at `key`."""
    value, cause = item["input"], item.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return [(placed(key, one, value), one.allowed, one.remedy) for one in (cause, *cause.also)]
    return [_of_type(item, key, written, value)]


def _of_type(item, key: str, written: Any, value: Any) -> tuple[str, str, str]:
    if item["type"] == "kind":
        return _kind(key, written, *item["msg"].split(": "))
    listed = "tuple" in item["type"] and "." not in key
    remedy = f"Write [[{key}]] above each of them." if listed else ""
    return (
        f"{key} = {_short(value)}",
        f"must be a {'list of tables' if listed else 'table'}",
        remedy,
    )


def _kind(key: str, value: Any, name: str, kinds: str) -> tuple[str, str, str]:
    allowed = f"must be one of {kinds}"
    if isinstance(value, str):  # a name instead of a table with no more than that name
        return f"{key} = {_short(value)}", allowed, did_you_mean(value, kinds.split(", "))
    if not isinstance(value, dict):
        return f"{key} = {_short(value)}", f"must be a table whose {name} is one of {kinds}", ""
    if name not in value:
        return f"{key}.{name} is missing", allowed, ""
    remedy = did_you_mean(value[name], kinds.split(", "))
    if key.startswith("terms"):
        remedy = " ".join(filter(None, [remedy, _own(value[name])]))
    return f"{key}.{name} = {_short(value[name])}", allowed, remedy


def _own(name: Any) -> str:
    """How Python code gives a type of term that is not the package's."""
    if not (isinstance(name, str) and name.isidentifier()):
        return ""
    return f'One of your own: fecloth.scene.scene.load("….toml", terms={{"{name}": {name}}}).'


def placed(key: str, error: InputError, value: Any = None) -> str:
    """What an `InputError` says about the table or value at `key`, with the dotted key in it."""
    first = error.what.split(" ", 2)
    if not error.what:
        return f"{key} = {_short(value)}"
    if len(first) > 1 and first[1] in ("=", "is") and _KEY.fullmatch(first[0]):
        return f"{key}.{error.what}".removeprefix(".")
    return f"{key}: {error.what}".removeprefix(": ")


@contextmanager
def told_at(key: str, where: str) -> Iterator[None]:
    """Refusals of a scene's objects as what the scene `where` says at `key`."""
    try:
        yield
    except SceneError:
        raise
    except InputError as error:
        what = placed(key, error)
        if isinstance(error, MeshError) and key == "cloth":  # where: the mesh file
            what = f"{key}: {error.where}: {error.what}"
        raise SceneError(what, error.allowed, where, error.remedy) from error


def _short(value: Any) -> str:
    return reprlib.repr(list(value) if isinstance(value, tuple) else value)


def _found(location: tuple, data: Any) -> tuple[str, Any]:
    """The dotted key of an error, and what stands there.

    Pydantic's own entries, which name the kind of a table, are left out.
    """
    keys = []
    for entry in location:
        inside = isinstance(data, dict) and entry in data
        inside |= isinstance(data, (list, tuple)) and isinstance(entry, int) and entry < len(data)
        if inside:
            data = data[entry]
            keys.append(str(entry))
    return ".".join(keys), data
