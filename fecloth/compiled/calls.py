"""Calls of compiled kernels one after another, without Python between them.

Python needs 2 to 10 µs to call a kernel, as much as the forces of 200 triangles take. `join`
makes one function without arguments of several calls, with the addresses of the kernels and
their arrays as constants: the machine code of the kernels is the same, and so are the bits of
the results.

Numba's convention for a compiled function is used: ``status f(result*, error**, arguments...)``,
in which an array is seven or more words: two pointers for the memory's owner (null: nobody),
number of entries, bytes of an entry, address, shape, strides.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.extending import intrinsic

from fecloth.compiled.jit import kernel
from fecloth.compiled.team import Call


class SharedCall(NamedTuple):
    """A call that threads can share.

    Attributes
    ----------
    function, arguments
        The call that one thread makes alone.
    of_thread
        ``of_thread(p)`` returns the calls of thread p, if all threads share it.
    """

    function: Callable[..., object]
    arguments: tuple[Any, ...]
    of_thread: Callable[[int], list[Call]]


AnyCall = Call | SharedCall
Calls = Sequence[AnyCall]

WORD = ir.IntType(64)
PROCEDURE = ir.FunctionType(ir.VoidType(), ())
_numbers = count()


@dataclass(frozen=True, eq=False)
class JoinedCalls:
    """A compiled function that makes several calls.

    Attributes
    ----------
    address
        Address of the function, for `call` in a kernel.
    kept
        What must live as long as the function: its code, the kernels and the arrays.
    """

    address: int
    kept: tuple[Any, ...]

    def __call__(self) -> None:
        """Make the calls."""
        _call_once(self.address)


@global_compiler_lock
def join(calls: Calls) -> JoinedCalls:
    """Make one compiled function of several calls: it makes them in order.

    Their arguments become constants of the code. So the function always works on the same arrays,
    which may change in place, and with the present values of numbers. The results of the kernels
    are not used. Of a `SharedCall` it makes the call that one thread makes alone.
    """
    name = f"fecloth_calls_{next(_numbers)}"
    library = cpu_target.target_context.codegen().create_library(name)
    module = library.create_ir_module(name)
    body = ir.IRBuilder(ir.Function(module, PROCEDURE, name).append_basic_block())
    for function, arguments, *_ in calls:
        _add_call(body, function, arguments)
    body.ret_void()
    library.add_ir_module(module)
    library.finalize()
    return JoinedCalls(library.get_pointer_to_function(name), (library, tuple(calls)))


def _add_call(body: ir.IRBuilder, function: Any, arguments: tuple[Any, ...]) -> None:
    """Add the call of a kernel with these arguments to the code of a function.

    The kernel is compiled or read from disk if necessary. The module says how Numba's compiled
    functions take their arguments.
    """
    signature = tuple(numba.typeof(argument) for argument in arguments)
    function.compile(signature)
    compiled = function.overloads[signature]
    address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    convention = cpu_target.target_context.call_conv
    function_type = convention.get_function_type(compiled.signature.return_type, signature)
    result, error, *word_types = function_type.args
    pointer = body.inttoptr(ir.Constant(WORD, address), function_type.as_pointer())
    typed_words = zip(word_types, _words(arguments), strict=True)
    values = [_constant(word_type, word) for word_type, word in typed_words]
    # the function writes its result and its error somewhere: nobody reads them
    body.call(pointer, [body.alloca(result.pointee), body.alloca(error.pointee), *values])


def _words(value: Any) -> Iterator[float]:
    """Yield the numbers that stand for a value in Numba's convention, see the module.

    An array has seven or more, a tuple those of its parts, and a number itself.
    """
    if isinstance(value, np.ndarray):
        yield from (0, 0, value.size, value.itemsize, value.ctypes.data)
        yield from (*value.shape, *value.strides)
    elif isinstance(value, tuple):
        for part in value:
            yield from _words(part)
    else:
        yield value


def _constant(word_type: Any, word: float) -> Any:
    """Return a number as a constant of a type of LLVM."""
    if isinstance(word_type, ir.PointerType):
        return ir.Constant(WORD, int(word)).inttoptr(word_type)
    if isinstance(word_type, ir.DoubleType):
        return ir.Constant(word_type, float(word))
    return ir.Constant(word_type, int(word))


def _call(typing: Any, address: Any) -> Any:
    """Call the function at the address of a `JoinedCalls`; for kernels only."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.call(builder.inttoptr(arguments[0], PROCEDURE.as_pointer()), ())
        return context.get_dummy_value()

    return types.void(types.int64), generate


call: Any = intrinsic(_call)


@kernel
def _call_once(address: int) -> None:
    call(address)
