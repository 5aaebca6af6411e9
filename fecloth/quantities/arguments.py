"""Arguments of public classes and functions: texts with units, and what does not fit."""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, TypeVar, cast, get_type_hints

from fecloth.errors import InputError, brief, did_you_mean, errors_of
from fecloth.quantities.units import Dimension, Measured, in_si

Target = TypeVar("Target", bound=Callable[..., Any])

# The kinds of *values and **named.
ANY = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)

OLD_NAMES = {"Pressure": {"p": "pressure"}}
"""By class: arguments that had another name in earlier versions, which is still accepted."""


MADE_BY = {
    "Cloth": "Make one by Cloth.rectangle(width, height, h), Cloth.disk(radius, h) or Cloth.read.",
    "Fabric": 'Published ones are made by Fabric.preset("cotton"); Fabric.presets() has the names.',
}
"""By class: the usual way to make an object of it."""


def by_new_names(owner: str, named: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments by their new names; refuse one that is given by both names."""
    new = OLD_NAMES.get(owner, {})
    for old in new.keys() & named.keys():
        if new[old] in named:
            remedy = f"Leave out {old}, its name in earlier versions."
            raise InputError(f"{new[old]} and {old} are given", "are the same", owner, remedy)
    return {new.get(name, name): value for name, value in named.items()}


def checks_arguments(target: Target) -> Target:
    """Let a class or function take texts with units, and refuse arguments that do not fit it.

    A number may be a text with a unit where the type has a dimension, as
    ``h: Annotated[float, LENGTH]``. Arguments may also have their `OLD_NAMES`. An argument that
    is missing, unknown or too many raises an `InputError` that lists all arguments.

    A class is returned itself, with another ``__init__``; of a function a new one is returned.
    """
    create: Any = target
    if isinstance(target, type):
        create = vars(target)["__init__"]

    @functools.wraps(create)
    def checked(*positional: Any, **named: Any) -> Any:
        named = by_new_names(target.__qualname__, named)
        # Numbers are in SI already: without texts the call needs no work here.
        if any(map(_has_text, (*positional, *named.values()))):
            bound = _bind(target, create, positional, named)
            bound.arguments.update(_read(target, bound.arguments))
            positional = bound.args
            named = bound.kwargs
        try:
            return create(*positional, **named)
        except TypeError:
            # An `InputError` if the arguments do not fit; else the error is from within.
            _bind(target, create, positional, named)
            raise

    if not isinstance(target, type):
        return cast(Target, checked)
    target.__init__ = checked  # type: ignore[misc]  # of the class itself, not of an instance
    return target


def _bind(
    target: Target, create: Target, positional: tuple[Any, ...], named: dict[str, Any]
) -> Any:
    """Return the arguments as `inspect.BoundArguments` of the function `create`.

    Raises `InputError` if they do not fit its signature; the message lists the arguments of
    `target`, whose ``__init__`` or self `create` is.
    """
    signature = inspect.signature(create)
    try:
        return signature.bind(*positional, **named)
    except TypeError:
        what, remedy = _describe_misfit(signature, positional, named)
    phrases = []
    if required := _list_arguments(target, required=True):
        phrases.append(f"it needs {required}")
    if optional := _list_arguments(target, required=False):
        phrases.append(f"it may have {optional}")
    allowed = ", and ".join(phrases) or "it takes no arguments"
    remedy = remedy or MADE_BY.get(target.__qualname__, "")
    raise InputError(what, allowed, target.__qualname__, remedy) from None


def _describe_misfit(
    signature: inspect.Signature, positional: tuple[Any, ...], named: dict[str, Any]
) -> tuple[str, str]:
    """Return two texts for arguments that do not fit: what does not fit, and the remedy or ""."""
    parameters = {
        name: parameter
        for name, parameter in signature.parameters.items()
        if parameter.kind not in ANY
    }
    names_by_place = [
        name for name, parameter in parameters.items() if parameter.kind != parameter.KEYWORD_ONLY
    ]
    takes_any = len(parameters) < len(signature.parameters)  # by *values or **named
    unknown_names = [name for name in named if name not in parameters]
    if unknown_names and not takes_any:
        name = unknown_names[0]
        return f"argument {name!r} is unknown", did_you_mean(name, parameters)
    if len(positional) > len(names_by_place):
        return f"{brief(positional[len(names_by_place)])} is a value too many", ""
    filled_names = names_by_place[: len(positional)]
    twice = [name for name in filled_names if name in named]
    if twice:
        return f"{twice[0]} is given twice, by its place and by its name", ""
    # No other way not to fit is left: an argument without a default is missing.
    missing = [
        name
        for name, parameter in parameters.items()
        if parameter.default is parameter.empty and name not in {*filled_names, *named}
    ]
    verb = "is" if len(missing) == 1 else "are"
    return f"{' and '.join(missing)} {verb} missing", ""


def _list_arguments(target: Callable[..., Any], required: bool) -> str:
    """List the required arguments with their units, or the arguments that may be left out."""
    listed = []
    for name, field in _fields(target).items():
        if (field.default is inspect.Parameter.empty) == required:
            unit = f" [{field.dimensions[0].si}]" if len(field.dimensions) == 1 else ""
            listed.append(name + unit)
    return ", ".join(listed)


def _read(target: Callable[..., Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments in SI, where their types have dimensions."""
    fields = _fields(target)
    named = {name: value for name, value in values.items() if name in fields}
    with errors_of(target.__qualname__):
        return in_si(named, fields, refuse_other_text=False)


@functools.cache
def _fields(target: Callable[..., Any]) -> dict[str, Measured]:
    """Return, by the name of each argument, its type, its dimensions and its default.

    `self`, `cls`, *values and **named are left out.
    """
    hints = get_type_hints(target, include_extras=True)
    fields = {}
    for name, parameter in inspect.signature(target).parameters.items():
        if name not in ("self", "cls") and parameter.kind not in ANY:
            marks = getattr(hints.get(name), "__metadata__", ())
            dimensions = tuple(mark for mark in marks if isinstance(mark, Dimension))
            fields[name] = Measured(hints.get(name), dimensions, parameter.default)
    return fields


def _has_text(value: Any) -> bool:
    if isinstance(value, tuple | list):
        return any(map(_has_text, value))
    return isinstance(value, str)
