"""What a formula may consist of: its syntax tree is read by `ast`, checked, and not executed."""

import ast
import re
import warnings
from typing import NoReturn

import numpy as np

from fecloth.errors import InputError, amount, did_you_mean
from fecloth.quantities.formula_functions import (
    BINARY,
    COMPARE,
    CONSTANTS,
    FUNCTIONS,
    UNARY,
    compile_tree,
)

NUMBER_AND_UNIT = r"[-+0-9.]+(e[-+]?\d+)?\s*[A-Za-z%][A-Za-z0-9/*^]*"
LONGEST, DEEPEST, LARGEST_POWER = 500, 100, 100  # characters, nested operations, exponent


def parse(text: str, variables: tuple[str, ...], condition: bool) -> ast.expr:
    """The checked syntax tree of a number, or of a condition."""
    reader = _Reader(text, variables)
    tree = reader.parse()
    reader.condition(tree, 1) if condition else reader.number(tree, 1)
    return tree


class _Reader:
    """Walk a syntax tree and refuse every node that is not on the list."""

    def __init__(self, text: str, variables: tuple[str, ...]):
        self.text = text.strip()
        self.variables = variables
        names = ", ".join((*variables, *CONSTANTS))
        self.allowed = f"allowed are numbers, {names}, + - * / **, {', '.join(FUNCTIONS)}"

    def refuse(self, problem: str, node: ast.AST | None = None, remedy: str = "") -> NoReturn:
        if node is not None:
            piece = ast.get_source_segment(self.text, node)
        else:
            piece = None
        shown = self.text if len(self.text) <= 80 else self.text[:77] + "..."
        if piece and piece != self.text:
            problem = f"{problem}: {piece!r}"
        else:
            problem = problem
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
            if re.fullmatch(NUMBER_AND_UNIT, self.text):
                remedy = "A formula has no units: write its numbers in SI, as 0.02 for 2 cm."
            where = f" (see character {at})" if at else ""
            self.refuse(f"not an expression{where}", None, remedy)

    def number(self, node: ast.AST, depth: int) -> None:
        if depth > DEEPEST:
            self.refuse(f"nested more than {DEEPEST} deep")
        match node:
            case ast.Constant(value=value):
                if (
                    isinstance(value, bool)
                    or not isinstance(value, int | float)
                    or not abs(value) < 1e300
                ):
                    self.refuse("not a finite number", node)
            case ast.Name(id=name):
                self.name(node, name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in UNARY:
                self.number(operand, depth + 1)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in BINARY:
                self.number(left, depth + 1)
                self.number(right, depth + 1)
                if isinstance(op, ast.Pow):
                    self.power(right)
            case ast.Call():
                self.call(node, depth)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                self.refuse("a comparison instead of a number", node, "Use where(a < b, c, d).")
            case ast.BinOp(op=ast.BitXor()):
                self.refuse("not allowed", node, "Powers are written **.")
            case _:
                self.refuse("not allowed", node)

    def name(self, node: ast.AST, name: str) -> None:
        if name in self.variables or name in CONSTANTS:
            return
        if name in FUNCTIONS:
            self.refuse(f"the function {name} without arguments", node)
        remedy = did_you_mean(name, (*self.variables, *CONSTANTS))
        self.refuse(f"unknown name {name!r}", None, remedy)

    def power(self, exponent: ast.AST) -> None:
        if any(isinstance(node, ast.Name) and node.id not in (*CONSTANTS, *FUNCTIONS)
               for node in ast.walk(exponent)):  # fmt: skip
            return
        with np.errstate(all="ignore"):
            value = compile_tree(exponent, ())(())
        if not abs(value) <= LARGEST_POWER:
            self.refuse(f"an exponent larger than {LARGEST_POWER}", exponent)

    def call(self, node: ast.Call, depth: int) -> None:
        name = node.func.id if isinstance(node.func, ast.Name) else None
        if name is None or name not in FUNCTIONS:
            self.refuse("unknown function", node.func, did_you_mean(name or "", FUNCTIONS))
        _, arguments, meaning = FUNCTIONS[name]
        if node.keywords or len(node.args) != len(arguments):
            takes = f"{name} takes {amount(len(arguments), 'argument')}"
            self.refuse(takes, node, f"{name}({', '.join(arguments)}) is {meaning}.")
        first, *others = node.args
        self.condition(first, depth + 1) if name == "where" else self.number(first, depth + 1)
        for other in others:
            self.number(other, depth + 1)

    def condition(self, node: ast.AST, depth: int) -> None:
        if depth > DEEPEST:
            self.refuse(f"nested more than {DEEPEST} deep")
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others):
                if any(type(op) not in COMPARE for op in ops):
                    self.refuse("compare by < <= > >=", node, "For equality: abs(a - b) < 1e-9.")
                for side in (left, *others):
                    self.number(side, depth + 1)
            case ast.BoolOp(values=parts) | ast.UnaryOp(op=ast.Not(), operand=ast.AST() as parts):
                for part in parts if isinstance(parts, list) else [parts]:
                    self.condition(part, depth + 1)
            case _:
                joined = isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd | ast.BitOr)
                remedy = "Join conditions by and, or." if joined else ""
                self.refuse("a condition such as X < 0.01 is needed here", node, remedy)
