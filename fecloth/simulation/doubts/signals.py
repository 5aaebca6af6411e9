"""Motions of pins and obstacles, loads, and users' forces: functions of time, sampled once."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from fecloth.quantities.formula import Formula
from fecloth.quantities.time_function import TimeFunction
from fecloth.simulation.within_step import uneven
from fecloth.system.pins import Motion, Pin
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.contact.shape import Shape
from fecloth.terms.custom.force import VARIABLES, BoundUserForce, FormulaForce
from fecloth.terms.loads.air_velocity import Field, Formulas, Gusts, Uniform
from fecloth.terms.springs.tether import BoundTether

# Over the largest value of a signal; a smaller change is round-off of the user's function.
ROUND_OFF_OF_SIGNAL = 1e-9
MOST_NODES = 16  # at which a force on all nodes is compared: each costs an evaluation

Values = Callable[[np.ndarray], np.ndarray]  # function of times (m,) that returns (m, k)
Span = tuple[float, float]  # start and end of a run [s]


class Effort(NamedTuple):
    """How often something may be evaluated before a run.

    Attributes
    ----------
    most
        Number of times in all, and of the even times of a run that chooses its steps.
    even
        Number of the even times of a run with fixed steps.
    inside
        Times inside a step, as parts of it. They are uneven: no oscillation is zero at all.
    """

    most: int
    even: int
    inside: np.ndarray


FORMULAS = Effort(most=2**17, even=2**13 + 1, inside=uneven(64))  # of time
PLACES = Effort(most=2**15, even=2**13 + 1, inside=uneven(32))  # the same at MOST_NODES
FUNCTIONS = Effort(most=2**13, even=2**10 + 1, inside=uneven(16))
FORCES = Effort(most=2**8, even=2**8, inside=uneven(5))  # of all nodes, by a function


@dataclass(frozen=True, eq=False)
class Signal:
    """A motion or a load that depends on time, with its samples.

    Attributes
    ----------
    name
        What a warning calls it.
    values
        Its values (m, k) as a function of times (m,).
    effort
        How often it may be evaluated.
    span
        Start and end of the run [s].
    is_fixed
        Whether the steps of the run have a fixed size.
    kind
        What moves so: "pin", "obstacle" or "tether"; or "load".
    is_smooth
        Whether it is known to have no jumps.
    """

    name: str
    values: Values
    effort: Effort
    span: Span
    is_fixed: bool
    kind: str
    is_smooth: bool = False

    @property
    def moves(self) -> bool:
        """Whether it is a motion; a uniform motion counts as none."""
        return self.kind != "load"

    @cached_property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Even times (m,) [s] from the start to the end, and the values there (m, k)."""
        number = self.effort.even if self.is_fixed else self.effort.most
        times = np.linspace(*self.span, number)
        return times, np.asarray(self.values(times), float).reshape(len(times), -1)


def find_signals(system: System, start: State, t_end: float, is_fixed: bool) -> Iterator[Signal]:
    """Yield what moves pins, obstacles and tethers, the loads, and forces of users' terms.

    `start` is the state before the first step of the run, `t_end` its end [s], and `is_fixed`
    says whether its steps have a fixed size.
    """
    of_run: dict[str, Any] = {"span": (start.t, t_end), "is_fixed": is_fixed}
    size = system.cloth.extent
    for name, (pin, _) in system.constraints.groups.items():
        if pin.moves:
            values, effort = _of_pin(pin, size)
            is_smooth = (
                isinstance(pin.motion, Motion)
                and pin.rotate is None
                and _are_smooth(pin.motion.formulas)
            )
            words = name_motion(name)
            yield Signal(words, values, effort, kind="pin", is_smooth=is_smooth, **of_run)
    for name, bound in system.named:
        if isinstance(bound, BoundContact) and bound.body is not None and bound.body.moves:
            values = at_each_time(partial(_place, bound.body, size))
            words = f"the motion of {name}"
            yield Signal(words, values, FUNCTIONS, kind="obstacle", **of_run)
        kind = "tether" if isinstance(bound, BoundTether) else "load"
        for attribute, values, effort, is_smooth in _of_term(bound.here(), start):
            words = f"{attribute} of {name}"
            yield Signal(words, values, effort, kind=kind, is_smooth=is_smooth, **of_run)


def _of_pin(pin: Pin, size: float) -> tuple[Values, Effort]:
    """Return the motion of a pin, and its effort; `size` is the extent of the cloth [m]."""
    if not isinstance(pin.motion, Motion) or pin.rotate is not None:
        return at_each_time(partial(pin.sample, size=size)), FUNCTIONS
    effort = PLACES if pin.motion.by_place else FORMULAS
    return _motion(pin.motion), effort


