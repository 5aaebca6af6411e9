"""How the signature of a function becomes the arguments of a command."""

from argparse import ArgumentParser
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest

from fecloth.cli.arguments import add_arguments, call, help_words

Size = Annotated[float, "a size (%(default)g)", "M"]


@dataclass(frozen=True, kw_only=True)
class Group:
    """Two options."""

    size: Size = 1.0
    fast: Annotated[bool, "whether it is fast"] = False


def command(
    path: Annotated[str, "a file"],
    more: Annotated[list[int] | None, "numbers"] = None,
    *,
    output_file: Annotated[str, "a folder", "DIR", "-o"],
    set_: Annotated[list[str] | None, "changes"] = None,
    names: Annotated[tuple[str, ...], "names"] | None = None,
    level: Annotated[Literal[1, 2, 3], "a level"] = 2,
    listed: Annotated[str | bool, "all, or this"] = False,
    sizes: Annotated[list[tuple[str, float]] | None, "sizes"] = None,
    time: Annotated[float | str | None, "a time"] = None,
    group: Group,
):
    """Do what the arguments say.

    Not a part of the help.
    """
    return vars()


def parser_of(function):
    parser = ArgumentParser("test")
    add_arguments(parser, function)
    return parser


def parse(function, *words):
    return call(function, vars(parser_of(function).parse_args(words)))


def test_options_that_are_not_given_have_their_defaults():
    assert parse(command, "a", "-o", "out") == {
        "path": "a",
        "more": [],
        "output_file": "out",
        "set_": None,
        "names": None,
        "level": 2,
        "listed": False,
        "sizes": None,
        "time": None,
        "group": Group(size=1.0, fast=False),
    }


def test_options_are_read_as_their_types_say():
    words = "a 4 5 --output-file out --set x=1 --set y=2 --names a,,b --level 3 --listed q"
    words += " --sizes x=1 --sizes y=2.5 --size 2 --fast"
    assert parse(command, *words.split(), "--time", "60 s") == {
        "path": "a",
        "more": [4, 5],
        "output_file": "out",
        "set_": ["x=1", "y=2"],
        "names": ("a", "b"),
        "level": 3,
        "listed": "q",
        "sizes": [("x", 1.0), ("y", 2.5)],
        "time": "60 s",
        "group": Group(size=2.0, fast=True),
    }
    assert parse(command, "a", "-o", "out", "--listed")["listed"] is True
    assert parse(command, "a", "-o", "out", "--time", "60")["time"] == 60.0


WRONG = [
    (["a"], "required: -o/--output-file"),
    (["a", "-o", "out", "--level", "4"], "invalid choice: 4"),
    (["a", "-o", "out", "--size", "x"], "invalid float value: 'x'"),
    (["a", "-o", "out", "--sizes", "x=y"], "invalid read_size value: 'x=y'"),
    (["-o", "out"], "required: path"),
]


@pytest.mark.parametrize(("words", "message"), WRONG)
def test_wrong_options_are_refused(words, message, capsys):
    with pytest.raises(SystemExit):
        parse(command, *words)
    assert message in capsys.readouterr().err


def test_positional_lists_without_a_default_need_a_value():
    def needs(paths: Annotated[list[str], "files"]):
        return paths

    assert parse(needs, "a", "b") == ["a", "b"]
    with pytest.raises(SystemExit):
        parse(needs)


def test_a_default_of_a_group_has_the_defaults_of_its_fields():
    default = Group(size=60.0)

    def other(*, group: Group = default):
        return group

    assert parse(other) == default
    assert parse(other, "--size", "2") == Group(size=2.0)
    assert "a size (60)" in parser_of(other).format_help()


def test_the_help_has_the_first_paragraph_and_all_words():
    assert help_words(command) == "do what the arguments say"
    text = parser_of(command).format_help()
    for words in ("-o DIR, --output-file DIR", "--size M", "a size (1)", "--level {1,2,3}"):
        assert words in text
