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
    ``h: Annotated[float, LENGTH]``. An argument that is missing, unknown or too many raises an
    `InputError` that lists all arguments.
    """
    create: Any = target
    if isinstance(target, type):
        create = vars(target)["__init__"]

    @functools.wraps(create)
    def checked(*positional: Any, **named: Any) -> Any:
        named = by_new_names(target.__qualname__, named)
        if any(map(_has_text, (*positional, *named.values()))):
            given = _bind(target, create, positional, named)
            given.arguments.update(_read(target, given.arguments))
            positional = given.args
            named = given.kwargs
        try:
            return create(*positional, **named)
        except TypeError:
            _bind(target, create, positional, named)  # raises if the arguments do not fit
            raise

    if not isinstance(target, type):
        return cast(Target, checked)
    target.__init__ = checked  # type: ignore[misc]  # of the class itself, not of an instance
    return target


def _bind(
    target: Target, create: Target, positional: tuple[Any, ...], named: dict[str, Any]
) -> Any:
    """Bind the arguments by the signature; raise `InputError` if they do not fit."""
    signature = inspect.signature(create)
    try:
        return signature.bind(*positional, **named)
    except TypeError:
        what, remedy = _misfit(signature, positional, named)
    takes = []
    if required := _list_arguments(target, required=True):
        takes.append(f"it needs {required}")
    if optional := _list_arguments(target, required=False):
        takes.append(f"it may have {optional}")
    allowed = ", and ".join(takes) or "it takes no arguments"
    remedy = remedy or MADE_BY.get(target.__qualname__, "")
    raise InputError(what, allowed, target.__qualname__, remedy) from None


def _misfit(
    signature: inspect.Signature, positional: tuple[Any, ...], named: dict[str, Any]
) -> tuple[str, str]:
    """Return what does not fit, and the remedy."""
    parameters = {
        name: parameter
        for name, parameter in signature.parameters.items()
        if parameter.kind not in ANY
    }
    by_place = [
        n for n, parameter in parameters.items() if parameter.kind != parameter.KEYWORD_ONLY
    ]
    unknown = [name for name in named if name not in parameters]
    if unknown and len(parameters) == len(signature.parameters):
        return f"argument {unknown[0]!r} is unknown", did_you_mean(unknown[0], parameters)
    if len(positional) > len(by_place):
        return f"{brief(positional[len(by_place)])} is a value too many", ""
    twice = [name for name in by_place[: len(positional)] if name in named]
    if twice:
        return f"{twice[0]} is given twice, by its place and by its name", ""
    given = {*by_place[: len(positional)], *named}
    needed = [n for n, parameter in parameters.items() if parameter.default is parameter.empty]
    missing = [name for name in needed if name not in given]
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
    """Return what the arguments of the class or function hold, without `self` and `cls`."""
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
