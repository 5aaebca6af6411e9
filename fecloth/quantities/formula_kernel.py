"""The kernel that evaluates formulas, as programs of instructions on many points at once.

One kernel serves all formulas: nothing is compiled for a new one. It carries out an instruction
at a block of points before the next instruction, so that reading an instruction costs little and
simple arithmetic uses the vector units.
"""

import math
from enum import IntEnum, auto

import numpy as np

from fecloth.compiled.jit import Array, inner, rounded_kernel

BLOCK = 128  # points; a program of 20 instructions then works in 20 kB, within the first cache


class Operation(IntEnum):
    """What an instruction does with its operands a, b, c.

    A condition is 1 where it holds, else 0.
    """

    CONSTANT = auto()
    VARIABLE = auto()
    ADD = auto()
    SUBTRACT = auto()
    MULTIPLY = auto()
    DIVIDE = auto()
    NEGATE = auto()
    POWER = auto()
    SIN = auto()
    COS = auto()
    TAN = auto()
    TANH = auto()
    EXP = auto()
    LOG = auto()
    SQRT = auto()
    ABS = auto()
    SIGN = auto()
    FLOOR = auto()
    MIN = auto()
    MAX = auto()
    MOD = auto()
    WHERE = auto()
    SMOOTHSTEP = auto()
    LESS = auto()
    LESS_EQUAL = auto()
    GREATER = auto()
    GREATER_EQUAL = auto()
    AND = auto()
    OR = auto()
    NOT = auto()


@rounded_kernel
def evaluate(code: Array, numbers: Array, outputs: Array, variables: Array, values: Array) -> None:
    """Evaluate a program at m points.

    Parameters
    ----------
    code
        (n, 4) the instructions: an `Operation` and its operands a, b, c. An operand is the
        number of an earlier instruction; for a constant a is its place in `numbers`, and for a
        variable its row in `variables`.
    numbers
        The constants.
    outputs
        (k,) the instructions whose results are wanted.
    variables
        (v, m) the values of the variables at the points.
    values
        (m, k) the results.
    """
    m = variables.shape[1]
    results = np.empty((len(code), min(m, BLOCK)))
    for begin in range(0, m, BLOCK):
        size = min(BLOCK, m - begin)
        for i in range(len(code)):
            operation = code[i, 0]
            y = results[i]
            if operation == Operation.CONSTANT:
                for j in range(size):  # an assignment of a slice would compile for seconds
                    y[j] = numbers[code[i, 1]]
                continue
            if operation == Operation.VARIABLE:
                for j in range(size):
                    y[j] = variables[code[i, 1], begin + j]
                continue
            a = results[code[i, 1]]
            b = results[code[i, 2]]
            c = results[code[i, 3]]
            if operation == Operation.ADD:
                for j in range(size):
                    y[j] = a[j] + b[j]
            elif operation == Operation.SUBTRACT:
                for j in range(size):
                    y[j] = a[j] - b[j]
            elif operation == Operation.MULTIPLY:
                for j in range(size):
                    y[j] = a[j] * b[j]
            else:
                for j in range(size):
                    y[j] = apply(operation, a[j], b[j], c[j])
        for k in range(len(outputs)):
            for j in range(size):
                values[begin + j, k] = results[outputs[k], j]


@inner
def apply(operation: int, a: float, b: float, c: float) -> float:
    """Return the result of an operation on numbers."""
    if operation == Operation.DIVIDE:
        return a / b
    if operation == Operation.NEGATE:
        return -a
    if operation == Operation.POWER:
        power: float = a**b
        return power
    if operation == Operation.SIN:
        return math.sin(a)
    if operation == Operation.COS:
        return math.cos(a)
    if operation == Operation.TAN:
        return math.tan(a)
    if operation == Operation.TANH:
        return math.tanh(a)
    if operation == Operation.EXP:
        return math.exp(a)
    if operation == Operation.LOG:
        return math.log(a)
    if operation == Operation.SQRT:
        return math.sqrt(a)
    if operation == Operation.ABS:
        return abs(a)
    if operation == Operation.SIGN:
        return 0.0 if a == 0.0 else math.copysign(1.0, a)
    if operation == Operation.FLOOR:
        floor: float = np.floor(a)
        return floor
    if operation == Operation.MIN:
        return a if a < b or a != a else b  # the one that is not a number, if any
    if operation == Operation.MAX:
        return a if a > b or a != a else b
    if operation == Operation.MOD:
        return a % b
    if operation == Operation.WHERE:
        return b if a != 0.0 else c
    if operation == Operation.SMOOTHSTEP:
        s = (c - a) / (b - a)
        if s < 0.0:
            return 0.0
        if s > 1.0:
            return 1.0
        return s * s * (3.0 - 2.0 * s)
    return 1.0 if holds(operation, a, b) else 0.0


@inner
def holds(operation: int, a: float, b: float) -> bool:
    """Whether a condition on numbers, or on other conditions, holds."""
    if operation == Operation.LESS:
        return a < b
    if operation == Operation.LESS_EQUAL:
        return a <= b
    if operation == Operation.GREATER:
        return a > b
    if operation == Operation.GREATER_EQUAL:
        return a >= b
    if operation == Operation.AND:
        return a != 0.0 and b != 0.0
    if operation == Operation.OR:
        return a != 0.0 or b != 0.0
    return a == 0.0


@rounded_kernel
def write_columns(a: Array, rows: Array) -> None:
    """Write the columns of a (m, k) as rows (k, m), as `evaluate` takes variables."""
    for k in range(len(rows)):
        for i in range(len(a)):
            rows[k, i] = a[i, k]


@rounded_kernel
def write_time(t: Array, row: Array) -> None:
    """Write the time t (1,) to all entries of a row (m,)."""
    for i in range(len(row)):
        row[i] = t[0]
