"""Derivatives of formulas by the chain rule, as syntax trees of the same functions."""

from __future__ import annotations

import ast
import copy
from collections.abc import Sequence

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
    "sign": ("0",),
    "floor": ("0",),
    "mod": ("1", "-floor(a/b)"),
    "smoothstep": (
        f"6*{_X}*(1 - {_X})*({_X} - 1)/(b - a)",
        f"-6*{_X}*(1 - {_X})*{_X}/(b - a)",
        f"6*{_X}*(1 - {_X})/(b - a)",
    ),
}
_CHOICES = {  # da, db, dc are the derivatives of the arguments
    "where": "where(a, db, dc)",
    "min": "where(a < b, da, db)",
    "max": "where(a > b, da, db)",
}
_ONE, _ZERO = ast.Constant(1), ast.Constant(0)


def derivative(node: ast.expr, variable: str) -> ast.expr:
    """Return the syntax tree of the derivative of a formula with respect to `variable`.

    `node` is the tree of a checked formula whose value is a number, not a condition. At a kink or
    a jump the derivative is that on one side: 0 for abs, sign and floor, that of the second
    argument for min and max, and that of the chosen part for where. For mod(a, b) it is that
    between the jumps.
    """
    slope = _slope(node, variable)
    return _ZERO if slope is None else slope


def _slope(node: ast.expr, variable: str) -> ast.expr | None:
    """The derivative, or None where the variable does not occur."""
    match node:
        case ast.Name(id=name):
            return _ONE if name == variable else None
        case ast.UnaryOp(op=op, operand=operand):
            return _chain(_PARTIALS[type(op)], [operand], variable)
        case ast.BinOp(left=left, op=op, right=right):
            return _chain(_PARTIALS[type(op)], [left, right], variable)
        case ast.Call(func=ast.Name(id=name), args=arguments) if name in _CHOICES:
            return _choice(name, arguments, variable)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return _chain(_PARTIALS[name], arguments, variable)
    return None


def _chain(partials: Sequence[str], arguments: list[ast.expr], variable: str) -> ast.expr | None:
    """Σ ∂f/∂a · a' over the arguments that depend on the variable."""
    total = None
    for partial, argument in zip(partials, arguments, strict=True):
        slope = _slope(argument, variable)
        if slope is not None and partial != "0":
            term = _product(_substitute(partial, arguments), slope)
            total = term if total is None else ast.BinOp(total, ast.Add(), term)
    return total


def _product(a: ast.expr, b: ast.expr) -> ast.expr:
    if isinstance(a, ast.Constant) and a.value == 1:
        return b
    return a if b is _ONE else ast.BinOp(a, ast.Mult(), b)


def _choice(name: str, arguments: list[ast.expr], variable: str) -> ast.expr | None:
    """The derivative of the argument that is chosen; only that one need be finite."""
    first = None if name == "where" else _slope(arguments[0], variable)
    slopes = [first, *(_slope(argument, variable) for argument in arguments[1:])]
    if not any(slopes):
        return None
    return _substitute(_CHOICES[name], arguments, [slope or _ZERO for slope in slopes])


def _substitute(
    text: str, arguments: Sequence[ast.expr], slopes: Sequence[ast.expr] = ()
) -> ast.expr:
    """The rule with the arguments and their derivatives in place of a, b, c and da, db, dc."""
    parts = dict(zip("abc", arguments, strict=False))
    parts |= {f"d{letter}": slope for letter, slope in zip("abc", slopes, strict=False)}
    filled: ast.expr = _Fill(parts).visit(copy.deepcopy(_RULES[text]))
    return filled


class _Fill(ast.NodeTransformer):
    """Replace names by trees, which are not visited themselves."""

    def __init__(self, parts: dict[str, ast.expr]):
        self.parts = parts

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self.parts.get(node.id, node)


_TEXTS = (*(text for texts in _PARTIALS.values() for text in texts), *_CHOICES.values())
_RULES = {text: ast.parse(text, mode="eval").body for text in _TEXTS}
