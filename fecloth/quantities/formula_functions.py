"""Formulas as nested closures: one set of operations for arrays, and a fast one for numbers."""

import ast
import math
import operator
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

CONSTANTS = {"pi": math.pi}


def smoothstep(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> np.ndarray:
    """0 up to t = a, 1 from t = b on, and between them the cubic s²(3 − 2s), without a kink."""
    s = np.clip((np.asarray(t) - a) / (np.asarray(b) - a), 0.0, 1.0)
    return s * s * (3 - 2 * s)


class Function(NamedTuple):
    """A function that formulas may have."""

    of_arrays: Callable[..., Any]
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
    ast.Pow: operator.pow,
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


@dataclass(frozen=True)
class Arithmetic:
    """The operations that the closures are made of."""

    number: type  # type of the constants
    # By name, and by the type of the operator in the syntax tree.
    functions: Mapping[str, Callable[..., Any]]
    binary: Mapping[type[ast.operator], Callable[..., Any]]
    compare: Mapping[type[ast.cmpop], Callable[..., Any]]
    # Truth values: not a, all of a list, any of a list.
    negate: Callable[..., Any]
    every: Callable[..., Any]
    some: Callable[..., Any]
    # Whether variables and constants are Python's floats: then constant parts are evaluated once,
    # and of where(condition, a, b) only the part that is chosen.
    for_numbers: bool


def compile_tree(node: ast.AST, variables: tuple[str, ...], kit: Arithmetic) -> Closure:
    """The closure of a checked syntax tree."""
    # A node may be a part of several others, as in derivatives: it is compiled once, and evaluated
    # once in a call. Its value follows the values of the variables.
    uses: Counter[int] = Counter()
    varies: dict[int, bool] = {}
    _count_uses(node, variables, uses, varies)
    closures: dict[int, Closure] = {}
    evaluated_first: list[Closure] = []

    def inner(part: ast.AST) -> Closure:
        key = id(part)
        if key not in closures:
            closure = _closure(part, variables, kit, inner)
            if kit.for_numbers and not varies[key]:
                closure = _fold_constant(closure)
            elif uses[key] > 1 and not isinstance(part, ast.Name | ast.Constant):
                evaluated_first.append(closure)
                closure = operator.itemgetter(len(variables) + len(evaluated_first) - 1)
            closures[key] = closure
        return closures[key]

    root = inner(node)
    return _in_order(evaluated_first, root) if evaluated_first else root


def _count_uses(
    node: ast.AST, variables: tuple[str, ...], uses: Counter[int], varies: dict[int, bool]
) -> None:
    """Count the places of each node, by its id, and note whether a variable is in it."""
    uses[id(node)] += 1
    if uses[id(node)] == 1:
        parts = [part for part in ast.iter_child_nodes(node) if isinstance(part, ast.expr)]
        for part in parts:
            _count_uses(part, variables, uses, varies)
        is_variable = isinstance(node, ast.Name) and node.id in variables
        varies[id(node)] = is_variable or any(varies[id(part)] for part in parts)


def _in_order(first: list[Closure], root: Closure) -> Closure:
    """The closure that puts the values of `first` behind the variables, and then takes `root`."""

    def evaluate(v: Sequence[Any]) -> Any:
        values = list(v)
        for closure in first:
            values.append(closure(values))
        return root(values)

    return evaluate


def _closure(
    node: ast.AST, variables: tuple[str, ...], kit: Arithmetic, inner: Callable[..., Closure]
) -> Closure:
    match node:
        case ast.Constant(value=number):
            return _constant(kit.number(number))
        case ast.Name(id=name) if name in variables:
            return operator.itemgetter(variables.index(name))
        case ast.Name(id=name):
            return _constant(kit.number(CONSTANTS[name]))
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return _apply(kit.negate, inner(operand))
        case ast.UnaryOp(op=op, operand=operand):
            return _apply(UNARY[type(op)], inner(operand))
        case ast.BinOp(left=left, op=op, right=right):
            of_scalars = not (_is_array(left, variables) or _is_array(right, variables))
            by_math = kit.for_numbers and isinstance(op, ast.Pow) and of_scalars
            return _apply(math.pow if by_math else kit.binary[type(op)], inner(left), inner(right))
        case ast.BoolOp(op=op, values=parts):
            join = kit.every if isinstance(op, ast.And) else kit.some
            return _join(join, [inner(part) for part in parts])
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [inner(side) for side in (left, *others)]
            pairs = zip(ops, sides, sides[1:], strict=False)
            return _join(kit.every, [_apply(kit.compare[type(op)], a, b) for op, a, b in pairs])
        case ast.Call(func=ast.Name(id="where"), args=parts) if kit.for_numbers:
            condition, a, b = map(inner, parts)
            return lambda v: a(v) if condition(v) else b(v)
        case ast.Call(func=ast.Name(id=name), args=parts):
            return _apply(kit.functions[name], *map(inner, parts))
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
    if len(parts) == 1:
        return parts[0]
    return lambda v: function([part(v) for part in parts])


def _fold_constant(closure: Closure) -> Closure:
    """The value of a closure without variables, or the closure if the value is not finite."""
    try:
        value = closure(())
    except (ArithmeticError, ValueError):
        return closure
    return _constant(value) if math.isfinite(value) else closure


def _is_array(node: ast.AST, variables: tuple[str, ...]) -> bool:
    """Whether the value is an array of no dimension, not a scalar, in NumPy's arithmetic."""
    # NumPy raises these to a power by another routine, which may differ in the last bit.
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id == "where"
    return isinstance(node, ast.Name) and node.id in variables


def _numpy(
    function: Callable[..., Any], low: float = -math.inf, high: float = math.inf
) -> Callable[..., Any]:
    """NumPy's function of a float, for its bits; an ArithmeticError where it might warn."""

    def guarded(x: float) -> float:
        if not low < x < high:
            raise ArithmeticError
        return float(function(x))

    return guarded


def _power(a: float, b: float) -> float:
    if not (a > 0 and abs(b * math.log(a)) < 700):
        raise ArithmeticError
    return float(np.asarray(a) ** np.float64(b))


def _smoothstep(a: float, b: float, t: float) -> float:
    s = (t - a) / (b - a)
    s = 0.0 if s < 0.0 else 1.0 if s > 1.0 else s
    return s * s * (3 - 2 * s)


def _power_of_arrays(a: Any, b: Any) -> Any:
    """a ** b; exponents get a place each, as NumPy rounds differently where one is for many."""
    return a ** (np.array(np.broadcast_arrays(a, b)[1]) if np.ndim(b) else b)


ARRAYS = Arithmetic(
    number=np.float64,
    functions={name: function.of_arrays for name, function in FUNCTIONS.items()},
    binary=BINARY | {ast.Pow: _power_of_arrays},
    compare=COMPARE,
    negate=np.logical_not,
    every=lambda parts: np.logical_and.reduce(np.broadcast_arrays(*parts)),
    some=lambda parts: np.logical_or.reduce(np.broadcast_arrays(*parts)),
    for_numbers=False,
)
"""All in doubles, so that no power grows without limit; to be used with NumPy's errors ignored."""

NUMBERS = Arithmetic(
    number=float,
    functions={
        **{name: _numpy(getattr(np, name)) for name in _OF_ONE},
        "exp": _numpy(np.exp, -700.0, 700.0),
        "log": _numpy(np.log, 0.0),
        "sqrt": math.sqrt,
        "abs": abs,
        "min": lambda a, b: float(np.minimum(a, b)),
        "max": lambda a, b: float(np.maximum(a, b)),
        "mod": operator.mod,
        "smoothstep": _smoothstep,
    },
    binary=BINARY | {ast.Pow: _power, ast.Mod: operator.mod},
    compare={ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge},
    negate=operator.not_,
    every=all,
    some=any,
    for_numbers=True,
)
"""The same bits as `ARRAYS`, or an ArithmeticError or ValueError where these must be taken."""
