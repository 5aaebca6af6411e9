"""Formulas as nested closures, for numbers and for arrays."""

import ast
import math
import operator
from collections.abc import Callable, Sequence
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

CONSTANTS = {"pi": math.pi}


def smoothstep(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> np.ndarray:
    """Return 0 up to t = a, 1 from t = b on, and s²(3 − 2s) between, s = (t − a)/(b − a)."""
    s = np.clip((np.asarray(t) - a) / (np.asarray(b) - a), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def power(a: Any, b: Any) -> Any:
    """Return a ** b; the result for an element does not depend on the other elements.

    NumPy rounds differently where one exponent is for many numbers. Therefore an array of
    exponents is broadcast first.
    """
    if np.ndim(b):
        b = np.array(np.broadcast_arrays(a, b)[1])
    return a**b


class Function(NamedTuple):
    """A function that formulas may have.

    Attributes
    ----------
    value
        The function of numbers or arrays.
    arguments
        Names of its arguments.
    meaning
        Its value, in words.
    """

    value: Callable[..., Any]
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
    **{name: Function(getattr(np, name), ("x",), words) for name, words in _OF_ONE.items()},
    "min": Function(np.minimum, ("a", "b"), "the smaller of a and b"),
    "max": Function(np.maximum, ("a", "b"), "the larger of a and b"),
    "mod": Function(np.mod, ("a", "b"), "a - b floor(a/b): with mod(t, 2) a motion repeats"),
    "where": Function(np.where, ("condition", "a", "b"), "a where the condition holds, else b"),
    "smoothstep": Function(smoothstep, ("a", "b", "t"), _RAMP),
}
SMOOTH = {"sin", "cos", "tanh", "exp", "log", "sqrt"}  # where they are finite
UNARY: dict[type[ast.unaryop], Callable[..., Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
BINARY: dict[type[ast.operator], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: power,
    ast.Mod: np.mod,
}
BOOLEAN: dict[type[ast.boolop], Callable[..., Any]] = {
    ast.And: np.logical_and,
    ast.Or: np.logical_or,
}
COMPARE: dict[type[ast.cmpop], Callable[..., Any]] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}

Closure = Callable[[Sequence[Any]], Any]
"""The value of a node at the values of the variables, in their order."""


def compile_tree(node: ast.AST, variables: tuple[str, ...], derived: bool = False) -> Closure:
    """Return the closure of the syntax tree `node`, which must have been checked.

    If `derived`, the closure also takes variables that are a `Dual`. Call the closure with
    NumPy's errors ignored. All arithmetic is in doubles, so that no power grows without limit,
    as one of Python's integers would.
    """

    def compile_part(part: ast.AST) -> Closure:
        return compile_tree(part, variables, derived)

    def apply(key: object, function: Callable[..., Any], *parts: ast.AST) -> Closure:
        """Return the closure of a function of parts; `key` is its key in `_PARTIALS`."""
        if derived:
            function = _with_duals(key, function)
        return _apply(function, *map(compile_part, parts))

    match node:
        case ast.Constant(value=int() | float() as number):
            return _constant(np.float64(number))
        case ast.Name(id=name) if name in variables:
            return operator.itemgetter(variables.index(name))
        case ast.Name(id=name):
            return _constant(np.float64(CONSTANTS[name]))
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return apply("not", np.logical_not, operand)
        case ast.UnaryOp(op=op, operand=operand):
            return apply(type(op), UNARY[type(op)], operand)
        case ast.BinOp(left=left, op=op, right=right):
            return apply(type(op), BINARY[type(op)], left, right)
        case ast.BoolOp(op=op, values=parts):
            join = BOOLEAN[type(op)]  # truth values have no slopes: no duals are needed
            return reduce(partial(_apply, join), map(compile_part, parts))
        case ast.Compare(left=left, ops=ops, comparators=others):
            # a < b < c is a < b and b < c, as in Python.
            sides = zip(ops, (left, *others), others, strict=False)
            comparisons = [apply(type(op), COMPARE[type(op)], a, b) for op, a, b in sides]
            return reduce(partial(_apply, np.logical_and), comparisons)
        case ast.Call(func=ast.Name(id=name), args=parts):
            return apply(name, FUNCTIONS[name].value, *parts)
    raise AssertionError(f"unchecked node {node!r}")


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


def _constant(value: Any) -> Closure:
    return lambda v: value


def _apply(function: Callable[..., Any], *parts: Closure) -> Closure:
    """Return the closure of a function of closures; fast for one and two of them."""
    if len(parts) == 1:
        (a,) = parts
        return lambda v: function(a(v))
    if len(parts) == 2:
        a, b = parts
        return lambda v: function(a(v), b(v))
    return lambda v: function(*[part(v) for part in parts])


# --- derivatives --------------------------------------------------------------------------

_X = "min(max((c - a)/(b - a), 0), 1)"  # of smoothstep(a, b, c)
_PARTIALS: dict[object, tuple[str, ...]] = {  # by each of the arguments a, b, c
    ast.Add: ("1", "1"),
    ast.Sub: ("1", "-1"),
    ast.Mult: ("b", "a"),
    ast.Div: ("1/b", "-a/(b*b)"),
    ast.Pow: ("b*a**(b - 1)", "where(abs(a) > 0, a**b*log(a), 0)"),
    ast.Mod: ("1", "-floor(a/b)"),
    ast.USub: ("-1",),
    ast.UAdd: ("1",),
    "sin": ("cos(a)",),
    "cos": ("-sin(a)",),
    "tan": ("1 + tan(a)*tan(a)",),
    "tanh": ("1 - tanh(a)*tanh(a)",),
    "exp": ("exp(a)",),
    "log": ("1/a",),
    "sqrt": ("0.5/sqrt(a)",),
    "abs": ("sign(a)",),
    "mod": ("1", "-floor(a/b)"),
    "smoothstep": (
        f"6*{_X}*(1 - {_X})*({_X} - 1)/(b - a)",
        f"-6*{_X}*(1 - {_X})*{_X}/(b - a)",
        f"6*{_X}*(1 - {_X})/(b - a)",
    ),
}


class Dual(NamedTuple):
    """A value, and its derivative by one of the variables.

    Attributes
    ----------
    value, slope
        The value and its derivative. In a derivative of a derivative both may be duals of a
        higher level.
    level
        Number of derivatives taken before.
    """

    value: Any
    slope: Any
    level: int


def derivative(closure: Closure, place: int, level: int) -> Closure:
    """Return the derivative by the variable at a place; before it, `level` others were taken.

    At a kink or a jump the derivative is taken on one side: it is 0 for abs, sign and floor, the
    derivative of the second argument for min and max, and the derivative of the chosen part for
    where. For mod(a, b) it is the derivative between the jumps.
    """

    def slope(v: Sequence[Any]) -> Any:
        dual = Dual(v[place], np.float64(1.0), level)
        return _slope_of(closure([*v[:place], dual, *v[place + 1 :]]), level)

    return slope


def _is_dual(value: Any, level: int) -> bool:
    return isinstance(value, Dual) and value.level == level


def _value_of(value: Any, level: int) -> Any:
    if _is_dual(value, level):
        return value.value
    return value


def _slope_of(value: Any, level: int) -> Any:
    if _is_dual(value, level):
        return value.slope
    return np.float64(0.0)


def _with_duals(key: object, function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function like `function` that also takes arguments that are a `Dual`.

    Its derivatives have the `key` in `_RULES` (partial derivatives, compiled from the texts of
    `_PARTIALS`) or in `_RULES_OF_CHOICES`. A function that has none, such as floor or a
    comparison, is constant but for jumps: its derivative is 0.
    """

    def apply(*arguments: Any) -> Any:
        """Return the value at numbers, arrays and duals: a dual if the value has a slope.

        In a derivative of a derivative the arguments have duals of several levels. The smallest
        level is resolved here, and the values and slopes in it by further calls.
        """
        levels = [argument.level for argument in arguments if isinstance(argument, Dual)]
        if not levels:
            return function(*arguments)
        level = min(levels)
        values = [_value_of(argument, level) for argument in arguments]
        if key in _RULES_OF_CHOICES:
            slopes = [_slope_of(argument, level) for argument in arguments]
            slope_of_choice = _RULES_OF_CHOICES[key]([*values, *slopes])
            return Dual(apply(*values), slope_of_choice, level)
        # The chain rule: the sum of partial derivatives times slopes.
        partial_derivatives = _RULES.get(key, ())
        terms = [
            _multiply(partial_derivative(values), argument.slope)
            for argument, partial_derivative in zip(arguments, partial_derivatives, strict=False)
            if _is_dual(argument, level)
        ]
        if not terms:  # no rule for the key: the slope is 0, and a plain value stands for that
            return apply(*values)
        return Dual(apply(*values), reduce(_add, terms), level)

    return apply


_add = _with_duals(ast.Add, operator.add)
_multiply = _with_duals(ast.Mult, operator.mul)


def _rule(text: str, variables: tuple[str, ...]) -> Closure:
    return compile_tree(ast.parse(text, mode="eval").body, variables, derived=True)


_RULES = {
    key: [_rule(text, tuple("abc"[: len(texts)])) for text in texts]
    for key, texts in _PARTIALS.items()
}
# Of functions that choose an argument; da, db, dc are the derivatives of the arguments.
_RULES_OF_CHOICES: dict[object, Closure] = {
    "where": _rule("where(a, db, dc)", ("a", "b", "c", "da", "db", "dc")),
    "min": _rule("where(a < b, da, db)", ("a", "b", "da", "db")),
    "max": _rule("where(a > b, da, db)", ("a", "b", "da", "db")),
}
