"""What the terms of a scene take, as a page to read: `fecloth info --terms [NAME]`."""

from __future__ import annotations

import textwrap

from fecloth.errors import InputError
from fecloth.scene.key_reference import fields
from fecloth.scene.table_model import Made
from fecloth.scene.tables import TERM_TABLES
from fecloth.scene.type_words import meaning, phrase
from fecloth.suggest import did_you_mean

WIDTH = 100


def describe_terms(name: str) -> list[str]:
    """Return lines about the term of this name, or with "" one line for each term."""
    tables = TERM_TABLES
    if not name:
        wide = max(map(len, tables))
        return [f"{key:<{wide}}  {', '.join(fields(tables[key]))}".rstrip() for key in tables]
    if name not in tables:
        allowed = f"must be one of {', '.join(tables)}"
        raise InputError(f"--terms {name}", allowed, "", did_you_mean(name, list(tables)))
    lines = ["[[terms]]", f'type = "{name}"', "", *(tables[name].__doc__ or "").split("\n")]
    return lines + [line for key in fields(tables[name]) for line in _describe(tables[name], key)]


def _describe(table: type[Made], key: str) -> list[str]:
    """Return the key, what it takes, its default and its meaning."""
    field = table.model_fields[key]
    usual = "required" if field.is_required() else f"default {field.default!r}"
    words = textwrap.wrap(meaning(field), WIDTH, initial_indent="    ", subsequent_indent="    ")
    return ["", f"{key}: {phrase(field)}; {usual}", *words]
