"""Motions of pins and obstacles, loads, and forces of users as functions of time, sampled once."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from fecloth.quantities.formula import Formula
from fecloth.quantities.time_function import TimeFunction
from fecloth.simulation.within_step import uneven
from fecloth.system.pins import Motion
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.contact.shape import Shape
from fecloth.terms.custom.force import VARIABLES, BoundUserForce, FormulaForce
from fecloth.terms.loads.air_velocity import Field, Formulas, Gusts, Uniform
from fecloth.terms.springs.tether import BoundTether

MOST_NODES = 16  # at which a force on all nodes is compared: each costs an evaluation

Values = Callable[[np.ndarray], np.ndarray]  # function of times (m,) that returns (m, k)
Span = tuple[float, float]  # start and end of a run [s]


class Effort(NamedTuple):
    """How often something may be evaluated before a run."""

    most: int  # times in all, and even times of a run that chooses its steps
    even: int  # even times of a run with fixed steps
    inside: np.ndarray  # fractions of a step; uneven: no oscillation is zero at all of them


FORMULAS = Effort(2**17, 2**13 + 1, uneven(64))  # of time
PLACES = Effort(2**15, 2**13 + 1, uneven(32))  # the same at MOST_NODES
FUNCTIONS = Effort(2**13, 2**10 + 1, uneven(16))
FORCES = Effort(2**8, 2**8, uneven(5))  # of all nodes, by a function


@dataclass(frozen=True, eq=False)
class Signal:
    """A motion or a load that depends on time, with its samples."""

    name: str  # what a warning calls it
    values: Values
    effort: Effort
    span: Span
    is_fixed: bool  # whether the steps of the run have a fixed size
    kind: str  # what moves so, "pin", "obstacle" or "tether"; or "load"

    @property
    def moves(self) -> bool:
        """Whether it is a motion; a uniform motion counts as none."""
        return self.kind != "load"

    @cached_property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Even times (m,) [s] from the start to the end, and the values there (m, k)."""
        times = np.linspace(*self.span, self.effort.even if self.is_fixed else self.effort.most)
        return times, np.asarray(self.values(times), float).reshape(len(times), -1)


def find_signals(system: System, start: State, t_end: float, is_fixed: bool) -> Iterator[Signal]:
    """Yield what moves pins, obstacles and tethers, the loads, and forces of users' terms."""
    of_run: dict[str, Any] = {"span": (start.t, t_end), "is_fixed": is_fixed}
    for name, (pin, _) in system.constraints.groups.items():
        if not pin.moves:
            continue
        values = each(partial(pin.sample, size=system.cloth.extent))
        effort = FUNCTIONS
        if isinstance(pin.motion, Motion) and pin.rotate is None:
            values = _motion(pin.motion)
            effort = PLACES if pin.motion.by_place else FORMULAS
        yield Signal(name_motion(name), values, effort, kind="pin", **of_run)
    for name, bound in system.named:
        body = bound.body if isinstance(bound, BoundContact) else None
        if body is not None and body.moves:
            values = each(partial(_place, body, system.cloth.extent))
            words = f"the motion of {name}"
            yield Signal(words, values, FUNCTIONS, kind="obstacle", **of_run)
        for attribute, values, effort in _of_term(bound.here(), start):
            kind = "tether" if isinstance(bound, BoundTether) else "load"
            yield Signal(f"{attribute} of {name}", values, effort, kind=kind, **of_run)


def name_motion(pin: str) -> str:
    return f"the motion of the pin {pin!r}"


def _place(body: Shape, size: float, t: float) -> np.ndarray:
    """Return the displacement of a body, and the ends of three arms of `size` that turn (4, 3)."""
    pose = body.pose(t)
    return np.vstack([pose.u, size * pose.R])


def _of_term(bound, state: State) -> Iterator[tuple[str, Values, Effort]]:
    """Yield the name, the values and their effort of what depends on time in a term."""
    is_force = not type(bound).__module__.startswith("fecloth.")
    for value in _fields(bound):
        value = value.value if isinstance(value, Uniform) else value
        if isinstance(value, TimeFunction):
            is_force = False
            if callable(value.parts):
                yield value.name, each(value), FUNCTIONS
            elif _has_time(value.parts):
                yield value.name, _formulas(value.parts), FORMULAS
        elif isinstance(value, Field | Gusts):
            is_force = False
            yield from _of_air(value, _few(state.x))
    if isinstance(bound, BoundUserForce) and isinstance(bound.function, FormulaForce):
        if _has_time(bound.function.parts):
            columns = (*bound.function.X.T, *state.x.T, *state.v.T)
            place = dict(zip(VARIABLES, map(_few, columns), strict=False))
            yield "the force", _formulas(bound.function.parts, **place), PLACES
    elif is_force or isinstance(bound, BoundUserForce):
        yield "the force", each(lambda t: _force(bound, state, t)), FORCES


def _of_air(air: Field | Gusts, x: np.ndarray) -> Iterator[tuple[str, Values, Effort]]:
    """Yield the velocity of the air at positions x (k, 3) if it depends on time."""
    if not (isinstance(air, Field) and isinstance(air.function, Formulas)):
        yield "the air velocity", each(lambda t: air.velocity(x, t)), FORCES
    elif _has_time(air.function.parts):
        values = _formulas(air.function.parts, x=x[:, 0], y=x[:, 1], z=x[:, 2])
        yield "the air velocity", values, PLACES


def _fields(bound) -> Iterator[object]:
    if is_dataclass(bound):
        yield from (getattr(bound, field.name) for field in fields(bound))


def _has_time(parts) -> bool:
    return any(isinstance(p, Formula) and re.search(r"\bt\b", p.text) for p in parts)


def _motion(motion: Motion) -> Values:
    """Return the displacement at times, of a few nodes where it differs by node."""
    if not motion.by_place or motion.X is None:
        return motion
    few = replace(motion, X=_few(motion.X))
    return lambda times: few(times).reshape(len(times), -1)


def _force(bound, state: State, t: float) -> np.ndarray:
    f = np.zeros_like(state.x)
    bound.add_force(state.x, state.v, t, f)
    return _few(f)


def _few(values: np.ndarray) -> np.ndarray:
    """Return the values at up to MOST_NODES of the nodes."""
    return values[:: max(1, -(-len(values) // MOST_NODES))]


def _formulas(parts, **place: np.ndarray) -> Values:
    """Return numbers and formulas as a function of times, at the same time or at k places (k,)."""

    def values(t: np.ndarray) -> np.ndarray:
        given = place | {"t": t[:, None]}
        columns = [np.atleast_2d(p(**given) if isinstance(p, Formula) else p) for p in parts]
        return np.concatenate([np.broadcast_to(c, (len(t), c.shape[1])) for c in columns], axis=1)

    return values


def each(function: Callable) -> Values:
    """Return the function of times that calls a function of one time for each."""
    return lambda times: np.stack([np.ravel(function(float(t))) for t in times])
