"""Checks of the two arguments that many public functions share: a system and a state of it."""

import numpy as np

from fecloth.errors import InputError, brief, is_number
from fecloth.system.state import State
from fecloth.system.system import System


def check_system(system: object, state: object, where: str, starts: bool = True) -> None:
    """Raise `InputError` for an argument that is no system, or for what is no state of it.

    Times, positions and velocities must be finite. `where` names the function in the error. A
    state that `starts` a motion must also be outside of obstacles, and whatever else its terms
    ask of a start.
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
        _check_array(f"state.{name}", getattr(state, name), len(system.cloth.X), where)
    if starts:
        for term in system.bound:
            term.check_start(state.x, state.t, where)
        for seam in system.seams:
            seam.check_start(system, state.x, state.t, where)


def _check_array(name: str, value: object, nodes: int, where: str) -> None:
    """Raise `InputError` for anything but an array of (nodes, 3) finite numbers.

    `name` is the array, and `where` the function in the error.
    """
    if not isinstance(value, np.ndarray) or value.dtype != float:
        remedy = "system.state(x, v) makes arrays of lists."
        allowed = "must be an array of floating-point numbers"
        raise InputError(f"{name} = {brief(value)}", allowed, where, remedy)
    if value.shape != (nodes, 3):
        remedy = "Is it the state of another cloth?"
        allowed = f"must be ({nodes}, 3)"
        raise InputError(f"{name} of shape {value.shape}", allowed, where, remedy)
    if not np.isfinite(value).all():
        node = int(np.argwhere(~np.isfinite(value))[0, 0])
        raise InputError(f"{name}[{node}] = {value[node]}", "must be finite", where)
