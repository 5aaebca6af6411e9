"""Numba compilation with a disk cache that cannot go stale.

Numba notices a change of the file that defines a kernel, not of a function in another file
that the kernel calls. The cache folder is therefore named after a hash of every source file of
the package that holds kernels, and a kernel with functions from outside the package is cached
under a name with their `fingerprint`.
"""

import builtins
import dis
import gc
import hashlib
import os
import sys
from collections.abc import Callable
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar

import numba
import numpy as np
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.core.imputils import impl_ret_borrowed
from numba.core.types import Type
from numba.extending import _Intrinsic, intrinsic

from fecloth.compiled.cache_folder import cache_folder

Array = np.ndarray
"""An array as a kernel takes it; the docstring of the kernel has its shape."""
Zeros = tuple[int, ...]
"""A tuple with one zero for each node or point, so that the compiler knows their number."""
config: Any = numba.config  # its types lack what is read here
Function = TypeVar("Function", bound=Callable)
Result = TypeVar("Result")

OPTIONS: dict[str, Any] = {
    "fastmath": {"contract"},
    "error_model": "numpy",
    "nogil": True,  # other Python threads, as the threads of a `Team`, run on while a kernel does
    "no_cfunc_wrapper": True,  # no C code calls kernels
}


class _QuickCompilation(event.Listener):
    """Lets Numba compile the kernels of the package in two thirds of the time.

    Python looks for cyclic garbage seldom, and LLVM optimises at level 1 in place of 3, unless
    the user has chosen a level by NUMBA_OPT: the kernels run as fast.
    """

    depth = 0
    usual: tuple[Any, tuple[int, int, int]]

    def on_start(self, event: Any) -> None:
        if self.depth == 0:
            self.usual = config.OPT, gc.get_threshold()
            objects, *generations = gc.get_threshold()
            if objects > 0:  # 0 means that nobody looks
                gc.set_threshold(max(objects, 50_000), *generations)
            is_own = OPTIONS.items() <= event.data["dispatcher"].targetoptions.items()
            if is_own and "NUMBA_OPT" not in os.environ:
                config.OPT = type(config.OPT)(1)
        self.depth += 1

    def on_end(self, event: Any) -> None:
        self.depth -= 1
        if self.depth == 0:
            config.OPT, threshold = self.usual
            gc.set_threshold(*threshold)


event.register("numba:compile", _QuickCompilation())


def kernel(function: Callable[..., Result]) -> Callable[..., Result]:
    """Compile a function over arrays and keep the machine code on disk (an entry point).

    Products and sums may be contracted to fused multiply-adds; no other liberty is taken, so
    NaN and infinity survive and the result does not depend on the thread count. A kernel from
    outside the package is compiled anew when its bytecode, its constants or its callees
    change.
    """
    is_own = str(function.__module__).partition(".")[0] == __name__.partition(".")[0]
    if is_own:
        return _compile(function)
    return _compile_by_content(function)


def rounded_kernel(function: Callable[..., Result]) -> Callable[..., Result]:
    """Compile an entry point that rounds each product and sum by itself.

    So the same formula gives the same bits in every loop in which it stands.
    """
    return _compile(function, fastmath=False)


def inner(function: Function, **more: bool) -> Function:
    """Compile a function that kernels call: it is cached as a part of them.

    It has no wrapper for calls from Python, which would take as long to compile as the function
    itself. The first call from Python compiles the function once more, with a wrapper.
    """
    compiled: Any = numba.njit(**(OPTIONS | {"no_cpython_wrapper": True} | more))(function)
    wrapped = cache(lambda: numba.njit(**OPTIONS)(function))
    compiled._insert = lambda *_: None  # Python must not find machine code without a wrapper,
    compiled._compile_for_args = lambda *_, **__: wrapped()  # but call what this returns
    return compiled


def inlined(function: Function) -> Function:
    """Compile a function as `inner` does, and insert it in its callers even if it is long."""
    return inner(function, forceinline=True)


@intrinsic
def contiguous(context: Any, array: Any) -> Any:
    """In compiled code: an array whose items lie one after another, with quicker indices."""
    # The row of an array that repeats it for each element has not that type by itself.
    return array.copy(layout="C")(
        array
    ), lambda context, builder, signature, given: impl_ret_borrowed(
        context, builder, signature.return_type, given[0]
    )


def insert(template: Function, **functions: Callable) -> Function:
    """Copy a template, a plain function, with compiled `functions` for its globals of that name.

    The compiled copy calls them directly. Numba caches such a copy on disk, but neither a
    closure over a compiled function nor a function that takes one as an argument.
    """
    if unknown := functions.keys() - set(template.__code__.co_names):
        raise TypeError(f"{template.__qualname__} does not call {', '.join(sorted(unknown))}")
    names = [template.__qualname__, *(inserted.__qualname__ for inserted in functions.values())]
    name = "-".join(names)
    return _copy(template, name, template.__globals__ | functions)


def specialise(template: Callable[..., Result], **functions: Callable) -> Callable[..., Result]:
    """Compile a template as a `kernel`, with `functions` inserted (see `insert`).

    The machine code is found again by the bytecode, the constants and the callees of all of
    them.
    """
    return _compile_by_content(insert(template, **functions))


def _copy(function: Any, qualified_name: str, names: dict) -> Any:
    """Copy a plain function, with `names` for its globals.

    `qualified_name` is the name by which Numba finds the machine code on disk.
    """
    code = function.__code__
    closure = function.__closure__
    copy = FunctionType(code, names, function.__name__, function.__defaults__, closure)
    copy.__module__ = function.__module__
    copy.__doc__ = function.__doc__
    copy.__kwdefaults__ = function.__kwdefaults__
    copy.__qualname__ = qualified_name
    return copy