def name_motion(pin: str) -> str:
    """Return what a warning calls the motion of a pin."""
    return f"the motion of the pin {pin!r}"


def _place(body: Shape, size: float, t: float) -> np.ndarray:
    """Return (4, 3) the displacement of a body, and the ends of three arms that turn with it."""
    pose = body.pose(t)
    return np.vstack([pose.u, size * pose.R])


def _of_term(bound, state: State) -> Iterator[tuple[str, Values, Effort, bool]]:
    """Yield the name, the values and their effort of what depends on time in a term.

    The fourth is whether it is smooth.
    """
    is_force = not type(bound).__module__.startswith("fecloth.")
    for value in _fields(bound):
        if isinstance(value, Uniform):
            value = value.value
        if isinstance(value, TimeFunction):
            is_force = False
            if callable(value.parts):
                yield value.name, at_each_time(value), FUNCTIONS, False
            elif _has_time(value.parts):
                is_smooth = _are_smooth(value.parts)
                yield value.name, _formulas(value.parts), FORMULAS, is_smooth
        elif isinstance(value, Field | Gusts):
            is_force = False
            yield from _of_air(value, _few(state.x))
    if isinstance(bound, BoundUserForce) and isinstance(bound.function, FormulaForce):
        if _has_time(bound.function.parts):
            columns = (*bound.function.X.T, *state.x.T, *state.v.T)
            place = dict(zip(VARIABLES, map(_few, columns), strict=False))
            values = _formulas(bound.function.parts, **place)
            effort = PLACES if _has_place(bound.function.parts) else FORMULAS
            yield "the force", values, effort, _are_smooth(bound.function.parts)
    elif is_force or isinstance(bound, BoundUserForce):
        yield "the force", at_each_time(lambda t: _force(bound, state, t)), FORCES, False


def _of_air(air: Field | Gusts, x: np.ndarray) -> Iterator[tuple[str, Values, Effort, bool]]:
    """Yield the velocity of the air at positions x (k, 3) if it depends on time; see `_of_term`."""
    if not (isinstance(air, Field) and isinstance(air.function, Formulas)):
        # gusts are sums of waves
        is_smooth = isinstance(air, Gusts)
        yield "the air velocity", at_each_time(lambda t: air.velocity(x, t)), FORCES, is_smooth
    elif _has_time(air.function.parts):
        values = _formulas(air.function.parts, x=x[:, 0], y=x[:, 1], z=x[:, 2])
        yield "the air velocity", values, PLACES, _are_smooth(air.function.parts)


def _fields(bound) -> Iterator[object]:
    """Yield the values of the fields of a dataclass; nothing for any other object."""
    if is_dataclass(bound):
        yield from (getattr(bound, field.name) for field in fields(bound))


def _are_smooth(parts) -> bool:
    """Return whether all formulas among the parts are smooth."""
    return all(part.is_smooth for part in parts if isinstance(part, Formula))


def _has_time(parts) -> bool:
    """Return whether a formula among the parts has the variable t."""
    formulas = (part for part in parts if isinstance(part, Formula))
    return any(re.search(r"\bt\b", formula.text) for formula in formulas)


def _has_place(parts) -> bool:
    """Return whether a formula among the parts has other variables than t."""
    others = "|".join(name for name in VARIABLES if name != "t")
    formulas = (part for part in parts if isinstance(part, Formula))
    return any(re.search(rf"\b({others})\b", formula.text) for formula in formulas)


def _motion(motion: Motion) -> Values:
    """Return the displacement at times, of a few nodes where it differs by node."""
    if not motion.by_place or motion.X is None:
        return motion
    few = replace(motion, X=_few(motion.X))
    return lambda times: few(times).reshape(len(times), -1)


def _force(bound, state: State, t: float) -> np.ndarray:
    """Return the force of a term at a time, on a few of the nodes."""
    f = np.zeros_like(state.x)
    bound.add_force(state.x, state.v, t, f)
    return _few(f)


def _few(values: np.ndarray) -> np.ndarray:
    """Return the values at up to MOST_NODES of the nodes."""
    return values[:: max(1, -(-len(values) // MOST_NODES))]


def _formulas(parts, **place: np.ndarray) -> Values:
    """Return numbers and formulas as a function of times, at k places (k,) if these are given."""

    def values(t: np.ndarray) -> np.ndarray:
        given = place | {"t": t[:, None]}
        columns = []
        for part in parts:
            value = part(**given) if isinstance(part, Formula) else part
            column = np.atleast_2d(value)
            columns.append(np.broadcast_to(column, (len(t), column.shape[1])))
        return np.concatenate(columns, axis=1)

    return values


def at_each_time(function: Callable) -> Values:
    """Return the function of times (m,) that calls `function`, of one time, for each."""
    return lambda times: np.stack([np.ravel(function(float(t))) for t in times])
