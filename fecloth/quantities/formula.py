"""Arithmetic written as text, e.g. "0.1*sin(2*pi*t)": read with `ast` and never executed."""

from __future__ import annotations

import ast
import difflib
import math
import operator
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from fecloth.errors import InputError

LONGEST, DEEPEST, LARGEST_POWER = 500, 100, 100  # characters, nested operations, exponent

CONSTANTS = {"pi": math.pi}


def smoothstep(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> np.ndarray:
    """0 up to t = a, 1 from t = b on, between them the cubic s²(3 − 2s) without a kink.

    Examples
    --------
    >>> [float(smoothstep(1.0, 3.0, t)) for t in (0.0, 2.0, 4.0)]
    [0.0, 0.5, 1.0]
    """
    s = np.clip((np.asarray(t) - a) / (np.asarray(b) - a), 0.0, 1.0)
    return s * s * (3 - 2 * s)


_OF_ONE = ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "abs", "sign", "floor")
FUNCTIONS: dict[str, tuple[Callable, int]] = {  # and their number of arguments
    **{name: (getattr(np, name), 1) for name in _OF_ONE},
    "min": (np.minimum, 2),
    "max": (np.maximum, 2),
    "where": (np.where, 3),
    "smoothstep": (smoothstep, 3),
}
_BINARY = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY = {ast.USub: operator.neg, ast.UAdd: operator.pos}
_COMPARE = {ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal}
_LOGIC = {ast.And: np.logical_and, ast.Or: np.logical_or}


@dataclass(frozen=True)
class Formula:
    """A formula of named variables: a number, or a condition such as ``"X < 0.01 and Y > 1"``.

    Numbers, the variables, pi, ``+ - * / **``, and the functions sin cos tan tanh exp log sqrt abs
    sign floor min(a, b) max(a, b) where(condition, a, b) smoothstep(a, b, t). Comparisons
    ``< <= > >=``, joined by and, or, not, stand in conditions only. All arithmetic is in doubles.

    Parameters
    ----------
    text
        The formula, at most 500 characters.
    variables
        Names that it may use.
    condition
        Whether it must be a condition (true or false) instead of a number.

    Raises
    ------
    InputError
        For anything else, with the piece that is refused and the names that are allowed.

    Examples
    --------
    >>> Formula("0.1*sin(2*pi*t)", variables=("t",))(t=0.25)
    0.1
    >>> Formula("where(X < 1, X**2, 0)", variables=("X", "Y"))(X=np.array([0.5, 2.0]), Y=0.0)
    array([0.25, 0.  ])
    """

    text: str
    variables: tuple[str, ...] = ()
    condition: bool = False

    def __post_init__(self):
        _parsed(self.text, self.variables, self.condition)

    def __call__(self, **values: ArrayLike) -> float | np.ndarray:
        """Value at the variables, broadcast against each other; a float if all are scalars.

        Raises
        ------
        InputError
            Where the value is not finite.
        """
        arrays = {name: np.asarray(values[name], dtype=float) for name in self.variables}
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        with np.errstate(all="ignore"):
            value = _value(_parsed(self.text, self.variables, self.condition), arrays)
        value = np.broadcast_to(value, shape)
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            at = {k: float(np.broadcast_to(a, shape)[tuple(bad[0])]) for k, a in arrays.items()}
            where = ", ".join(f"{name} = {number:g}" for name, number in at.items())
            what = f"formula {self.text!r} is {value[tuple(bad[0])]:g}"
            raise InputError(what + (f" at {where}" if where else ""), "must be finite", "Formula")
        return value.copy() if shape else value.item()


@dataclass(frozen=True)
class Motion:
    """Three formulas of t as a pin's ``motion(t)`` [m]; can be pickled, unlike a closure.

    With material points `X` (k, 2) the formulas are of t, X and Y, and the value is (k, 3).
    """

    formulas: tuple[Formula, ...]
    X: np.ndarray | None = field(default=None, compare=False)

    def __call__(self, t) -> np.ndarray:
        place = {} if self.X is None else {"X": self.X[:, 0], "Y": self.X[:, 1]}
        return np.stack([formula(t=t, **place) for formula in self.formulas], axis=-1)


@dataclass(frozen=True)
class Region:
    """A condition on X and Y as a predicate on material points (n, 2)."""

    formula: Formula

    def __call__(self, X: np.ndarray) -> np.ndarray:
        return self.formula(X=X[:, 0], Y=X[:, 1])


@lru_cache(maxsize=256)
def _parsed(text: str, variables: tuple[str, ...], condition: bool) -> ast.expr:
    """The checked syntax tree."""
    reader = _Reader(text, variables)
    tree = reader.parse()
    reader.condition(tree, 1) if condition else reader.number(tree, 1)
    return tree


