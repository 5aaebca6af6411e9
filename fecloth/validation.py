"""Refusals of what the public functions cannot use: arguments that are missing, swapped or text."""

from __future__ import annotations

import math

import numpy as np

from fecloth.errors import InputError, brief, is_number
from fecloth.system.system import State, System


def of(system: object, state: object, where: str) -> None:
    """Refuse what is no system, and what is no state of it.

    Parameters
    ----------
    where
        The function that was given them.

    Raises
    ------
    InputError
        For arguments that are swapped or of other types, and for a state of another cloth, with
        lists in it, or with a number that is not finite.
    """
    if not isinstance(system, System):
        remedy = "The state comes second." if isinstance(system, State) else ""
        allowed = "must be a System(cloth, fabric, terms, pins)"
        raise InputError(f"system = {brief(system)}", allowed, where, remedy)
    if not isinstance(state, State):
        allowed = "must be a State such as system.rest() or system.state(x, v)"
        raise InputError(f"state = {brief(state)}", allowed, where)
    if not is_number(state.t):
        raise InputError(f"state.t = {state.t!r}", "must be a finite number [s]", where)
    for name in ("x", "v"):
        _array(f"state.{name}", getattr(state, name), len(system.cloth.X), where)


def _array(name, value, nodes, where):
    """Refuse what is not (nodes, 3) finite numbers."""
    if not isinstance(value, np.ndarray) or value.dtype != float:
        remedy = "system.state(x, v) makes arrays of lists."
        allowed = "must be an array of floating-point numbers"
        raise InputError(f"{name} = {brief(value)}", allowed, where, remedy)
    if value.shape != (nodes, 3):
        remedy = "Is it the state of another cloth?"
        raise InputError(f"{name} of shape {value.shape}", f"must be ({nodes}, 3)", where, remedy)
    if not np.isfinite(value).all():
        node = int(np.argwhere(~np.isfinite(value))[0, 0])
        raise InputError(f"{name}[{node}] = {value[node]}", "must be finite", where)


def number(name: str, value: object, above: float, where: str, *, infinite=False) -> None:
    """Refuse what is no finite number > `above`, nor `infinite` where that is allowed."""
    endless = infinite and isinstance(value, float) and value == math.inf
    if not (endless or (is_number(value) and value > above)):
        allowed = f"must be a finite number > {above:g}{', or infinite' if infinite else ''}"
        raise InputError(f"{name} = {brief(value)}", allowed, where)


def function(name: str, value: object, example: str, where: str) -> None:
    """Refuse what cannot be called."""
    if not callable(value) or isinstance(value, type):
        allowed = f"must be a function, as in {example}"
        raise InputError(f"{name} = {brief(value)}", allowed, where)


def instance(name: str, value: object, cls: type | tuple, example: str, where: str) -> None:
    """Refuse what is not an object of the class."""
    if not isinstance(value, cls):
        raise InputError(f"{name} = {brief(value)}", f"must be such as {example}", where)
