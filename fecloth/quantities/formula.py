"""Arithmetic written as text, as "0.1*sin(2*pi*t)": parsed once, never executed as code."""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fecloth.compiled.calls import Call
from fecloth.errors import InputError
from fecloth.quantities.formula_functions import is_smooth
from fecloth.quantities.formula_syntax import parse
from fecloth.quantities.formula_tape import Program, Tape
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
            _ = self._program  # parsed and checked now, not at the first call
        elif self.condition:
            what = f"the derivative of the condition {self.text!r}"
            raise InputError(what, "only numbers have one", "Formula")
        for variable in self.by:
            known(f"derivative by {variable!r}", variable, self.variables, "Formula")

    @cached_property
    def _program(self) -> Program:
        return _compile((self,))

    def __reduce__(self) -> tuple[Any, ...]:
        return Formula, (self.text, self.variables, self.condition, self.by)

    def __call__(self, **values: ArrayLike) -> float | np.ndarray:
        """Return the value at the variables by name: a float if all are scalars, else an array.

        Arrays of different shapes are broadcast against each other. Raises `InputError` for a
        value that is not finite.
        """
        arrays = [np.asarray(values[name], dtype=float) for name in self.variables]
        shape = np.broadcast_shapes(*(array.shape for array in arrays))
        rows = np.empty((len(arrays), *shape))
        for row, array in enumerate(arrays):
            rows[row] = array
        value = self._checked(rows.reshape(len(arrays), math.prod(shape)))
        if shape:
            return value.reshape(shape)
        number: float = value.item()
        return number

    def at(self, *numbers: float) -> float:
        """Return the value at one float for each variable, in their order; faster than a call.

        Raises `InputError` for a value that is not finite.
        """
        number: float = self._checked(np.array(numbers, float).reshape(-1, 1)).item()
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

    def write(self, tape: Tape) -> int:
        """Write the formula to a list of instructions; return the number of its value."""
        names = {name: tape.variable(row) for row, name in enumerate(self.variables)}
        output = tape.write(_parse(self.text, self.variables, self.condition), names)
        for variable in self.by:
            output = tape.derive(output, self.variables.index(variable))
        return output

    def _checked(self, variables: np.ndarray) -> np.ndarray:
        """Return the values (m,) at the variables (v, m); raise `InputError` as a call does."""
        values = self._program(variables)[:, 0]
        self.check(values, variables)
        if self.condition:
            values = values != 0.0
        return values

    def check(self, values: np.ndarray, variables: np.ndarray) -> None:
        """Raise `InputError` if a value (m,) at the variables (v, m) is not finite."""
        finite = np.isfinite(values)
        if finite.all():
            return
        first = int(np.argmin(finite))
        what = f"formula {self.text!r} is {values[first]:g}"
        if self.by:
            what = f"the derivative by {' and '.join(self.by)} of {what}"
        if self.variables:
            pairs = zip(self.variables, variables[:, first], strict=True)
            what += " at " + ", ".join(f"{name} = {number:g}" for name, number in pairs)
        raise InputError(what, "must be finite", "Formula")


Part = float | Formula


@dataclass(frozen=True)
class FormulaVector:
    """A vector whose components are numbers and formulas of the same variables.

    Attributes
    ----------
    parts
        The k components.
    """

    parts: tuple[Part, ...]

    @cached_property
    def _program(self) -> Program:
        return _compile(self.parts)

    def __call__(self, variables: np.ndarray) -> np.ndarray:
        """Values (m, k) at the variables (v, m), of which a row belongs to each variable.

        Raises `InputError` for a value that is not finite.
        """
        values = self._program(variables)
        if not np.isfinite(values).all():
            for part, column in zip(self.parts, values.T, strict=True):
                if isinstance(part, Formula):
                    part.check(column, variables)
        return values

    def derivative(self, variable: str) -> "FormulaVector":
        """Return the vector of the derivatives by a variable."""
        return FormulaVector(
            tuple(
                part.derivative(variable) if isinstance(part, Formula) else 0.0
                for part in self.parts
            )
        )

    def call(self, variables: np.ndarray, values: np.ndarray) -> Call:
        """Return the compiled call that writes the values (m, k) at the variables (v, m).

        It reads the variables when it is made. It does not refuse values that are not finite.
        """
        return self._program.call(variables, values)


_parse = lru_cache(maxsize=256)(parse)


@lru_cache(maxsize=256)
def _compile(parts: tuple[Part, ...]) -> Program:
    """Return the program of numbers and formulas of the same variables."""
    tape = Tape()
    outputs = [
        part.write(tape) if isinstance(part, Formula) else tape.constant(part) for part in parts
    ]
    return Program.assemble(tape, outputs)
