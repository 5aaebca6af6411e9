"""The arguments of a command follow from the signature of its function.

A parameter such as ``jobs: Annotated[int, "processes (1)", "N"] = 1`` says all of an argument.
After the type stand the help, in which "%(default)s" is the default; the name of the value in the
help; and a second name of the option, as "-o". The last two may be left out, or be "".

Parameters that only a keyword sets are options, here ``--jobs``; the others are given by their
place. An underscore at the end of a name is left out. The type says how the value is read:

=================  =============================================================
bool               True if the option is there
list               several values; an option is repeated for this
tuple[str, ...]    names with commas between them
tuple[str, float]  KEY=NUMBER
float | str        a number, or a text with a unit
str | bool         a text, or True if the option is there without one
Literal            one of these values
X | None           as X
a dataclass        its fields are arguments, and its default has their defaults
=================  =============================================================

The annotations are read as objects: the module of a command must not postpone them.
"""

from argparse import ArgumentParser
from collections.abc import Callable, Mapping
from inspect import Parameter, getdoc, signature
from typing import Any, Literal, Union, get_args, get_origin


def add_arguments(parser: ArgumentParser, function: Callable) -> None:
    """Let a parser take the arguments of a function."""
    for parameter in signature(function).parameters.values():
        group = parameter.annotation
        if not isinstance(group, type):
            _add_argument(parser, parameter)
            continue
        add_arguments(parser, group)
        if parameter.default is not Parameter.empty:
            parser.set_defaults(**vars(parameter.default))


def call(function: Callable, values: Mapping[str, Any]) -> Any:
    """Call a function with those of the parsed values that are its arguments."""
    arguments = {}
    for name, parameter in signature(function).parameters.items():
        group = parameter.annotation
        if isinstance(group, type):
            arguments[name] = call(group, values)
        else:
            arguments[name] = values[name]
    return function(**arguments)


def help_words(function: Callable) -> str:
    """Return the first paragraph of the docstring, as the words of a help."""
    words = str(getdoc(function)).partition("\n\n")[0].removesuffix(".")
    return words[0].lower() + words[1:]


def option_name(parameter: str) -> str:
    """Return the name of the option of a parameter, without the dashes before it."""
    return parameter.rstrip("_").replace("_", "-")


def _add_argument(parser: ArgumentParser, parameter: Parameter) -> None:
    """Add an argument for a parameter with an annotation as the module describes."""
    kind, *words = get_args(_without_none(parameter.annotation))
    kind = _without_none(kind)
    is_list = get_origin(kind) is list
    if is_list:
        (kind,) = get_args(kind)
    pairs = zip(("help", "metavar"), words, strict=False)
    keywords: dict[str, Any] = {key: word for key, word in pairs if word}
    if get_origin(kind) is Literal:
        choices = get_args(kind)
        keywords |= {"choices": choices, "type": type(choices[0])}
    else:
        keywords |= READING.get(kind, {"type": kind})
    is_required = parameter.default is Parameter.empty
    if not is_required:
        keywords["default"] = parameter.default
    if parameter.kind is Parameter.KEYWORD_ONLY:
        names = [*words[2:], f"--{option_name(parameter.name)}"]
        keywords |= {"dest": parameter.name, "required": is_required}
        if is_list:
            keywords["action"] = "append"
    else:
        names = [parameter.name]
        if is_list:
            keywords["nargs"] = "+" if is_required else "*"
        elif not is_required:
            keywords["nargs"] = "?"
    parser.add_argument(*names, **keywords)


def read_names(text: str) -> tuple[str, ...]:
    """Return the names between the commas of a text."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def read_size(text: str) -> tuple[str, float]:
    """Return the key and the number of KEY=SIZE."""
    key, _, number = text.partition("=")
    return key.strip(), float(number)


def read_number(text: str) -> float | str:
    """Return a bare number, or a text with a unit as it is."""
    try:
        return float(text)
    except ValueError:
        return text


# What `ArgumentParser.add_argument` takes to read a value of a type.
READING: dict[Any, dict[str, Any]] = {
    bool: {"action": "store_true"},
    str | bool: {"nargs": "?", "const": True},
    tuple[str, ...]: {"type": read_names},
    tuple[str, float]: {"type": read_size},
    float | str: {"type": read_number},
}


def _without_none(annotation: Any) -> Any:
    """Return X for X | None, and any other annotation as it is."""
    types = get_args(annotation)
    if type(None) not in types:
        return annotation
    return Union[tuple(kind for kind in types if kind is not type(None))]  # noqa: UP007
