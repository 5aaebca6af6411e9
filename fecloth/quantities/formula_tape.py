"""Formulas as lists of instructions, and their exact derivatives."""

import ast
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from typing import NamedTuple, Self

import numpy as np

from fecloth.compiled.calls import Call
from fecloth.quantities.formula_functions import (
    BINARY,
    BOOLEAN,
    CHOICES,
    COMPARE,
    CONSTANTS,
    FUNCTIONS,
    PARTIALS,
    UNARY,
)
from fecloth.quantities.formula_kernel import Operation, evaluate

OPERANDS = "abc"  # their names in the texts of derivatives


class Instruction(NamedTuple):
    """An operation on the results of earlier instructions.

    Attributes
    ----------
    operation
        What is done.
    operands
        Numbers of up to three earlier instructions; of a constant its value, and of a variable
        its row.
    """

    operation: Operation
    operands: tuple[float, ...]


class Tape:
    """A growing list of instructions; a result that is there already is not computed again."""

    def __init__(self) -> None:
        self.instructions: list[Instruction] = []
        self._numbers: dict[Instruction, int] = {}

    def add(self, operation: Operation, *operands: float) -> int:
        """Return the number of an instruction, which is new unless the list has the same."""
        instruction = Instruction(operation, operands)
        if instruction not in self._numbers:
            self._numbers[instruction] = len(self.instructions)
            self.instructions.append(instruction)
        return self._numbers[instruction]

    def constant(self, value: float) -> int:
        """Return the instruction of a constant."""
        return self.add(Operation.CONSTANT, float(value))

    def variable(self, row: int) -> int:
        """Return the instruction of the variable in a row."""
        return self.add(Operation.VARIABLE, row)

    def write(self, node: ast.AST, names: Mapping[str, int]) -> int:
        """Write the syntax tree `node`, which must have been checked; return its instruction.

        `names` are the instructions of the variables. All arithmetic is in doubles, so that no
        power grows without limit, as one of Python's integers would.
        """

        def write(part: ast.AST) -> int:
            return self.write(part, names)

        match node:
            case ast.Constant(value=int() | float() as number):
                return self.constant(number)
            case ast.Name(id=name) if name in names:
                return names[name]
            case ast.Name(id=name):
                return self.constant(CONSTANTS[name])
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.add(Operation.NOT, write(operand))
            case ast.UnaryOp(op=op, operand=operand):
                operation = UNARY[type(op)]
                return self.add(operation, write(operand)) if operation else write(operand)
            case ast.BinOp(left=left, op=op, right=right):
                return self.add(BINARY[type(op)], write(left), write(right))
            case ast.BoolOp(op=op, values=parts):
                return self._join(BOOLEAN[type(op)], map(write, parts))
            case ast.Compare(left=left, ops=ops, comparators=others):
                # a < b < c is a < b and b < c, as in Python.
                sides = list(map(write, (left, *others)))
                pairs = zip(ops, sides, sides[1:], strict=False)
                holds = [self.add(COMPARE[type(op)], a, b) for op, a, b in pairs]
                return self._join(Operation.AND, holds)
            case ast.Call(func=ast.Name(id=name), args=parts):
                return self.add(FUNCTIONS[name].operation, *map(write, parts))
        raise AssertionError(f"unchecked node {node!r}")

    def _join(self, operation: Operation, parts: Iterable[int]) -> int:
        return reduce(lambda a, b: self.add(operation, a, b), parts)

    def derive(self, output: int, row: int) -> int:
        """Write the derivative of an instruction by the variable in a row; return its number.

        At a kink or a jump the derivative is taken on one side: it is 0 for abs, sign and floor,
        the derivative of the second argument for min and max, and the derivative of the chosen
        part for where. For mod(a, b) it is the derivative between the jumps.
        """
        slopes: dict[int, int] = {}  # an instruction that is not there has the derivative 0
        for number in self.needed([output]):
            operation, operands = self.instructions[number]
            if operation is Operation.CONSTANT:
                continue
            if operation is Operation.VARIABLE:
                if operands == (row,):
                    slopes[number] = self.constant(1.0)
                continue
            numbers = tuple(map(int, operands))
            if any(operand in slopes for operand in numbers):
                slope = self._slope(operation, numbers, [slopes.get(i) for i in numbers])
                if slope is not None:
                    slopes[number] = slope
        return slopes[output] if output in slopes else self.constant(0.0)

    def _slope(
        self, operation: Operation, operands: tuple[int, ...], slopes: Sequence[int | None]
    ) -> int | None:
        """Return the derivative of an operation from the slopes of its operands; None for 0."""
        names = dict(zip(OPERANDS, operands, strict=False))
        if operation in CHOICES:
            for name, slope in zip(OPERANDS, slopes, strict=False):
                names[f"d{name}"] = self.constant(0.0) if slope is None else slope
            return self.write(_tree(CHOICES[operation]), names)
        # The chain rule: the sum of partial derivatives times slopes.
        texts = PARTIALS.get(operation, ())
        terms = [
            self.add(Operation.MULTIPLY, self.write(_tree(text), names), slope)
            for text, slope in zip(texts, slopes, strict=False)
            if slope is not None
        ]
        return self._join(Operation.ADD, terms) if terms else None

    def needed(self, outputs: Iterable[int]) -> list[int]:
        """Return the numbers of the instructions on which outputs depend, ascending."""
        needed = set(outputs)
        for number in range(max(needed, default=-1), -1, -1):
            operation, operands = self.instructions[number]
            if number in needed and operation not in (Operation.CONSTANT, Operation.VARIABLE):
                needed.update(map(int, operands))
        return sorted(needed)


@cache
def _tree(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


@dataclass(frozen=True, eq=False)
class Program:
    """Formulas of the same variables, as the kernel `evaluate` takes them.

    Attributes
    ----------
    code, numbers, outputs
        The instructions, the constants and the results, see `evaluate`.
    """

    code: np.ndarray
    numbers: np.ndarray
    outputs: np.ndarray

    @classmethod
    def assemble(cls, tape: Tape, outputs: Sequence[int]) -> Self:
        """Return the program of the instructions that the outputs need."""
        needed = tape.needed(outputs)
        places = {number: place for place, number in enumerate(needed)}
        code = np.zeros((len(needed), 4), np.int64)
        numbers: list[float] = []
        for row, number in zip(code, needed, strict=True):
            operation, operands = tape.instructions[number]
            row[0] = operation
            if operation is Operation.CONSTANT:
                row[1] = len(numbers)
                numbers.append(operands[0])
            elif operation is Operation.VARIABLE:
                row[1] = operands[0]
            else:
                row[1 : 1 + len(operands)] = [places[int(operand)] for operand in operands]
        wanted = np.array([places[output] for output in outputs], np.int64)
        return cls(code, np.array(numbers, float), wanted)

    def call(self, variables: np.ndarray, values: np.ndarray) -> Call:
        """Return the call that writes the values (m, k) at the variables (v, m)."""
        return evaluate, (self.code, self.numbers, self.outputs, variables, values)

    def __call__(self, variables: np.ndarray) -> np.ndarray:
        """Values (m, k) at the variables (v, m)."""
        values = np.empty((variables.shape[1], len(self.outputs)))
        evaluate(self.code, self.numbers, self.outputs, variables, values)
        return values