class _Reader:
    """Walks a syntax tree and refuses every node that is not on the list."""

    def __init__(self, text: str, variables: tuple[str, ...]):
        self.text, self.variables = text.strip(), variables
        names = ", ".join((*variables, *CONSTANTS))
        self.allowed = f"allowed are numbers, {names}, + - * / **, {', '.join(FUNCTIONS)}"

    def refuse(self, problem: str, node: ast.AST | None = None, remedy: str = ""):
        piece = ast.get_source_segment(self.text, node) if node is not None else None
        shown = self.text if len(self.text) <= 80 else self.text[:77] + "..."
        problem = f"{problem}: {piece!r}" if piece and piece != self.text else problem
        raise InputError(f"formula {shown!r}, {problem}", self.allowed, "Formula", remedy)

    def parse(self) -> ast.expr:
        if len(self.text) > LONGEST:
            self.refuse(f"{len(self.text)} characters are more than {LONGEST}")
        try:
            with warnings.catch_warnings(action="ignore"):  # Python's advice, as on "1if"
                return ast.parse(self.text, mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
            at = getattr(error, "offset", None)
            remedy = "Powers are written **." if "^" in self.text else ""
            self.refuse("no expression" + (f" (see character {at})" if at else ""), None, remedy)

    def number(self, node: ast.AST, depth: int) -> None:
        if depth > DEEPEST:
            self.refuse(f"nested more than {DEEPEST} deep")
        match node:
            case ast.Constant(value=value):
                if type(value) not in (int, float) or not abs(value) < 1e300:
                    self.refuse("no finite number", node)
            case ast.Name(id=name):
                self.name(node, name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                self.number(operand, depth + 1)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                self.number(left, depth + 1)
                self.number(right, depth + 1)
                if isinstance(op, ast.Pow):
                    self.power(right)
            case ast.Call():
                self.call(node, depth)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                self.refuse(
                    "a comparison where a number must stand", node, "See where(a < b, c, d)."
                )
            case ast.BinOp(op=ast.BitXor()):
                self.refuse("not allowed", node, "Powers are written **.")
            case _:
                self.refuse("not allowed", node)

    def name(self, node: ast.AST, name: str) -> None:
        if name in self.variables or name in CONSTANTS:
            return
        if name in FUNCTIONS:
            self.refuse(f"the function {name} without its argument", node)
        self.refuse(f"unknown name {name!r}", node, nearest(name, (*self.variables, *CONSTANTS)))

    def power(self, exponent: ast.AST) -> None:
        if any(isinstance(node, ast.Name) and node.id not in (*CONSTANTS, *FUNCTIONS)
               for node in ast.walk(exponent)):  # fmt: skip
            return
        with np.errstate(all="ignore"):
            value = _value(exponent, {})
        if not abs(value) <= LARGEST_POWER:
            self.refuse(f"an exponent beyond {LARGEST_POWER}", exponent)

    def call(self, node: ast.Call, depth: int) -> None:
        name = node.func.id if isinstance(node.func, ast.Name) else None
        if name not in FUNCTIONS:
            self.refuse("no known function", node.func, nearest(name or "", FUNCTIONS))
        count = FUNCTIONS[name][1]
        if node.keywords or len(node.args) != count:
            self.refuse(f"{name} takes {count} argument{'s' * (count > 1)}", node)
        first, *others = node.args
        self.condition(first, depth + 1) if name == "where" else self.number(first, depth + 1)
        for other in others:
            self.number(other, depth + 1)

    def condition(self, node: ast.AST, depth: int) -> None:
        if depth > DEEPEST:
            self.refuse(f"nested more than {DEEPEST} deep")
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others):
                if any(type(op) not in _COMPARE for op in ops):
                    self.refuse("compare by < <= > >=", node, "For equality: abs(a - b) < 1e-9.")
                for side in (left, *others):
                    self.number(side, depth + 1)
            case ast.BoolOp(values=parts) | ast.UnaryOp(op=ast.Not(), operand=ast.AST() as parts):
                for part in parts if isinstance(parts, list) else [parts]:
                    self.condition(part, depth + 1)
            case _:
                joined = isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd | ast.BitOr)
                remedy = "Join conditions by and, or." if joined else ""
                self.refuse("a condition such as X < 0.01 must stand here", node, remedy)


def _value(node: ast.AST, values: Mapping[str, np.ndarray]):
    """Value of a checked tree; doubles throughout, so no power can grow without limit."""
    match node:
        case ast.Constant(value=number):
            return np.float64(number)
        case ast.Name(id=name):
            return values[name] if name in values else np.float64(CONSTANTS[name])
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return np.logical_not(_value(operand, values))
        case ast.UnaryOp(op=op, operand=operand):
            return _UNARY[type(op)](_value(operand, values))
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)](_value(left, values), _value(right, values))
        case ast.BoolOp(op=op, values=parts):
            return _LOGIC[type(op)].reduce(np.broadcast_arrays(*(_value(p, values) for p in parts)))
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [_value(side, values) for side in (left, *others)]
            pairs = zip(ops, sides, sides[1:], strict=False)
            results = [_COMPARE[type(op)](a, b) for op, a, b in pairs]
            return np.logical_and.reduce(np.broadcast_arrays(*results))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name][0](*(_value(argument, values) for argument in arguments))
    raise AssertionError(f"unchecked node {node!r}")


def nearest(name: str, names) -> str:
    """A remedy that names the closest of `names`; empty if none is close."""
    plain = {_plain(one): one for one in names}
    close = difflib.get_close_matches(_plain(name), list(plain), n=1)
    return f"Did you mean {plain[close[0]]!r}?" if close else ""


def _plain(name: str) -> str:
    """Without capitals and underscores: ``CentralDifference`` is ``central_difference``."""
    return str(name).lower().replace("_", "")