def _compile_by_content(function: Any, **options: Any) -> Any:
    """Compile; Numba finds the machine code on disk by a name that holds the fingerprint."""
    content = fingerprint(function)
    if content is None:
        return numba.njit(**(OPTIONS | options))(function)
    name = f"{function.__qualname__}-{content}"
    return _compile(_copy(function, name, function.__globals__), **options)


def _compile(function: Any, **options: Any) -> Any:
    """Compile; Numba finds the machine code on disk by the name, line and bytecode."""
    user_choice = config.CACHE_DIR
    config.CACHE_DIR = cache_folder()  # read by Numba while it decorates, not later
    try:
        return numba.njit(cache=True, **(OPTIONS | options))(function)
    finally:
        config.CACHE_DIR = user_choice


class _UnknownContent(Exception):
    """A function uses a value, and no process can tell whether another process has the same."""


def fingerprint(function: Callable) -> str | None:
    """Hash of a function's bytecode, its constants and all compiled functions that it calls.

    The compiled functions are found through globals, modules and closures. The hash is None
    where they do not tell what is compiled: if a global is not yet defined, or if it is neither
    a number, an array, a tuple of such, a compiled function, nor a part of Python, NumPy or
    Numba. Then the machine code must not be kept on disk.
    """
    try:
        content = repr(_function_content(function, {}))
    except _UnknownContent:
        return None
    return hashlib.sha256(content.encode()).hexdigest()[:16]


def _function_content(function: Callable, seen: dict[int, int]) -> tuple:
    """Describe a plain function by a tuple that is the same in every process.

    It has the bytecode, the default values, and all that the function takes from globals and
    closures. `seen` has a number for each function and module that was described before, by its
    id; the function is added to it. Raises `_UnknownContent` where a part cannot be described.
    """
    if id(function) in seen:  # functions may call each other
        return ("seen", seen[id(function)])
    seen[id(function)] = len(seen)
    if function.__module__ not in sys.modules:  # Numba imports it to read the machine code
        raise _UnknownContent(function.__module__)
    code = function.__code__
    names = builtins.__dict__ | function.__globals__
    described, global_names, attributes = _describe_code(code)
    values = []
    try:
        values += [names[name] for name in global_names]
        values += [cell.cell_contents for cell in function.__closure__ or ()]
    except (KeyError, ValueError) as error:  # not yet defined
        raise _UnknownContent(str(error)) from error
    contents = [_content(value, seen, attributes) for value in values]
    keyword_defaults = sorted((function.__kwdefaults__ or {}).items())
    defaults = _content([function.__defaults__, keyword_defaults], seen, ())
    return function.__module__, described, defaults, *contents


def _content(value: Any, seen: dict[int, int], attributes: tuple[str, ...]) -> tuple:
    """Describe a value that a function uses, by a tuple that is the same in every process.

    Of a module only the `attributes` count, the names that the function uses; of a module of a
    library none. Raises `_UnknownContent` for a value that cannot be described.
    """
    kind = type(value).__qualname__
    if isinstance(value, Dispatcher):
        options = sorted(value.targetoptions.items())
        return kind, _content(options, seen, ()), _function_content(value.py_func, seen)
    if isinstance(value, _Intrinsic):
        return kind, _function_content(value._defn, seen)
    if isinstance(value, tuple | list):
        return kind, *(_content(item, seen, attributes) for item in value)
    if isinstance(value, set | frozenset):
        return kind, *sorted(repr(_content(item, seen, ())) for item in value)
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise _UnknownContent(repr(value))  # its bytes are addresses
        return kind, value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, ModuleType):
        if id(value) in seen:
            return ("seen", seen[id(value)])
        seen[id(value)] = len(seen)
        if _is_of_library(value.__name__):
            used_names = set[str]()  # Numba itself checks the versions of libraries
        else:
            used_names = set(attributes) & vars(value).keys()
        parts = (_content(vars(value)[name], seen, attributes) for name in sorted(used_names))
        return kind, value.__name__, *parts
    home = getattr(value, "__module__", None) or type(value).__module__
    # another object of Numba's compiler: what it holds is not known
    is_compiled = home.startswith("numba") and not isinstance(value, type | FunctionType | Type)
    if is_compiled or not _is_of_library(home):
        raise _UnknownContent(repr(value))
    return kind, home, getattr(value, "__qualname__", repr(value))


@cache
def _describe_code(code: CodeType) -> tuple[tuple, tuple[str, ...], tuple[str, ...]]:
    """Describe the code of a function and of the functions that are defined inside it.

    Return three tuples: the bytecode of each with its constants; the names of the globals that
    they load; and all names that they use, of globals and of attributes. Both lists of names are
    sorted, so that they are the same in every process.
    """
    nested = [_describe_code(item) for item in code.co_consts if isinstance(item, CodeType)]
    constants = [item for item in code.co_consts if not isinstance(item, CodeType)]
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    content = _content(constants, {}, ())
    described = [(code.co_code, code.co_argcount, code.co_flags, names, content)]
    loads = dis.get_instructions(code)
    global_names = {load.argval for load in loads if load.opname == "LOAD_GLOBAL"}
    used_names = set(code.co_names)
    for inner_described, inner_globals, inner_used in nested:
        described.append(inner_described)
        global_names.update(inner_globals)
        used_names.update(inner_used)
    return tuple(described), tuple(sorted(global_names)), tuple(sorted(used_names))


def _is_of_library(module: str) -> bool:
    """Whether a module belongs to Python, NumPy or Numba: Numba itself checks their versions."""
    return module.partition(".")[0] in ("builtins", "cmath", "math", "numba", "numpy")
