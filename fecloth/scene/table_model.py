"""Pydantic models of the tables of a scene; every mistake becomes a `SceneError`.

A number may be text with a unit if the type of its key names a dimension, as in
``Annotated[float, LENGTH]``; see `units`. The model has it in SI. What a key means is the string
below its field; the page of scenes, the JSON schema and messages take it from there.
"""

import dataclasses
import inspect
import re
import typing
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, ForwardRef, Literal, Union

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    ValidationError,
    create_model,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo

from fecloth.errors import InputError, did_you_mean
from fecloth.quantities.arguments import by_new_names
from fecloth.scene.error_words import shorten
from fecloth.scene.type_words import holds_tables, in_si, meaning, options, phrase, writable

TERM = ForwardRef("Term")


class Table(BaseModel):
    """A table whose keys are the fields; unknown and missing keys are refused with a remedy."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
        use_attribute_docstrings=True,
        defer_build=True,  # most tables are read as parts of others
    )

    shorthands: ClassVar[dict[str, FieldInfo]] = {}
    """Keys that others replace before the fields are read."""
    remedies: ClassVar[Mapping[str, str]] = {}
    """What to write in place of a key that is tried by mistake."""

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        """Return the table with its quantities in SI.

        Raise `InputError` for unknown keys or, if there are none, for missing keys: the first
        mistake, whose `also` has the others.
        """
        if not isinstance(data, dict):
            return data
        if refusals := _errors_of_unknown_keys(data, cls) or _errors_of_missing_keys(data, cls):
            refusals[0].also = tuple(refusals[1:])
            raise refusals[0]
        return in_si(data, cls.model_fields)

    @field_validator("*", mode="wrap")
    @classmethod
    def _describe_mistake(cls, value: Any, handler, info) -> Any:
        """Return the value as `handler`, the check of a field by pydantic, returns it.

        For an error of pydantic raise an `InputError` that says what the field allows. Errors
        that are described already, or that `error_words` describes, pass unchanged.
        """
        field = cls.model_fields[info.field_name]
        try:
            return handler(value)
        except ValidationError as error:
            # pydantic's name for an `InputError` that a check of ours has raised
            is_described = any(item["type"] == "value_error" for item in error.errors())
            if is_described or holds_tables(field.annotation):
                raise
            words = options(field.annotation)
            if isinstance(value, str):
                remedy = did_you_mean(value, words)
            else:
                remedy = ""
            raise InputError("", f"must be {phrase(field)}", remedy=remedy) from None


def _errors_of_unknown_keys(data: dict, table: type[Table]) -> list[InputError]:
    """Return an `InputError` for each key of `data` that the table does not have.

    A remedy names the nearest key, or what to write in place of a usual mistake.
    """
    known_keys = (*table.model_fields, *table.shorthands)
    # Keys of the scene itself. Below the header of a table, TOML makes them keys of that table.
    keys_of_scene = {"title", "mass", "fabric", "grain_degrees"}
    refusals = []
    for key, value in data.items():
        if key in table.model_fields:
            continue
        if key in keys_of_scene:
            remedy = f"Write {key} before the first table."
        else:
            remedy = table.remedies.get(key) or did_you_mean(key, known_keys)
        what = f"{key} = {shorten(value)}"
        allowed = f"unknown key; the keys are {', '.join(known_keys)}"
        refusals.append(InputError(what, allowed, remedy=remedy))
    return refusals


def _errors_of_missing_keys(data: dict, table: type[Table]) -> list[InputError]:
    """Return an error for each required key that is not in the data."""
    return [
        InputError(f"{key} is missing", f"must be {phrase(field)}", remedy=meaning(field))
        for key, field in table.model_fields.items()
        if field.is_required() and key not in data
    ]


class Made(Table):
    """A table that stands for an object of the class `makes`, made once, when it is read.

    What the class refuses is part of the validation.
    """

    makes: ClassVar[type]

    _object: Any = PrivateAttr()

    @model_validator(mode="before")
    @classmethod
    def _read_old_names(cls, data: Any) -> Any:
        """Return the table with today's names in place of older names of its keys."""
        if isinstance(data, dict):
            return by_new_names(cls.makes.__name__, data)
        return data

    @model_validator(mode="after")
    def _make_object(self):
        """Make the object from the fields, and raise the `InputError` of its class."""
        values = {}
        for field in dataclasses.fields(self.makes):
            if field.init:
                value = getattr(self, field.name)
                values[field.name] = value.make() if isinstance(value, Made) else value
        self._object = self.makes(**values)
        return self

    def make(self):
        """Return the object."""
        return self._object


