"""Values that a user gives as a number, as a formula in text, or as a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fecloth.errors import InputError
from fecloth.quantities.formula import Formula

OfTime = float | str | Callable[[float], float]
VectorOfTime = tuple[float | str, float | str, float | str] | Callable[[float], np.ndarray]


@dataclass(frozen=True)
class Timed:
    """A value that changes in time, as `add_force` needs it: ``timed(t)``, always finite.

    Attributes
    ----------
    parts
        A function of t, or numbers and formulas.
    shape
        Of the value; () for a number.
    name, where
        What errors call it, as in "Pressure: p(0.3) = nan".
    """

    parts: Callable | tuple
    shape: tuple[int, ...]
    name: str
    where: str

    def __call__(self, t: float) -> np.ndarray:
        if callable(self.parts):
            value = np.asarray(self.parts(t), dtype=float)
        else:
            values = [part(t=t) if isinstance(part, Formula) else part for part in self.parts]
            value = np.array(values, dtype=float).reshape(self.shape)
        if value.shape != self.shape or not np.isfinite(value).all():
            allowed = "must be finite" + (f" and of shape {self.shape}" if self.shape else "")
            raise InputError(f"{self.name}({t:g}) = {value!r}", allowed, self.where)
        return value


def scalar(value: OfTime, name: str, where: str) -> Timed:
    """A number, a formula of t, or a function of t.

    Examples
    --------
    >>> float(scalar("3 * t", "p", "Pressure")(2.0)), float(scalar(5.0, "p", "Pressure")(2.0))
    (6.0, 5.0)
    """
    return Timed(value if callable(value) else (_part(value, name, where),), (), name, where)


def vector(value: VectorOfTime, name: str, where: str) -> Timed:
    """Three numbers or formulas of t, or a function of t that returns three numbers.

    Examples
    --------
    >>> vector((1.0, "2 * t", 0), "force", "PointForce")(0.5)
    array([1., 1., 0.])
    """
    if callable(value):
        return Timed(value, (3,), name, where)
    if isinstance(value, str) or np.ndim(np.asarray(value, dtype=object)) != 1 or len(value) != 3:
        allowed = "must be three numbers or formulas of t, or a function of t"
        raise InputError(f"{name} = {value!r}", allowed, where)
    return Timed(tuple(_part(part, name, where) for part in value), (3,), name, where)


def _part(value, name: str, where: str) -> float | Formula:
    if isinstance(value, str):
        try:
            return Formula(value, ("t",))
        except InputError as error:
            raise InputError(f"{name}: {error.what}", error.allowed, where, error.remedy) from None
    if isinstance(value, bool) or not np.isscalar(value) or not np.isfinite(value):
        allowed = "must be a finite number, a formula of t, or a function of t"
        raise InputError(f"{name} = {value!r}", allowed, where)
    return float(value)
