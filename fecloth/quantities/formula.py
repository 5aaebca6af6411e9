"""Arithmetic written as text, as "0.1*sin(2*pi*t)": parsed once, never executed as code."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fecloth.errors import InputError
from fecloth.quantities.formula_functions import Closure, compile_tree, derivative, is_smooth
from fecloth.quantities.formula_syntax import parse
from fecloth.validation import known


@dataclass(frozen=True)
class Formula:
    """A formula of named variables: a number, or a condition such as ``"X < 0.01 and Y > 1"``.

    It may contain numbers, the variables, pi, ``+ - * / % **``, and the functions sin cos tan
    tanh exp log sqrt abs sign floor min(a, b) max(a, b) mod(a, b) where(condition, a, b)
    smoothstep(a, b, t); mod(a, b) is a % b, a − b floor(a/b). Only conditions may contain
    comparisons ``< <= > >=``, joined by and, or, not. All arithmetic is in double precision.

    Parameters
    ----------
    text
        The formula, at most 500 characters.
    variables
        Names that it may use.
    condition
        Whether the value must be true or false instead of a number.
    by
        The object is the derivative of the formula by these variables, one after the other.
    """

    text: str
    variables: tuple[str, ...] = ()
    condition: bool = False
    by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise `InputError` for a text that is not a formula, or an unknown variable in `by`."""
        if not self.by:
            _ = self._value  # parsed and checked now, not at the first call
        elif self.condition:
            what = f"the derivative of the condition {self.text!r}"
            raise InputError(what, "only numbers have one", "Formula")
        for variable in self.by:
            known(f"derivative by {variable!r}", variable, self.variables, "Formula")

    @cached_property
    def _value(self) -> Closure:
        return _compile(self.text, self.variables, self.condition, self.by)

    def __reduce__(self) -> tuple[Any, ...]:
        return Formula, (self.text, self.variables, self.condition, self.by)

    def __call__(self, **values: ArrayLike) -> float | np.ndarray:
        """Return the value at the variables by name: a float if all are scalars, else an array.

        Arrays of different shapes are broadcast against each other. Raises `InputError` for a
        value that is not finite.
        """
        arrays = [np.asarray(values[name], dtype=float) for name in self.variables]
        shape = np.broadcast_shapes(*(array.shape for array in arrays))
        if not shape:
            return self.at(*map(float, arrays))
        with np.errstate(all="ignore"):  # values that are not finite are refused below
            value = np.broadcast_to(self._value(arrays), shape)
        finite = np.isfinite(value)
        if not finite.all():
            first_bad = tuple(np.argwhere(~finite)[0])
            numbers = [np.broadcast_to(array, shape)[first_bad] for array in arrays]
            raise self._error(value[first_bad], numbers)
        return value.copy()  # what `broadcast_to` returns cannot be written to

    def at(self, *numbers: float) -> float:
        """Return the value at one float for each variable, in their order; faster than a call.

        Raises `InputError` for a value that is not finite.
        """
        with np.errstate(all="ignore"):
            value = self._value([*map(np.float64, numbers)])
        if not math.isfinite(value):
            raise self._error(value, numbers)
        number: float = value.item()
        return number

    @property
    def is_smooth(self) -> bool:
        """Whether it consists of smooth functions only, so that it jumps nowhere."""
        return is_smooth(_parse(self.text, self.variables, self.condition))

    def derivative(self, variable: str) -> "Formula":
        """Return the exact derivative by a variable, as a formula.

        On a kink or a jump it is the derivative on one side of it, and 0 for abs at 0.
        """
        return replace(self, by=(*self.by, variable))

    def _error(self, value: float, numbers: Sequence[float]) -> InputError:
        """Return the error for a value at these numbers that is not finite."""
        what = f"formula {self.text!r} is {value:g}"
        if self.by:
            what = f"the derivative by {' and '.join(self.by)} of {what}"
        if self.variables:
            pairs = zip(self.variables, numbers, strict=True)
            what += " at " + ", ".join(f"{name} = {number:g}" for name, number in pairs)
        return InputError(what, "must be finite", "Formula")


_parse = lru_cache(maxsize=256)(parse)


@lru_cache(maxsize=256)
def _compile(
    text: str, variables: tuple[str, ...], condition: bool, by: tuple[str, ...]
) -> Closure:
    closure = compile_tree(_parse(text, variables, condition), variables, bool(by))
    for level, variable in enumerate(by):
        closure = derivative(closure, variables.index(variable), level)
    return closure
