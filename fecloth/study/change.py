"""A problem, changed: other values of its keys, or an edit of its tables."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from fecloth.scene.overrides import override

Edit = Callable[[dict], dict]


@dataclass(frozen=True)
class Change:
    """What is different in a changed problem."""

    name: str = ""  # in words, for messages; "" if these need no words
    # Values by key: the keys of a scene are those of --set; a function's are its arguments.
    values: Mapping[str, object] = field(default_factory=dict)
    # What values cannot say, as another term in place of one: returns the tables that it gets,
    # which are a copy, changed.
    edits: tuple[Edit, ...] = ()

    @classmethod
    def of(cls, values: Mapping[str, object]) -> Change:
        """Return the change of some values, named "key = value, key = value"."""
        return cls(describe_values(values), values)

    def apply(self, tables: dict) -> dict:
        """Return changed tables; the ones given stay as they are."""
        tables = copy.deepcopy(tables)
        for edit in self.edits:
            tables = edit(tables)
        return override(tables, [f"{key}={_toml(value)}" for key, value in self.values.items()])


def _toml(value: object) -> str:
    """Return a value as TOML; a text stands for itself, as after --set."""
    return value if isinstance(value, str) else _inline(value)


def _inline(value: object) -> str:
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key} = {_inline(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    return json.dumps(value, ensure_ascii=False)


def describe_values(values: Mapping[str, object]) -> str:
    """Return "key = value, key = value"."""
    return ", ".join(f"{key} = {value}" for key, value in values.items())
