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
    """An option or argument of a command, as `argparse` takes it.

    Attributes
    ----------
    names
        Such as ["-o", "--output"].
    keywords
        Of `ArgumentParser.add_argument`.
    """

    names: list[str]
    keywords: dict[str, Any]

    @property
    def key(self) -> str:
        """The name of its value among the parsed options."""
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
        """Import and return the function of the command."""
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
    """Yield the options of a list of the table of commands, each as a table.

    An item is the name of a group of options, the name of a shared option, or a table. A table
    with the key `like` has all keys of that shared option, and may replace some of them.
    """
    for item in listed:
        if isinstance(item, dict) and "like" in item:
            yield TABLE["shared"][item["like"]] | item
        elif isinstance(item, dict):
            yield item
        elif item in TABLE["groups"]:
            yield from _rows(TABLE["groups"][item])
        else:
            yield TABLE["shared"][item]


def read_options(listed: list[Any]) -> list[Option]:
    """Return the options of a list; of two with the same names the later one counts."""
    options = {}
    for row in _rows(listed):
        keywords = {key: value for key, value in row.items() if key not in ("names", "like")}
        if "type" in row:
            keywords["type"] = TYPES[row["type"]]
        options[row["names"]] = Option(row["names"].split(), keywords)
    return list(options.values())


COMMANDS = {
    name: Command(**row | {"options": read_options(row["options"])})
    for name, row in TABLE["commands"].items()
}
RUNNING = {option.key for option in read_options(["running"])}  # options of all studies


def reading(options: Namespace) -> dict[str, Any]:
    """Return the options of the group "mesh" as arguments of `load_scene`."""
    return {"trust_geo": options.trust_geo, "mesh_time": options.mesh_time}
