"""Formulas as nested closures, for numbers and for arrays."""

import ast
import functools
import math
import operator
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

CONSTANTS = {"pi": math.pi}


def smoothstep(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> np.ndarray:
    """0 up to t = a, 1 from t = b on, and between them the cubic s²(3 − 2s), without a kink."""
    s = np.clip((np.asarray(t) - a) / (np.asarray(b) - a), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def power(a: Any, b: Any) -> Any:
    """a ** b; exponents get a place each, as NumPy rounds differently where one is for many."""
    return a ** (np.array(np.broadcast_arrays(a, b)[1]) if np.ndim(b) else b)


class Function(NamedTuple):
    """A function that formulas may have."""

    value: Callable[..., Any]  # of numbers and of arrays
    arguments: tuple[str, ...]
    meaning: str  # its value, in words


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
COMPARE: dict[type[ast.cmpop], Callable[..., Any]] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}

Closure = Callable[[Sequence[Any]], Any]
"""The value of a node at the values of the variables, in their order."""


def compile_tree(node: ast.AST, variables: tuple[str, ...]) -> Closure:
    """The closure of a checked syntax tree, to be called with NumPy's errors ignored."""
    # A node may be a part of several others, as in derivatives: it is compiled once, and evaluated
    # once in a call. Its value follows the values of the variables. All is in doubles, so that no
    # power grows without limit.
    uses: Counter[int] = Counter()
    _count_uses(node, uses)
    closures: dict[int, Closure] = {}
    evaluated_first: list[Closure] = []

    def inner(part: ast.AST) -> Closure:
        key = id(part)
        if key not in closures:
            closure = _closure(part, variables, inner)
            if uses[key] > 1 and not isinstance(part, ast.Name | ast.Constant):
                evaluated_first.append(closure)
                closure = operator.itemgetter(len(variables) + len(evaluated_first) - 1)
            closures[key] = closure
        return closures[key]

    root = inner(node)
    return _in_order(evaluated_first, root) if evaluated_first else root


def _count_uses(node: ast.AST, uses: Counter[int]) -> None:
    """Count the places of each node, by its id."""
    uses[id(node)] += 1
    if uses[id(node)] == 1:
        for part in ast.iter_child_nodes(node):
            if isinstance(part, ast.expr):
                _count_uses(part, uses)


def _in_order(first: list[Closure], root: Closure) -> Closure:
    """The closure that puts the values of `first` behind the variables, and then takes `root`."""

    def evaluate(v: Sequence[Any]) -> Any:
        values = list(v)
        for closure in first:
            values.append(closure(values))
        return root(values)

    return evaluate


def _closure(node: ast.AST, variables: tuple[str, ...], inner: Callable[..., Closure]) -> Closure:
    match node:
        case ast.Constant(value=int() | float() as number):
            return _constant(np.float64(number))
        case ast.Name(id=name) if name in variables:
            return operator.itemgetter(variables.index(name))
        case ast.Name(id=name):
            return _constant(np.float64(CONSTANTS[name]))
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return _apply(np.logical_not, inner(operand))
        case ast.UnaryOp(op=op, operand=operand):
            return _apply(UNARY[type(op)], inner(operand))
        case ast.BinOp(left=left, op=op, right=right):
            return _apply(BINARY[type(op)], inner(left), inner(right))
        case ast.BoolOp(op=op, values=parts):
            join = np.logical_and if isinstance(op, ast.And) else np.logical_or
            return _join(join, [inner(part) for part in parts])
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [inner(side) for side in (left, *others)]
            pairs = zip(ops, sides, sides[1:], strict=False)
            return _join(np.logical_and, [_apply(COMPARE[type(op)], a, b) for op, a, b in pairs])
        case ast.Call(func=ast.Name(id=name), args=parts):
            return _apply(FUNCTIONS[name].value, *map(inner, parts))
    raise AssertionError(f"unchecked node {node!r}")


def _constant(value: Any) -> Closure:
    return lambda v: value


def _apply(function: Callable[..., Any], *parts: Closure) -> Closure:
    if len(parts) == 1:
        (a,) = parts
        return lambda v: function(a(v))
    if len(parts) == 2:
        a, b = parts
        return lambda v: function(a(v), b(v))
    return lambda v: function(*[part(v) for part in parts])


def _join(function: Callable[..., Any], parts: list[Closure]) -> Closure:
    """The closure of a op b op c."""
    return functools.reduce(lambda a, b: _apply(function, a, b), parts)
