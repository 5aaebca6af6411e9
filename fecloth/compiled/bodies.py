"""Insertion of functions into a template at the level of source: their bodies in place of calls.

`jit.insert` leaves calls to compiled functions, which Numba and LLVM do not always inline where
they have arrays for work space, or are part of a large loop. With bodies they need not decide.
"""

import ast
import copy
import inspect
import textwrap
from collections.abc import Callable, Mapping
from functools import cache
from types import CodeType, FunctionType
from typing import Any


def insert_bodies(template: Any, functions: Mapping[str, Callable]) -> Any:
    """Copy a template, a plain function, with the bodies of `functions` for the calls by their key.

    A call must be a statement, or the whole right side of an assignment. Its arguments stand
    for the parameters as they are written, so they should be names, or cheap. The functions
    are plain ones that return at their end or not at all. Their local names get the key as a
    prefix. Functions that the template does not call are not looked at.

    Raises `TypeError` for another number of arguments, a parameter that is assigned to, a return
    before the end, and a global name that has another meaning in the template.
    """
    tree = copy.deepcopy(_definition(template))
    bodies = _Bodies(functions, template.__globals__)
    tree.body = bodies.expand(tree.body)
    module = ast.fix_missing_locations(ast.Module([tree], []))
    compiled = compile(module, template.__code__.co_filename, "exec", dont_inherit=True)
    code = next(each for each in compiled.co_consts if isinstance(each, CodeType))
    made: Any = FunctionType(code, bodies.names, template.__name__, template.__defaults__)
    made.__module__ = template.__module__
    made.__doc__ = template.__doc__
    used = [functions[key].__qualname__ for key in sorted(bodies.used)]
    made.__qualname__ = "-".join([template.__qualname__, *used])
    return made


@cache
def _definition(function: FunctionType) -> ast.FunctionDef:
    """The syntax tree of a function, without annotations, decorators and docstring."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    if not isinstance(tree, ast.FunctionDef) or tree.name != function.__name__:
        what = "is not a plain function, or its file has changed since it was imported"
        raise TypeError(f"{function.__qualname__} {what}")
    ast.increment_lineno(tree, function.__code__.co_firstlineno - 1)
    tree.decorator_list = []
    tree.returns = None
    for argument in tree.args.args:
        argument.annotation = None
    if ast.get_docstring(tree) is not None:
        tree.body = tree.body[1:] or [ast.Pass()]
    return tree


class _Bodies:
    """Puts bodies in place of calls; has the global names that they need, and their keys."""

    def __init__(self, functions: Mapping[str, Callable], names: Mapping[str, Any]):
        self.functions, self.names, self.used = functions, dict(names), set[str]()

    def expand(self, statements: list[ast.stmt]) -> list[ast.stmt]:
        """The statements with bodies in place of the calls, in loops and branches too."""
        result: list[ast.stmt] = []
        for each in statements:
            for part in ("body", "orelse"):
                if inside := getattr(each, part, None):
                    setattr(each, part, self.expand(inside) or [ast.Pass()])
            if isinstance(each, ast.Expr | ast.Assign):
                call = each.value
            else:
                call = None
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") in self.functions:
                result += self._body(call, each)
            else:
                result.append(each)
        return result

    def _body(self, call: ast.Call, statement: ast.stmt) -> list[ast.stmt]:
        key = call.func.id  # type: ignore[attr-defined]  # expand has looked
        function: Any = self.functions[key]
        tree = copy.deepcopy(_definition(function))
        parameters = [argument.arg for argument in tree.args.args]
        nodes = [node for statement in tree.body for node in ast.walk(statement)]
        names = [node for node in nodes if isinstance(node, ast.Name)]
        stored = {node.id for node in names if isinstance(node.ctx, ast.Store)}
        returns = [node for node in nodes if isinstance(node, ast.Return)]
        if len(call.args) != len(parameters) or call.keywords:
            raise TypeError(f"{function.__qualname__} takes {', '.join(parameters)}")
        if stored & set(parameters) or returns not in ([], tree.body[-1:]):
            what = "assigns to a parameter, or returns before its end"
            raise TypeError(f"{function.__qualname__} {what}")
        self._take_globals(function, {node.id for node in names} - stored - set(parameters))
        self.used.add(key)
        replace = _Replacement(dict(zip(parameters, call.args, strict=True)), stored, key)
        body = [replace.visit(each) for each in tree.body if not isinstance(each, ast.Pass)]
        if returns:
            value = body.pop().value
            if isinstance(statement, ast.Assign):
                body.append(ast.Assign(statement.targets, value))
        return body

    def _take_globals(self, function: Any, names: set[str]) -> None:
        for name in names & function.__globals__.keys():
            value = function.__globals__[name]
            if self.names.setdefault(name, value) is not value:
                raise TypeError(f"{function.__qualname__} means another {name} than the template")


class _Replacement(ast.NodeTransformer):
    """Arguments in place of parameters, and local names with a prefix."""

    def __init__(self, arguments: Mapping[str, ast.expr], local: set[str], prefix: str):
        self.arguments = arguments
        self.local = local
        self.prefix = prefix

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.local:
            node.id = f"{self.prefix}_{node.id}"
        return copy.deepcopy(self.arguments.get(node.id, node))
