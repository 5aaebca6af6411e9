"""Values that a user writes as a number, as a formula of t in text, or as a function of time."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fecloth.errors import InputError, errors_of
from fecloth.quantities.formula import Formula

OfTime = float | str | Callable[[float], float]
VectorOfTime = tuple[float | str, float | str, float | str] | Callable[[float], np.ndarray]

DIFFERENCE_STEP = 1e-5  # s; the difference quotient of a function is then good to about 1e-10


@dataclass(frozen=True)
class TimeFunction:
    """A value that changes in time, ``value(t)``, always finite."""

    # A function of t, or numbers and formulas.
    parts: Callable[[float], ArrayLike] | tuple[float | Formula, ...]
    shape: tuple[int, ...]  # shape of the value; () for a number
    # What errors call it, as in "Pressure: p(0.3) = nan".
    name: str
    where: str

    def __call__(self, t: float) -> np.ndarray:
        if callable(self.parts):
            given = self.parts(t)
        else:
            given = [_at(part, t) for part in self.parts]
        value = np.asarray(given, dtype=float)
        value = value if callable(self.parts) else value.reshape(self.shape)
        if value.shape != self.shape or not np.isfinite(value).all():
            allowed = "must be finite" + (f" and of shape {self.shape}" if self.shape else "")
            raise InputError(f"{self.name}({t:g}) = {value!r}", allowed, self.where)
        return value

    @property
    def is_constant(self) -> bool:
        """Whether it is made of numbers alone."""
        return not callable(self.parts) and all(isinstance(part, float) for part in self.parts)

    def rate(self, t: float) -> np.ndarray:
        """The derivative by t: exact for formulas, a central difference of a function."""
        if not callable(self.parts):
            with suppress(InputError):
                return np.array([_at(rate, t) for rate in self._rates]).reshape(self.shape)
        return difference_quotient(self, t)

    @cached_property
    def _rates(self) -> list[float | Formula]:
        parts = () if callable(self.parts) else self.parts
        return [part.derivative("t") if isinstance(part, Formula) else 0.0 for part in parts]


def difference_quotient(
    function: Callable[[float], Any], t: float, since: float = -math.inf
) -> np.ndarray:
    """The derivative of a function of time by differences of second order, over 2e-5 s.

    It is central, (u(t + h) − u(t − h))/(2h), but (−3 u(t) + 4 u(t + h) − u(t + 2h))/(2h) where
    t − h is before `since`.
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
    """A number, a formula of t, or a function of t."""
    return TimeFunction(value if callable(value) else (_part(value, name, where),), (), name, where)


def vector(value: VectorOfTime, name: str, where: str) -> TimeFunction:
    """Three numbers or formulas of t, or a function of t that returns three numbers."""
    if callable(value):
        return TimeFunction(value, (3,), name, where)
    if isinstance(value, str) or np.ndim(np.asarray(value, dtype=object)) != 1 or len(value) != 3:
        allowed = "must be three numbers or formulas of t, or a function of t"
        raise InputError(f"{name} = {value!r}", allowed, where)
    return TimeFunction(tuple(_part(part, name, where) for part in value), (3,), name, where)


def _part(value: object, name: str, where: str) -> float | Formula:
    if isinstance(value, str):
        with errors_of(where, f"{name}: "):
            return Formula(value, ("t",))
    if isinstance(value, bool) or not np.isscalar(value) or not np.isfinite(value):
        allowed = "must be a finite number, a formula of t, or a function of t"
        raise InputError(f"{name} = {value!r}", allowed, where)
    return float(value)  # type: ignore[arg-type]  # NumPy's scalars contain text and complex


def _at(part: float | Formula, t: float) -> float:
    if isinstance(part, float):
        return part
    return part.at(float(t))
