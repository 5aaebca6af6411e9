"""The constants, functions and operators that formulas may have."""

import ast
import math
from typing import NamedTuple

from fecloth.quantities.formula_kernel import Operation

CONSTANTS = {"pi": math.pi}


class Function(NamedTuple):
    """A function that formulas may have.

    Attributes
    ----------
    operation
        What an instruction does for it.
    arguments
        Names of its arguments.
    meaning
        Its value, in words.
    """

    operation: Operation
    arguments: tuple[str, ...]
    meaning: str


_OF_ONE = {
    "sin": "sine of x [rad]",
    "cos": "cosine of x [rad]",
    "tan": "tangent of x [rad]",
    "tanh": "hyperbolic tangent of x",
    "exp": "e to the power of x",
    "log": "natural logarithm of x",
    "sqrt": "square root of x",
    "abs": "x without its sign",
    "sign": "-1, 0 or 1: the sign of x",
    "floor": "the largest whole number that is not above x",
}
_RAMP = "0 up to t = a, 1 from t = b on, between them s²(3 - 2s) with s = (t - a)/(b - a)"
FUNCTIONS: dict[str, Function] = {
    **{name: Function(Operation[name.upper()], ("x",), words) for name, words in _OF_ONE.items()},
    "min": Function(Operation.MIN, ("a", "b"), "the smaller of a and b"),
    "max": Function(Operation.MAX, ("a", "b"), "the larger of a and b"),
    "mod": Function(Operation.MOD, ("a", "b"), "a - b floor(a/b): with mod(t, 2) a motion repeats"),
    "where": Function(
        Operation.WHERE, ("condition", "a", "b"), "a where the condition holds, else b"
    ),
    "smoothstep": Function(Operation.SMOOTHSTEP, ("a", "b", "t"), _RAMP),
}
SMOOTH = {"sin", "cos", "tanh", "exp", "log", "sqrt"}  # where they are finite
UNARY: dict[type[ast.unaryop], Operation | None] = {
    ast.USub: Operation.NEGATE,
    ast.UAdd: None,  # +x is x
}
BINARY: dict[type[ast.operator], Operation] = {
    ast.Add: Operation.ADD,
    ast.Sub: Operation.SUBTRACT,
    ast.Mult: Operation.MULTIPLY,
    ast.Div: Operation.DIVIDE,
    ast.Pow: Operation.POWER,
    ast.Mod: Operation.MOD,
}
BOOLEAN: dict[type[ast.boolop], Operation] = {
    ast.And: Operation.AND,
    ast.Or: Operation.OR,
}
COMPARE: dict[type[ast.cmpop], Operation] = {
    ast.Lt: Operation.LESS,
    ast.LtE: Operation.LESS_EQUAL,
    ast.Gt: Operation.GREATER,
    ast.GtE: Operation.GREATER_EQUAL,
}

_X = "min(max((c - a)/(b - a), 0), 1)"  # of smoothstep(a, b, c)
PARTIALS: dict[Operation, tuple[str, ...]] = {  # by each of the operands a, b, c
    Operation.ADD: ("1", "1"),
    Operation.SUBTRACT: ("1", "-1"),
    Operation.MULTIPLY: ("b", "a"),
    Operation.DIVIDE: ("1/b", "-a/(b*b)"),
    Operation.POWER: ("b*a**(b - 1)", "where(abs(a) > 0, a**b*log(a), 0)"),
    Operation.MOD: ("1", "-floor(a/b)"),
    Operation.NEGATE: ("-1",),
    Operation.SIN: ("cos(a)",),
    Operation.COS: ("-sin(a)",),
    Operation.TAN: ("1 + tan(a)*tan(a)",),
    Operation.TANH: ("1 - tanh(a)*tanh(a)",),
    Operation.EXP: ("exp(a)",),
    Operation.LOG: ("1/a",),
    Operation.SQRT: ("0.5/sqrt(a)",),
    Operation.ABS: ("sign(a)",),
    Operation.SMOOTHSTEP: (
        f"6*{_X}*(1 - {_X})*({_X} - 1)/(b - a)",
        f"-6*{_X}*(1 - {_X})*{_X}/(b - a)",
        f"6*{_X}*(1 - {_X})/(b - a)",
    ),
}
"""Partial derivatives. An operation without them is constant but for jumps."""
CHOICES: dict[Operation, str] = {  # da, db, dc are the derivatives of the operands
    Operation.WHERE: "where(a > 0, db, dc)",
    Operation.MIN: "where(a < b, da, db)",
    Operation.MAX: "where(a > b, da, db)",
}
"""Derivatives of operations that choose one of their operands."""


def is_smooth(tree: ast.AST) -> bool:
    """Return whether a checked syntax tree consists of smooth functions only.

    The others are kinks and jumps, such as abs and floor, what has a condition, and the
    remainder.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Mod | ast.Compare | ast.BoolOp):
            return False
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") not in SMOOTH:
            return False
    return True
