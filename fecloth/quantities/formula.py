"""Arithmetic written as text, e.g. "0.1*sin(2*pi*t)": parsed once, and never executed as code."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from fecloth.errors import InputError
from fecloth.quantities.formula_functions import ARRAYS, NUMBERS, Closure, compile_tree
from fecloth.quantities.formula_syntax import derivative, parse

_NUMBERS = {float, int, np.float64}


@dataclass(frozen=True)
class Formula:
    """A formula of named variables: a number, or a condition such as ``"X < 0.01 and Y > 1"``.

    It may contain numbers, the variables, pi, ``+ - * / % **``, and the functions sin cos tan tanh
    exp log sqrt abs sign floor min(a, b) max(a, b) mod(a, b) where(condition, a, b)
    smoothstep(a, b, t); mod(a, b) is a % b, a − b floor(a/b).
    Only conditions may contain comparisons ``< <= > >=``, joined by and, or, not. All arithmetic
    is in double precision.

    Parameters
    ----------
    text
        The formula, at most 500 characters.
    variables
        Names that it may use.
    condition
        Whether the value must be true or false instead of a number.
    """

    text: str
    variables: tuple[str, ...] = ()
    condition: bool = False
    by: tuple[str, ...] = ()  # what is meant is the derivative by one of these after the other

    def __post_init__(self) -> None:
        if not self.by:
            _ = self._value  # parsed and checked now, not at the first call
        elif self.condition:
            what = f"the derivative of the condition {self.text!r}"
            raise InputError(what, "only numbers have one", "Formula")
        for variable in self.by:
            if variable not in self.variables:
                allowed = f"must be one of {', '.join(self.variables) or '(none)'}"
                raise InputError(f"derivative by {variable!r}", allowed, "Formula")

    @cached_property
    def _value(self) -> "_CompiledFormula":
        return _compile(self.text, self.variables, self.condition, self.by)

    def __reduce__(self) -> tuple[Any, ...]:
        return Formula, (self.text, self.variables, self.condition, self.by)

    def __call__(self, **values: ArrayLike) -> float | np.ndarray:
        """Value at the variables, broadcast against each other; a float if all are scalars."""
        return self._value(values)

    def at(self, *numbers: float) -> float:
        """Value at one float for each variable, in their order: in a third of a call's time."""
        return self._value.at(numbers)

    def derivative(self, variable: str) -> "Formula":
        """The exact derivative by a variable, to be called as the formula itself."""
        # On a kink or a jump it is the derivative on one side of it, and 0 for abs at 0. A value
        # that is not finite is refused.
        return replace(self, by=(*self.by, variable))


@dataclass(frozen=True)
class _CompiledFormula:
    """The closures of a formula, or of a derivative, and what errors call it."""

    name: str
    variables: tuple[str, ...]
    of_numbers: Closure
    of_arrays: Closure

    def __call__(self, values: Mapping[str, Any]) -> float | np.ndarray:
        given = [values[name] for name in self.variables]
        if _NUMBERS.issuperset(map(type, given)):
            return self.at([*map(float, given)])
        value: float | np.ndarray = self._of_arrays(given)
        return value

    def at(self, numbers: Sequence[float]) -> float:
        try:
            value: float = self.of_numbers(numbers)
            if math.isfinite(value):
                return value
        except (ArithmeticError, ValueError):  # a part of it is not finite
            pass
        value = self._of_arrays(numbers)
        return value

    def _of_arrays(self, given: Sequence[ArrayLike]) -> Any:
        """A float, or the truth of a condition, if all are scalars; else an array."""
        arrays = [np.asarray(each, dtype=float) for each in given]
        shape = np.broadcast_shapes(*(array.shape for array in arrays))
        with np.errstate(all="ignore"):
            value = np.broadcast_to(self.of_arrays(arrays), shape)
        finite = np.isfinite(value)
        if not finite.all():
            self._refuse(value, tuple(np.argwhere(~finite)[0]), arrays)
        return value.copy() if shape else value.item()

    def _refuse(
        self, value: np.ndarray, place: tuple[np.intp, ...], arrays: list[np.ndarray]
    ) -> NoReturn:
        numbers = [float(np.broadcast_to(array, value.shape)[place]) for array in arrays]
        pairs = zip(self.variables, numbers, strict=True)
        at = ", ".join(f"{name} = {number:g}" for name, number in pairs)
        what = f"{self.name} is {value[place]:g}" + (f" at {at}" if at else "")
        raise InputError(what, "must be finite", "Formula")


_parse = lru_cache(maxsize=256)(parse)


@lru_cache(maxsize=256)
def _compile(
    text: str, variables: tuple[str, ...], condition: bool, by: tuple[str, ...]
) -> _CompiledFormula:
    tree, name = _parse(text, variables, condition), f"formula {text!r}"
    for variable in by:
        tree = derivative(tree, variable)
    if by:
        name = f"the derivative by {' and '.join(by)} of formula {text!r}"
    closures = (compile_tree(tree, variables, kit) for kit in (NUMBERS, ARRAYS))
    return _CompiledFormula(name, variables, *closures)
