"""The state of a cloth at one time."""

from dataclasses import dataclass, field

import numpy as np

from fecloth.errors import InputError, floats, is_number
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True, eq=False)
class State:
    """Time t [s], positions x (n, 3) [m] and velocities v (n, 3) [m/s].

    Attributes
    ----------
    t
        Time [s].
    x
        (n, 3) positions [m].
    v
        (n, 3) velocities [m/s].
    history
        Records that terms keep, of a state from which a run shall go on with them, as
        `equilibrium` leaves it; see `System.start_history`. None: they begin anew.
    """

    t: float
    x: np.ndarray
    v: np.ndarray
    history: tuple | None = field(default=None, kw_only=True)

    def __repr__(self) -> str:
        return f"<State of {len(self.x)} nodes at t = {self.t:g} s>"


def make_state(nodes: int, x, v=None, t: float = 0.0) -> State:
    """Return a state of a cloth of so many nodes at a time t [s].

    x are its positions (n, 3) [m], v its velocities (n, 3) [m/s], zero by default. Raises
    `InputError` if they are not finite or have another shape.
    """
    shape = (nodes, 3)
    where = "System.state"
    x = floats("x", x, where)
    v = np.zeros(shape) if v is None else floats("v", v, where)
    for name, value in (("x", x), ("v", v)):
        if value.shape != shape or not np.isfinite(value).all():
            allowed = f"must be finite and of shape {shape}"
            raise InputError(f"{name} of shape {value.shape}", allowed, where)
    if not is_number(t):
        raise InputError(f"t = {t!r}", "must be finite [s]", where)
    return State(float(t), x, v)