def table_of(cls: type, name: str = "", **more) -> type[Made]:
    """Return the class of tables that stand for objects of the dataclass `cls`.

    Its keys are the fields of the dataclass, with their types and defaults. With a `name` the
    table also has the key `type`, whose value must be that name. The text of the table and the
    meanings of its keys come from the dataclass's docstring. A field annotated ``object`` holds
    another term, such as the law of a damping. What no file can hold, such as functions, is
    removed from the types of fields. `more` has (type, default) for keys that differ from their
    field, or that are no field.
    """
    text, meanings = parts_of_docstring(cls)
    hints = typing.get_type_hints(cls, include_extras=True)
    fields: dict[str, Any] = {}  # (type, default) of each key; the default ... means: required
    if name:
        fields["type"] = (Literal[name], ...)
    # Fields that are passed by name come last, as in the call of the class.
    for field in sorted(dataclasses.fields(cls), key=lambda field: field.kw_only is True):
        if not field.init:  # computed by the class, not given by the user
            continue
        hint = writable(hints[field.name])
        if hint is object:  # "Term" is resolved when all tables of terms are made
            hint = Union[TERM, None]  # noqa: UP007
        fields[field.name] = (hint, _find_default(field))
    described: dict[str, Any] = {
        key: (hint, Field(default, description=meanings.get(key)))
        for key, (hint, default) in (fields | more).items()
    }
    model = create_model(
        f"{cls.__name__}Table",
        __base__=Made,
        __doc__=text,
        __cls_kwargs__={"use_attribute_docstrings": False},  # it has no source to look into
        **described,
    )
    model.makes = cls
    return model


def _find_default(field: dataclasses.Field) -> Any:
    """Return the default of a dataclass's field; ... for a field that has none."""
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    if field.default is not dataclasses.MISSING:
        return field.default
    return ...


def parts_of_docstring(cls: type) -> tuple[str, dict[str, str]]:
    """Return the text of a class's docstring before its first section, and its Parameters.

    The second is a dict: the words on each name, on one line. Names that a base class describes
    are in it, too.
    """
    text = ""
    meanings = dict[str, str]()
    for base in reversed(cls.__mro__[:-1]):  # from the farthest base to the class itself
        # sections: the name of a section and its text, in turn
        text, *sections = re.split(r"\n\n(\w+)\n-{4,}\n", inspect.getdoc(base) or "")
        parameters = dict(zip(sections[::2], sections[1::2], strict=True)).get("Parameters", "")
        # an item: a line with names, and the indented lines below it
        items = re.findall(r"^(\S.*)\n((?:(?: {4}.*)?(?:\n|$))+)", parameters, re.MULTILINE)
        for names, words in items:
            meanings |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return text.strip(), meanings


def one_of(key: str, tables: Mapping[str, type[Table]]) -> Any:
    """Return the type of a table that is one of several kinds.

    The text at its `key` says which kind it is, and `tables` has the class of each kind. A table
    of none of them is an error of pydantic's type "kind", which `error_words` describes.
    """

    def find_kind(data):
        """Return the text at `key` of a table, as read or as made; None if there is none."""
        if isinstance(data, dict):
            kind = data.get(key)
        else:
            kind = getattr(data, key, None)
        return kind if isinstance(kind, str) else None

    tagged = tuple(Annotated[table, Tag(name)] for name, table in tables.items())
    discriminator = Discriminator(
        find_kind,
        custom_error_type="kind",
        custom_error_message=f"{key}: {', '.join(tables)}",  # parsed by `error_words`
    )
    return Annotated[Union[tagged], discriminator]  # noqa: UP007


def as_tuples(value: Any) -> Any:
    """Return the value with tuples in place of lists, for frozen tables."""
    if isinstance(value, dict):
        return {key: as_tuples(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return tuple(as_tuples(item) for item in value)
    return value


def require_exactly_one(table: Table, *keys: str) -> None:
    """Raise `InputError` for a table with none or several of these keys."""
    used = [key for key in keys if getattr(table, key) is not None]
    if len(used) != 1:
        if used:
            what = f"{' and '.join(used)} are given"
        else:
            what = f"{keys[0]} is missing"
        raise InputError(what, f"give exactly one of {', '.join(keys)}")
