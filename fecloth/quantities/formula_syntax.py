"""What a formula may consist of: its syntax tree is read by `ast`, checked, and not executed."""

import ast
import re
import warnings
from typing import NoReturn

from fecloth.errors import InputError, amount, did_you_mean
from fecloth.quantities.formula_functions import BINARY, COMPARE, CONSTANTS, FUNCTIONS, UNARY

NUMBER_AND_UNIT = r"[-+0-9.]+(e[-+]?\d+)?\s*[A-Za-z%][A-Za-z0-9/*^]*"
MOST_CHARACTERS = 500  # a longer formula is better a function in Python
MOST_NESTED = 100  # operations, each of which takes some levels of Python's stack of about 1000


def parse(text: str, variables: tuple[str, ...], condition: bool) -> ast.expr:
    """Return the checked syntax tree of a formula: of a condition if `condition`, else a number.

    Raises `InputError` for a text that is not such a formula of these variables.
    """
    reader = _Reader(text, variables)
    tree = reader.parse()
    if condition:
        reader.check_condition(tree, depth=1)
    else:
        reader.check_number(tree, depth=1)
    return tree


class _Reader:
    """Walk a syntax tree and refuse all nodes that are not allowed."""

    def __init__(self, text: str, variables: tuple[str, ...]):
        self.text = text.strip()
        self.variables = variables
        names = ", ".join((*variables, *CONSTANTS))
        self.allowed = f"allowed are numbers, {names}, + - * / **, {', '.join(FUNCTIONS)}"

    def refuse(self, problem: str, node: ast.AST | None = None, remedy: str = "") -> NoReturn:
        """Raise `InputError` for a problem, at a node of the tree if given."""
        shown = self.text
        if len(shown) > 80:
            shown = self.text[:77] + "..."
        piece = node and ast.get_source_segment(self.text, node)
        if piece and piece != self.text:
            problem = f"{problem}: {piece!r}"
        raise InputError(f"formula {shown!r}, {problem}", self.allowed, "Formula", remedy)

    def parse(self) -> ast.expr:
        """Return the syntax tree of the text, whose nodes are not checked yet.

        Raises `InputError` for a text that is too long or not one expression of Python.
        """
        if len(self.text) > MOST_CHARACTERS:
            self.refuse(f"{len(self.text)} characters are more than {MOST_CHARACTERS}")
        try:
            with warnings.catch_warnings(action="ignore"):  # Python's advice, as on "1if"
                return ast.parse(self.text, mode="eval").body
        # `MemoryError` and `RecursionError` come where it is nested too deep for the parser.
        except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
            problem = "not an expression"
            if place := getattr(error, "offset", None):
                problem += f" (see character {place})"
            remedy = ""
            if re.fullmatch(NUMBER_AND_UNIT, self.text):
                remedy = "A formula has no units: write its numbers in SI, as 0.02 for 2 cm."
            elif "^" in self.text:
                remedy = "Powers are written **."
            self.refuse(problem, remedy=remedy)

    def check_depth(self, depth: int) -> None:
        if depth > MOST_NESTED:
            self.refuse(f"nested more than {MOST_NESTED} deep")

    def check_number(self, node: ast.AST, depth: int) -> None:
        """Raise `InputError` if the node, with all nodes in it, is not an allowed number.

        `depth` is the number of the node's level in the tree, from 1.
        """
        self.check_depth(depth)
        match node:
            case ast.Constant(value=bool()):  # first, because for Python it is an integer too
                self.refuse("not a finite number", node)
            case ast.Constant(value=int() | float() as value) if abs(value) < 1e300:
                pass  # it fits in a double
            case ast.Constant():
                self.refuse("not a finite number", node)
            case ast.Name(id=name):
                self.check_name(node, name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in UNARY:
                self.check_number(operand, depth + 1)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in BINARY:
                self.check_number(left, depth + 1)
                self.check_number(right, depth + 1)
            case ast.Call():
                self.check_call(node, depth)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                self.refuse("a comparison instead of a number", node, "Use where(a < b, c, d).")
            case ast.BinOp(op=ast.BitXor()):  # a ^ b
                self.refuse("not allowed", node, "Powers are written **.")
            case _:
                self.refuse("not allowed", node)

    def check_name(self, node: ast.AST, name: str) -> None:
        """Raise `InputError` if the name is neither a variable nor a constant."""
        if name in self.variables or name in CONSTANTS:
            return
        if name in FUNCTIONS:
            self.refuse(f"the function {name} without arguments", node)
        remedy = did_you_mean(name, (*self.variables, *CONSTANTS))
        self.refuse(f"unknown name {name!r}", remedy=remedy)

    def check_call(self, node: ast.Call, depth: int) -> None:
        """Raise `InputError` for a call of an unknown function, or with arguments not allowed.

        `depth` is the number of the node's level in the tree, from 1.
        """
        name = getattr(node.func, "id", "")  # "" for what is no plain name, such as a.b(x)
        if name not in FUNCTIONS:
            self.refuse("unknown function", node.func, did_you_mean(name, FUNCTIONS))
        _, arguments, meaning = FUNCTIONS[name]
        if node.keywords or len(node.args) != len(arguments):
            takes = f"{name} takes {amount(len(arguments), 'argument')}"
            self.refuse(takes, node, f"{name}({', '.join(arguments)}) is {meaning}.")
        for argument, value in zip(arguments, node.args, strict=True):
            if argument == "condition":
                self.check_condition(value, depth + 1)
            else:
                self.check_number(value, depth + 1)

    def check_condition(self, node: ast.AST, depth: int) -> None:
        """Raise `InputError` if the node, with all nodes in it, is not an allowed condition.

        `depth` is the number of the node's level in the tree, from 1.
        """
        self.check_depth(depth)
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others):
                if any(type(op) not in COMPARE for op in ops):
                    self.refuse("compare by < <= > >=", node, "For equality: abs(a - b) < 1e-9.")
                for side in (left, *others):
                    self.check_number(side, depth + 1)
            case ast.BoolOp(values=parts):
                for part in parts:
                    self.check_condition(part, depth + 1)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                self.check_condition(operand, depth + 1)
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()):  # a & b, a | b
                remedy = "Join conditions by and, or."
                self.refuse("a condition such as X < 0.01 is needed here", node, remedy)
            case _:
                self.refuse("a condition such as X < 0.01 is needed here", node)
