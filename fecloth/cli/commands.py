"""The commands that commands.toml lists, with their options as `argparse` takes them."""

import importlib
import tomllib
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Option:
    """An option or argument of a command, as `argparse` takes it."""

    names: list[str]
    keywords: dict[str, Any]

    @property
    def key(self) -> str:
        """Name of its value among the parsed options."""
        return self.keywords.get("dest") or self.names[-1].lstrip("-").replace("-", "_")


@dataclass(frozen=True)
class Command:
    """A row of the table; its fields are described there."""

    target: str
    options: list[Option]
    words: str
    is_study: bool = False
    prints: bool = True

    def load(self) -> Callable:
        module, name = self.target.split(":")
        return getattr(importlib.import_module(module), name)


def read_seconds(text: str) -> str | float:
    """Return a bare number as seconds, and a text with a unit as it is."""
    try:
        return float(text)
    except ValueError:
        return text


def read_size(text: str) -> tuple[str, float]:
    """Return the key and the number of KEY=SIZE."""
    key, _, number = text.partition("=")
    return key.strip(), float(number)


TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
TYPES: dict = {"int": int, "float": float, "seconds": read_seconds, "size": read_size}
TYPES["names"] = lambda text: [name.strip() for name in text.split(",") if name.strip()]


def _rows(listed: list[Any]) -> Iterator[dict[str, Any]]:
    """Yield the options of a list as tables: groups and shared options by name are looked up."""
    for each in listed:
        if isinstance(each, dict):
            yield (TABLE["shared"][each["like"]] if "like" in each else {}) | each
        elif each in TABLE["groups"]:
            yield from _rows(TABLE["groups"][each])
        else:
            yield TABLE["shared"][each]


def read_options(listed: list[Any]) -> list[Option]:
    """Return the options of a list; of two with the same names the later one counts."""
    options = {}
    for row in _rows(listed):
        keywords = {key: value for key, value in row.items() if key not in ("names", "like")}
        keywords |= {"type": TYPES[row["type"]]} if "type" in row else {}
        options[row["names"]] = Option(row["names"].split(), keywords)
    return list(options.values())


COMMANDS = {
    name: Command(**row | {"options": read_options(row["options"])})
    for name, row in TABLE["commands"].items()
}
RUNNING = {option.key for option in read_options(["running"])}  # that all studies share


def reading(options: Namespace) -> dict[str, Any]:
    """Return the arguments of `load_scene` that the options of the group "mesh" are."""
    return {"trust_geo": options.trust_geo, "mesh_time": options.mesh_time}
