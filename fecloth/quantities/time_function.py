"""Values that a user writes as a number, as a formula of t in text, or as a function of time."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fecloth.compiled.calls import Calls
from fecloth.errors import InputError, errors_of
from fecloth.quantities.formula import Formula, FormulaVector

OfTime = float | str | Callable[[float], float]
VectorOfTime = tuple[float | str, float | str, float | str] | Callable[[float], np.ndarray]

# Step of difference quotients [s]: about the cube root of the round-off of a double. There their
# error is least, about 1e-10.
DIFFERENCE_STEP = 1e-5


@dataclass(frozen=True)
class TimeFunction:
    """A value that changes in time, ``value(t)``.

    A value that is not finite, or of another shape, raises `InputError`.

    Attributes
    ----------
    parts
        A function of t [s], or numbers and formulas of t.
    shape
        Shape of the value; () for a number.
    name, where
        Names of the value and of its place in messages, as in "Pressure: p(0.3) = nan".
    """

    parts: Callable[[float], ArrayLike] | tuple[float | Formula, ...]
    shape: tuple[int, ...]
    name: str
    where: str

    def __call__(self, t: float) -> np.ndarray:
        """Return the value at the time t [s], an array of the shape `shape`.

        Raises `InputError` for a value that is not finite, or of another shape.
        """
        if callable(self.parts):
            value = np.asarray(self.parts(t), dtype=float)
        else:
            with errors_of(self.where, f"{self.name}: "):
                value = _at(self._components, t).reshape(self.shape)
        if value.shape != self.shape or not np.isfinite(value).all():
            allowed = "must be finite" + (f" and of shape {self.shape}" if self.shape else "")
            raise InputError(f"{self.name}({t:g}) = {value!r}", allowed, self.where)
        return value

    @property
    def is_constant(self) -> bool:
        """Whether all parts are numbers."""
        return not callable(self.parts) and all(isinstance(part, float) for part in self.parts)

    def rate(self, t: float) -> np.ndarray:
        """Return the derivative by t [1/s].

        It is exact for formulas. For a function, and where the derivative of a formula is not
        finite, it is a central difference.
        """
        if not callable(self.parts):
            with suppress(InputError):
                return _at(self._rates, t).reshape(self.shape)
        return difference_quotient(self, t)

    def calls(self, t: np.ndarray, value: np.ndarray) -> Calls | None:
        """Return the compiled calls that write the value at the time t (1,) [s] to an array.

        They read t when they are made, and do not refuse a value that is not finite. None for a
        function of Python.
        """
        if callable(self.parts):
            return None
        return [self._components.call(t.reshape(1, 1), value.reshape(1, -1))]

    @cached_property
    def _components(self) -> FormulaVector:
        assert not callable(self.parts)
        return FormulaVector(self.parts)

    @cached_property
    def _rates(self) -> FormulaVector:
        """The derivative by t of each part, if the parts are numbers and formulas."""
        return self._components.derivative("t")


def difference_quotient(
    function: Callable[[float], Any], t: float, since: float = -math.inf
) -> np.ndarray:
    """Return the derivative of a function u of time by differences of second order.

    With h = 1e-5 s it is the central difference (u(t + h) − u(t − h))/(2h). If t − h is before
    the time `since` [s], at which u begins, it is (−3 u(t) + 4 u(t + h) − u(t + 2h))/(2h).
    """
    u = function
    h = DIFFERENCE_STEP
    if t - h >= since:
        difference = u(t + h) - u(t - h)
    else:
        difference = 4 * u(t + h) - 3 * u(t) - u(t + 2 * h)
    rate: np.ndarray = difference / (2 * h)
    return rate


def scalar(value: OfTime, name: str, where: str) -> TimeFunction:
    """Make a function of time from a number, a formula of t [s], or a function of t.

    Raises `InputError`, with the names `name` and `where`, for another value.
    """
    if callable(value):
        return TimeFunction(value, (), name, where)
    return TimeFunction((_part(value, name, where),), (), name, where)


def vector(value: VectorOfTime, name: str, where: str) -> TimeFunction:
    """Make a vector of time from three numbers or formulas of t [s], or a function of t.

    A function must return three numbers, which is checked at each call. Raises `InputError`,
    with the names `name` and `where`, for another value.
    """
    if callable(value):
        return TimeFunction(value, (3,), name, where)
    # As objects, because numbers and texts may be mixed.
    is_list = np.ndim(np.asarray(value, dtype=object)) == 1 and not isinstance(value, str)
    if not is_list or len(value) != 3:
        allowed = "must be three numbers or formulas of t, or a function of t"
        raise InputError(f"{name} = {value!r}", allowed, where)
    parts = tuple(_part(part, name, where) for part in value)
    return TimeFunction(parts, (3,), name, where)


def _part(value: object, name: str, where: str) -> float | Formula:
    """Return a number or a formula of t from one part of a value; else raise `InputError`."""
    if isinstance(value, str):
        with errors_of(where, f"{name}: "):
            return Formula(value, ("t",))
    if isinstance(value, bool) or not np.isscalar(value) or not np.isfinite(value):
        allowed = "must be a finite number, a formula of t, or a function of t"
        raise InputError(f"{name} = {value!r}", allowed, where)
    return float(value)  # type: ignore[arg-type]  # NumPy's scalars contain text and complex


def _at(components: FormulaVector, t: float) -> np.ndarray:
    """Values (1, k) of numbers and formulas of t."""
    return components(np.array([[t]], float))
