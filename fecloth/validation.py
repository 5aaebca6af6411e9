"""Checks of the arguments of public functions: numbers, functions, objects of a class."""

from __future__ import annotations

import math

from fecloth.errors import InputError, brief, is_number


def number(name: str, value: object, above: float, where: str, *, infinite: bool = False) -> None:
    """Raise `InputError` for anything but a finite number > `above`, or inf if `infinite`."""
    endless = infinite and isinstance(value, float) and value == math.inf
    if not (endless or (is_number(value) and value > above)):
        allowed = f"must be a finite number > {above:g}{', or infinite' if infinite else ''}"
        raise InputError(f"{name} = {brief(value)}", allowed, where)


def function(name: str, value: object, example: str, where: str) -> None:
    """Raise `InputError` for a value that cannot be called, and for a class."""
    if not callable(value) or isinstance(value, type):
        allowed = f"must be a function, as in {example}"
        raise InputError(f"{name} = {brief(value)}", allowed, where)


def instance(name: str, value: object, cls: type | tuple, example: str, where: str) -> None:
    """Raise `InputError` for a value that is not an object of the class."""
    if not isinstance(value, cls):
        raise InputError(f"{name} = {brief(value)}", f"must be such as {example}", where)
