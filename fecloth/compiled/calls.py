"""Calls of compiled kernels one after another, without Python between them.

Python needs 2 to 10 µs to call a kernel, as much as the forces of 200 triangles take. `join`
makes one function without arguments of several calls, with the addresses of the kernels and
their arrays as constants: the machine code of the kernels is the same, and so are the bits of
the results. A `Present` number is read anew at each call, and a `ValuedCall` keeps its result.

Numba's convention for a compiled function is used: ``status f(result*, error**, arguments...)``,
in which an array is seven or more words: two pointers for the memory's owner (null: nobody),
number of entries, bytes of an entry, address, shape, strides.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import binding as llvm
from llvmlite import ir
from numba.core import types
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


class Present(NamedTuple):
    """An argument of a call: the number that an array (1,) holds when the call is made."""

    of: np.ndarray


class ValuedCall(NamedTuple):
    """A call of a kernel whose result, a float, is written to an array `result` (1,)."""

    function: Callable[..., float]
    arguments: tuple[Any, ...]
    result: np.ndarray


AnyCall = Call | SharedCall | ValuedCall
Calls = Sequence[AnyCall]

WORD = ir.IntType(64)
PROCEDURE = ir.FunctionType(ir.VoidType(), ())


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


def join(calls: Calls) -> JoinedCalls:
    """Make one compiled function of several calls: it makes them in order.

    Their arguments become constants of the code. So the function always works on the same arrays,
    which may change in place, and with the values that numbers have now; only `Present` numbers
    may change later. The results of the kernels are not used, except of a `ValuedCall`. Of a
    `SharedCall` it makes the call that one thread makes alone.
    """
    return join_each({"": calls})[""]


def join_each(lists: Mapping[str, Calls]) -> dict[str, JoinedCalls]:
    """Make a compiled function of each list of calls, as `join` does, under the names of the lists.

    Together they are compiled faster than one by one.
    """
    module = ir.Module("joined calls")
    for number, calls in enumerate(lists.values()):
        function = ir.Function(module, PROCEDURE, f"calls_{number}")
        body = ir.IRBuilder(function.append_basic_block())
        for each in calls:
            _add_call(body, each)
        body.ret_void()
    # Without optimisation: the functions only call kernels, and compile in a fifth of the time.
    machine = llvm.Target.from_default_triple().create_target_machine(opt=0, jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), machine)
    engine.finalize_object()
    return {
        name: JoinedCalls(engine.get_function_address(f"calls_{number}"), (engine, tuple(calls)))
        for number, (name, calls) in enumerate(lists.items())
    }


def _add_call(body: ir.IRBuilder, added: AnyCall) -> None:
    """Add the call of a kernel to the code of a function.

    The kernel is compiled or read from disk if necessary. The module says how Numba's compiled
    functions take their arguments.
    """
    function: Any = added[0]
    arguments = added[1]
    signature = tuple(_type_of(argument) for argument in arguments)
    function.compile(signature)
    compiled = function.overloads[signature]
    address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    convention = cpu_target.target_context.call_conv
    function_type = convention.get_function_type(compiled.signature.return_type, signature)
    result_type, error, *word_types = function_type.args
    pointer = body.inttoptr(ir.Constant(WORD, address), function_type.as_pointer())
    typed_words = zip(word_types, _words(arguments), strict=True)
    values = [_value(body, word_type, word) for word_type, word in typed_words]
    if isinstance(added, ValuedCall):
        result = _pointer(result_type, added.result.ctypes.data)
    else:  # the function writes its result somewhere: nobody reads it
        result = body.alloca(result_type.pointee)
    body.call(pointer, [result, body.alloca(error.pointee), *values])


def _type_of(argument: Any) -> Any:
    """The type of an argument for Numba."""
    if isinstance(argument, Present):
        return types.float64
    return numba.typeof(argument)


def _words(value: Any) -> Iterator[float | Present]:
    """Yield the numbers that stand for a value in Numba's convention, see the module.

    An array has seven or more, a tuple those of its parts, and a number itself.
    """
    if isinstance(value, np.ndarray):
        yield from (0, 0, value.size, value.itemsize, value.ctypes.data)
        yield from (*value.shape, *value.strides)
    elif isinstance(value, tuple) and not isinstance(value, Present):
        for part in value:
            yield from _words(part)
    else:
        yield value


def _value(body: ir.IRBuilder, word_type: Any, word: float | Present) -> Any:
    """Return a number of a type of LLVM: a constant, or what an array holds at the call."""
    if isinstance(word, Present):
        return body.load(_pointer(word_type.as_pointer(), word.of.ctypes.data))
    if isinstance(word_type, ir.PointerType):
        return _pointer(word_type, int(word))
    if isinstance(word_type, ir.DoubleType):
        return ir.Constant(word_type, float(word))
    return ir.Constant(word_type, int(word))


def _pointer(pointer_type: Any, address: int) -> Any:
    """Return an address as a constant of a pointer type of LLVM."""
    return ir.Constant(WORD, address).inttoptr(pointer_type)


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
